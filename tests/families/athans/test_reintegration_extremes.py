"""The continuous re-integration where numbers are extreme: closed forms, rational numbers, other panels, refusals."""

from fractions import Fraction
from math import factorial

import numpy as np
import pytest

from occontrol.core.errors import SolveFailed
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule, constant_schedule
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.families.athans.continuous import reintegration
from occontrol.families.athans.continuous import stretch as continuous_stretch
from occontrol.families.athans.continuous.reintegration import reintegrate
from occontrol.families.athans.problem import SchedulingProblem
from tests.families.athans.random_problems import random_policy, random_problem
from tests.families.athans.test_reintegration import agree, fractions, oscillator


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("intervals", [300, 400, 600])
def test_sensors_in_turn_on_two_walks(intervals):
    """Every interval uses the sensor that the one before it did not; each walk is a scalar Riccati equation."""
    noise, rate, steps = 0.2, 10.0, 2.0 / intervals
    problem = SchedulingProblem(
        "two walks",
        LinearPlant(np.zeros((2, 2)), noise * np.eye(2), np.eye(2)),
        [Sensor("a", [[1, 0]], [[1 / rate]]), Sensor("b", [[0, 1]], [[1 / rate]])],
        np.linspace(0, 2, intervals + 1),
        np.eye(2),
    )
    weights = np.eye(2)[np.arange(intervals) % 2]
    found = reintegrate(problem, Schedule(problem.edges, weights, ("a", "b")))
    rest, turn = np.sqrt(noise / rate), np.tanh(np.sqrt(noise * rate) * steps)
    walks = [1.0, 1.0]
    for k in range(intervals):
        seen, other = k % 2, 1 - k % 2
        walks[seen] = rest * (walks[seen] + rest * turn) / (rest + walks[seen] * turn)
        walks[other] += noise * steps
    assert found.cost == pytest.approx(sum(walks), rel=1e-11)
    np.testing.assert_allclose(found.covariance_at_edges[-1], np.diag(walks), rtol=1e-11)
    assert found.lower_bound < found.cost
    assert found.relative_gap < 0.1


def test_a_sensor_that_is_never_used_is_judged_all_the_same():
    """Nothing measures the second state, which only noise drives: its scale must not run away."""
    problem = oscillator(
        plant=LinearPlant([[-0.3, 0], [0, 0]], np.diag([0.1, 0.2]), np.eye(2)),
        sensors=[Sensor("first", [[1, 0]], [[0.1]]), Sensor("second", [[0, 1]], [[1e-4]]), idle_sensor(2)],
        output=np.eye(2),
    )
    agree(problem, constant_schedule(problem.edges, problem.sensors.names, [0.6, 0, 0.4]))


def test_what_is_hardly_seen_keeps_its_digits():
    """Five integrators in a chain, no noise, prior 1e8: the information matrix is known in rational numbers."""
    n, T, prior, rate = 5, Fraction(1, 4), 10**8, 10**3
    problem = SchedulingProblem(
        "chain",
        LinearPlant(np.diag(np.ones(n - 1), 1), np.zeros((n, n)), prior * np.eye(n)),
        [Sensor("first", np.eye(n)[:1], [[1 / rate]])],
        np.linspace(0, float(T), 4),
        np.eye(n)[-1:],
    )
    found = reintegrate(problem, constant_schedule(problem.edges, ["first"], [1.0]))
    # the last state is constant, so its variance at T is that at 0 given all measurements: ((I/prior + W)^-1)_nn
    rows = [
        [
            Fraction(i == j, prior) + rate * T ** (i + j + 1) / (factorial(i) * factorial(j) * (i + j + 1))
            for j in range(n)
        ]
        for i in range(n)
    ]
    for k in range(n - 1):  # what is left of the last row after elimination is 1 / ((I/prior + W)^-1)_nn
        for i in range(k + 1, n):
            share = rows[i][k] / rows[k][k]
            rows[i] = [a - share * b for a, b in zip(rows[i], rows[k], strict=True)]
    exact = float(1 / rows[-1][-1])
    assert abs(found.cost - exact) <= found.error
    assert found.cost == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("seed", range(8))
def test_cutting_intervals_changes_nothing(seed):
    """Other panels, other groups: the same policy, the same numbers within what they claim."""
    problem = random_problem(seed, states=4, intervals=5, varying=seed % 2 > 0, running=seed > 5, stiff=seed % 4 > 1)
    schedule = Schedule(
        problem.edges, random_policy(problem, np.random.default_rng(seed)), tuple(problem.sensors.names)
    )
    whole = reintegrate(problem, schedule)
    edges = np.unique(np.concatenate([problem.edges, problem.edges[:-1] + problem.steps * 0.3]))
    parts = reintegrate(problem, Schedule(edges, np.repeat(schedule.weights, 2, axis=0), schedule.names))
    assert abs(whole.cost - parts.cost) <= 0.2 * (whole.error + parts.error)
    bounds = [c.lower_bound + c.error for c in (whole, parts)]
    assert abs(bounds[0] - bounds[1]) <= whole.error + parts.error


@pytest.mark.parametrize("running", [None, [[0.3, 0.1], [0.1, 0.2]]])
def test_little_memory_gives_the_same(monkeypatch, running):
    problem = oscillator(running=running)
    schedule = fractions(problem)
    plenty = reintegrate(problem, schedule)
    monkeypatch.setattr(continuous_stretch, "STRETCH_BYTES", 3000)
    monkeypatch.setattr(reintegration, "KEPT_BYTES", 3000)
    little = reintegrate(problem, schedule)
    assert little.cost == pytest.approx(plenty.cost, rel=1e-12)
    assert little.lower_bound == pytest.approx(plenty.lower_bound, rel=1e-9)
    np.testing.assert_allclose(little.covariance_at_edges, plenty.covariance_at_edges, rtol=1e-10)


def test_what_cannot_be_computed_is_refused():
    names = ["range", "doppler", "idle"]
    runaway = oscillator(plant=LinearPlant([[400.0, 1], [0, 1]], np.eye(2), np.eye(2)))
    with np.errstate(all="ignore"), pytest.raises(SolveFailed, match="overflow"):
        reintegrate(runaway, constant_schedule(runaway.edges, names, [0, 0, 1.0]))
    fast = oscillator(plant=LinearPlant([[-1e9, 0], [0, -1e9]], np.eye(2), np.eye(2)))
    with pytest.raises(SolveFailed, match="panels"):
        reintegrate(fast, constant_schedule(fast.edges, names, [0, 0, 1.0]))
