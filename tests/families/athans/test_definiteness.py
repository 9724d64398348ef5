"""The covariance of the on-line filter stays definite and right where rounding is at its worst."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.families.athans.filter.online import MODELS, MatchedFilter
from occontrol.families.athans.problem import SchedulingProblem
from tests.families.athans.scheduling_cases import cycling
from tests.numerics.exact_kalman import exact, floats, rounded, step

PLANTS = {
    "drifting": [[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0]],
    "oscillating": [[0, 1, 0, 0], [-9, 0, 0, 0], [0, 0, 0, 1], [1, 0, -4, 0]],
    "time-varying": [[-0.5, "sin(t)", 0, 0], [0, -1, 0, 0], [0, 0, 0, 1], [0, 0, "-2 - cos(3*t)", -0.1]],
}


def problem(name, intervals=60):
    plant = LinearPlant(
        A=PLANTS[name], noise=np.diag([0, 1e-10, 0, 1e-6]), covariance=np.diag([1e6, 1e-6, 1e6, 1e-6]), mean=np.ones(4)
    )
    sensors = [
        Sensor("sum", [[1, 0, 1, 0]], 1e-12, 1.0),
        Sensor("pair", [[1, 0, 0, 0], [0, 0, 1, 1e-3]], [[1e-12, 5e-13], [5e-13, 1e-12]], 1.0),
        idle_sensor(4),
    ]
    return SchedulingProblem(name, plant, sensors, np.linspace(0, 6, intervals + 1), [[1, 0, 0, 0]], 7.0)


@pytest.mark.parametrize("model", ["split", "exact"])
@pytest.mark.parametrize("name", PLANTS)
def test_the_covariance_is_definite_and_no_nis_is_negative(name, model):
    task = problem(name)
    loop = MatchedFilter(task, cycling(task), model)
    g = np.random.default_rng(1)
    assert_definite(loop.plan.covariance)
    lost, seen = 0, 0
    for _ in range(20):
        loop.restart()
        while not loop.finished:
            values = {n: g.standard_normal(task.sensors[task.sensors.index(n)].rows) for n in loop.next_sensors}
            values = {n: v for n, v in values.items() if g.uniform() > 0.2}
            lost += len(values) < len(loop.next_sensors)
            done = loop.step(values)
            seen += done.nis >= 0
            assert not done.nis < 0
            assert_definite(done.covariance[None])
    assert lost > 50 and seen > 500


def assert_definite(covariances):
    assert np.array_equal(covariances, np.swapaxes(covariances, 1, 2))
    values = np.linalg.eigvalsh(covariances)
    assert np.all(values[:, 0] >= -1e-14 * values[:, -1])


@pytest.mark.parametrize("model", ["split", "exact"])
def test_the_covariance_against_rational_arithmetic(model):
    """Numerators are cut to 60 digits, a few of which the conditioning of this case uses up."""
    task = problem("drifting", 24)
    loop = MatchedFilter(task, cycling(task), model)
    sampled, P, plain = loop.model, exact(task.plant.covariance), task.plant.covariance
    worst, worst_plain = 0.0, 0.0
    for k in range(sampled.intervals):
        kept = np.arange(len(sampled.offset[k]))
        F, Q, H = sampled.transition[k], sampled.noise[k], sampled.observe[k]
        R, S = sampled.reading_noise[k], sampled.cross[k]
        if len(kept):
            _, _, P = step(P, exact(F), exact(Q), exact(H), exact(R), exact(S))
            gain = np.linalg.solve(H @ plain @ H.T + R, (F @ plain @ H.T + S).T).T
            closed = F - gain @ H
            plain = closed @ plain @ closed.T + Q - gain @ S.T - S @ gain.T + gain @ R @ gain.T
        else:
            P = floats_exact(P, F, Q)
            plain = F @ plain @ F.T + Q
        P, plain = rounded(P), (plain + plain.T) / 2
        true = floats(P)
        sd = np.sqrt(np.diag(true))
        worst = max(worst, np.max(np.abs(loop.plan.covariance[k + 1] - true) / np.outer(sd, sd)))
        worst_plain = max(worst_plain, np.max(np.abs(plain - true) / np.outer(sd, sd)))
    assert worst < 1e-6
    assert worst_plain > 100 * worst, "the case is harmless, the test says nothing"


def floats_exact(P, F, Q):
    from tests.numerics.exact_kalman import plus, times, transpose

    return plus(times(times(exact(F), P), transpose(exact(F))), exact(Q))


def test_a_missing_sample_leaves_the_root_of_the_same_covariance():
    """With one value of a pair lost, gain and covariance are those of the filter that never had it."""
    task = problem("oscillating")
    only = replace(task, sensors=[Sensor("pair", [[1, 0, 0, 0]], 1e-12, 1.0), idle_sensor(4)])
    for model in MODELS:
        both = MatchedFilter(replace(task, sensors=list(task.sensors)[1:]), cycling(only), model)
        single = MatchedFilter(only, cycling(only), model)
        for k in range(8):
            value = {"pair": [0.3]} if single.next_sensors else {}
            one = single.step(value)
            other = both.step({name: [0.3, np.nan] for name in value})
            sd = np.sqrt(np.diag(one.covariance))
            assert np.all(np.abs(other.covariance - one.covariance) <= 1e-9 * np.outer(sd, sd)), k
