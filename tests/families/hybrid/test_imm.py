"""The compiled estimator against a plain loop that shares no code with it."""

from __future__ import annotations

import dataclasses
import importlib.util
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag

from occontrol.families.hybrid.chooser import Chooser
from occontrol.families.hybrid.guard import Guard, Threshold
from occontrol.families.hybrid.imm import filter_measurements
from occontrol.families.hybrid.monte_carlo import Experiment, run_some
from occontrol.families.hybrid.plant import JumpPlant, Mode
from occontrol.families.hybrid.sensor import JumpSensor
from occontrol.families.hybrid.truth import Truth

ROOM = [["0.97", "0.03"], ["0.08", "0.92"]]


def _plain():
    spec = importlib.util.spec_from_file_location("plain_jump", Path(__file__).with_name("plain_jump.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


plain = _plain()


def turn(rate: float) -> np.ndarray:
    s, c = np.sin(rate), np.cos(rate)
    return np.array([[1, s / rate, 0, -(1 - c) / rate], [0, c, 0, -s], [0, (1 - c) / rate, 1, s / rate], [0, s, 0, c]])


def target(position_weight: float = 0.0, groups=((0,), (1,))) -> Experiment:
    F = np.array([[0.5, 0], [1, 0], [0, 0.5], [0, 1]])
    straight = np.array([[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1.0]])
    matrices = {"LT": turn(np.pi / 18), "RT": turn(-np.pi / 18), "CV": straight}
    modes = [Mode(name, A, np.eye(2), F) for name, A in matrices.items()]
    modes[2] = dataclasses.replace(modes[2], B=[[0.5], [1], [0], [0]], input=["0.3*sin(k/7)"])
    plant = JumpPlant(modes, np.eye(4), [0, 25, 0, 0], transition_matrix=0.2 + 0.4 * np.eye(3))
    one, two = [[1, 0, 0, 0.1], [0, 1, 0.1, 0]], [[0.1, 0, 0, 1], [0, 0.1, 1, 0]]
    sensors = [JumpSensor("one", one, np.eye(2)), JumpSensor("two", two, [["1+k/100", 0], [0, 1]])]
    sensors += [JumpSensor("three", [[0, 0, 1, 0]], [[4.0]])] if any(2 in group for group in groups) else []
    truth = Truth(np.array([0, 25.0, 0, 0]), np.eye(4))
    return Experiment(plant, sensors, groups, 110, [0, 2], truth, Chooser(None, 1.0, position_weight), seed=3)


def thermostat() -> Experiment:
    modes = [
        Mode("off", ROOM, [[0.05, 0], [0, 1.0]], B=[[1], [0]], input=["-0.35+0.1*sin(k/20)"]),
        Mode("on", ROOM, [[0.05, 0], [0, 1.0]], B=[[1, 0], [0, 1]], input=["-0.35+0.1*sin(k/20)", 2.0]),
    ]
    guards = [
        Guard("off", "on", [[1, 0, -1, 0], [0, 1, 0, 0]], [0, -45]),
        Guard("on", "off", [[-1, 0, 0, 1]], [0]),
    ]
    threshold = Threshold([19, 21], [[0.2, 0.05], [0.05, 0.1]])
    plant = JumpPlant(modes, np.diag([0.5, 9.0]), [20, 25], guards=guards, threshold=threshold)
    sensors = [JumpSensor("room", [[1, 0]], [[0.3]]), JumpSensor("radiator", [[0, 1]], [[2.0]])]
    truth = Truth(np.array([20.0, 25.0]), np.diag([0.5, 9.0]))
    return Experiment(plant, sensors, ((0,), (1,)), 110, [0], truth, Chooser(None, 1.0, 0.5), seed=2)


def in_plain_words(experiment: Experiment, run: int, runs):
    """The same run through the plain loop."""
    plant, sensors = experiment.plant, experiment.sensors
    names, first = plant.names, np.cumsum([0, *(s.rows for s in sensors)])

    def groups(k):
        for group in experiment.groups:
            C = np.vstack([sensors[j].C.at(k) for j in group])
            yield C, block_diag(*[sensors[j].R.at(k) for j in group])

    def z_of(k, g):
        rows = np.concatenate([np.arange(first[j], first[j + 1]) for j in experiment.groups[g]])
        return runs.truths.values[run, k - 1, rows]

    def transition_of(means, covariances):
        if plant.guards is None:
            return plant.transition_matrix
        guards = [(names.index(g.source), names.index(g.target), g.L, g.b) for g in plant.guards]
        return plain.guard_matrix(means, covariances, guards, plant.threshold.mean, plant.threshold.covariance)

    def drift(k):
        parts = [None if m.B is None else (m.B.at(k) @ m.input.at(k))[:, 0] for m in plant.modes]
        return [np.zeros(plant.states) if part is None else part for part in parts]

    described = {
        "A": lambda k: described.__setitem__("groups", list(groups(k))) or [m.A.at(k) for m in plant.modes],
        "Q": lambda k: [m.F.at(k) @ m.W.at(k) @ m.F.at(k).T for m in plant.modes],
        "drift": drift,
        "groups": None,
        "mean": plant.mean,
        "covariance": plant.covariance,
        "alpha": plant.probabilities,
        "steps": experiment.steps,
        "position": experiment.position,
    }
    return plain.run(described, transition_of, z_of, experiment.chooser.position_weight)


@pytest.mark.parametrize(
    "experiment",
    [target(), target(0.03), target(0.1, ((0, 2), (2, 1), (2,))), thermostat()],
    ids=["markov", "weighted", "groups", "guards"],
)
def test_kernel_and_plain_loop_agree_along_110_steps(experiment):
    runs = run_some(experiment, experiment.models(), [0, 1, 2])
    for run in range(3):
        estimates, chances, spreads, choices = in_plain_words(experiment, run, runs)
        assert np.array_equal(runs.choices[run], choices)
        assert len(set(choices)) > 1  # the rule does choose
        assert np.max(np.abs(runs.estimates[run] - estimates) / (1 + np.abs(estimates))) < 1e-9
        assert np.max(np.abs(np.exp(runs.log_probabilities[run]) - chances)) < 1e-9
        assert np.max(np.abs(runs.covariances[run] - spreads) / (1 + np.abs(spreads))) < 1e-9


def test_truths_follow_the_model():
    experiment = dataclasses.replace(target(), steps=30)
    runs = run_some(experiment, experiment.models(), range(400)).truths
    matrix = experiment.plant.transition_matrix
    for i in range(3):
        after = runs.modes[:, 1:][runs.modes[:, :-1] == i]
        share = np.bincount(after, minlength=3) / len(after)
        assert np.all(np.abs(share - matrix[i]) < 4 * np.sqrt(matrix[i] * (1 - matrix[i]) / len(after)))
    # plant noise F w: pull w out and look at its covariance; sensor noise likewise
    pulled, noise = [], []
    for k in range(1, 31):
        for r in range(400):
            mode = experiment.plant.modes[runs.modes[r, k]]
            rest = runs.states[r, k] - mode.A.at(k) @ runs.states[r, k - 1]
            rest -= 0 if mode.B is None else (mode.B.at(k) @ mode.input.at(k))[:, 0]
            pulled.append(rest[[1, 3]])
            assert rest[[0, 2]] == pytest.approx(rest[[1, 3]] / 2, abs=1e-9)
        noise.append(runs.values[:, k - 1] - runs.states[:, k] @ np.vstack([s.C.at(k) for s in experiment.sensors]).T)
    assert np.cov(np.array(pulled).T) == pytest.approx(np.eye(2), abs=4 * np.sqrt(2 / 12000))
    wanted = np.diag([1, 1, np.mean(1 + np.arange(1, 31) / 100), 1])
    assert np.cov(np.concatenate(noise).T) == pytest.approx(wanted, abs=5 * np.sqrt(2 / 12000))


def test_guards_lead_the_truth():
    experiment = thermostat()
    runs = run_some(experiment, experiment.models(), range(50)).truths
    off, on = 0, 1
    before, after, x = runs.modes[:, :-1], runs.modes[:, 1:], runs.states[:, :-1]
    started, stopped = (before == off) & (after == on), (before == on) & (after == off)
    assert started.sum() > 30
    assert stopped.sum() > 30
    assert np.all(x[started][:, 0] < 19 + 5 * np.sqrt(0.2))
    assert np.all(x[started][:, 1] <= 45)
    assert np.all(x[stopped][:, 0] > 21 - 5 * np.sqrt(0.1))
    assert np.mean(x[started][:, 0]) == pytest.approx(19, abs=0.6)


def test_twenty_modes_with_far_off_ones_stay_finite():
    rng = np.random.default_rng(1)
    modes = [Mode(f"m{i}", [[0.9]], [[0.01]], B=[[1]], input=[1000.0 * i]) for i in range(20)]
    matrix = rng.dirichlet(np.ones(20), size=20)
    plant = JumpPlant(modes, [[1.0]], transition_matrix=matrix)
    sensors = [JumpSensor("a", [[1]], [[0.01]]), JumpSensor("b", [[1]], [[4.0]])]
    experiment = Experiment(plant, sensors, ((0,), (1,)), 60, [0], Truth(np.zeros(1), np.eye(1)), Chooser(), seed=1)
    runs = run_some(experiment, experiment.models(), range(5))
    assert np.all(np.isfinite(runs.estimates))
    assert np.min(runs.log_probabilities) < -1e5  # far below the smallest double's logarithm, -745
    assert np.mean(np.argmax(runs.log_probabilities, axis=2) == runs.truths.modes[:, 1:]) == 1.0


def test_measurement_file_filter_repeats_the_run_and_bridges_gaps():
    experiment = dataclasses.replace(thermostat(), groups=((0, 1), (1,)))
    runs = run_some(experiment, experiment.models(), [7])
    readings = {}
    for k in range(1, 111):
        group = experiment.groups[runs.choices[0, k - 1]]
        readings[k] = [(j, runs.truths.values[0, k - 1, [j]]) for j in group]
    found = filter_measurements(experiment.plant, experiment.sensors, 110, readings)
    assert found.mean[1:] == pytest.approx(runs.estimates[0], abs=1e-10)
    assert found.probabilities[1:] == pytest.approx(np.exp(runs.log_probabilities[0]), abs=1e-10)
    assert 0.5 < np.nanmean(found.nis[1:] / found.dimension[1:]) < 1.6
    # k = 0 is the plant's own start, before anything is known
    assert np.array_equal(found.covariance[0], experiment.plant.covariance)
    assert np.array_equal(found.mean[0], experiment.plant.mean)
    assert np.array_equal(found.probabilities[0], experiment.plant.probabilities)
    del readings[50]
    gap = filter_measurements(experiment.plant, experiment.sensors, 110, readings)
    assert np.isnan(gap.nis[50])
    assert np.trace(gap.covariance[50]) > np.trace(found.covariance[50])
    assert gap.probabilities.sum(axis=1) == pytest.approx(np.ones(111))
