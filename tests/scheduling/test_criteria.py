"""Criteria beyond the trace: values by closed forms, gradients by differences, convexity, bounds by enumeration."""

import itertools

import numpy as np
import pytest

from occontrol.core.plant import DiscretePlant
from occontrol.core.sensor import Sensor
from occontrol.core.solution import Status
from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.families.athans.readings import fill as readings
from occontrol.families.athans.readings.clock import Steps
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.scheduling.bounds import policy_certificate
from occontrol.scheduling.criteria import (
    LargestEigenvalue,
    LogDeterminant,
    LogTrace,
    Schatten,
    independent_outputs,
)
from occontrol.scheduling.criterion_sweep import CriterionSweep
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.smoothed import minimise_smoothed
from occontrol.scheduling.sweep import Sweep
from scripts.campaign_criteria import judged
from tests.families.athans.random_problems import random_policy, random_problem

KINDS = ["log-trace", "logdet", "largest", "smoothed", "schatten"]


def made(kind: str, D: np.ndarray, mu: float = 0.3):
    return {
        "log-trace": lambda: LogTrace(D),
        "logdet": lambda: LogDeterminant(D),
        "largest": lambda: LargestEigenvalue(D),
        "smoothed": lambda: LargestEigenvalue(D, mu),
        "schatten": lambda: Schatten(D, 3.0),
    }[kind]()


def truth(kind: str, X: np.ndarray) -> float:
    """The same by singular values and determinants."""
    sizes = np.linalg.svd(X, compute_uv=False)
    return {
        "log-trace": np.log(np.sum(sizes)),
        "logdet": np.log(abs(np.linalg.det(X))),
        "largest": sizes[0],
        "smoothed": sizes[0],
        "schatten": np.sum(sizes**3) ** (1 / 3),
    }[kind]


def some_covariance(rng, n: int) -> np.ndarray:
    G = rng.normal(size=(n, n))
    return G @ G.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rows, n", [(1, 1), (2, 4), (4, 4)])
def test_value_and_gradient(kind, rows, n):
    rng = np.random.default_rng(rows + n)
    D, S, e = rng.normal(size=(rows, n)), some_covariance(rng, n), 1e-6
    criterion = made(kind, D)
    error = criterion.value(S) - truth(kind, D @ S @ D.T)
    if kind == "smoothed":
        assert -1e-12 <= error <= 0.3 * np.log(rows) + 1e-12
        tangent = np.vdot(criterion.gradient(S), S)
        assert criterion.value(S) - criterion.smoothing_error(S) == pytest.approx(tangent, rel=1e-12)
    else:
        assert abs(error) <= 1e-11 * (1 + abs(criterion.value(S))) and criterion.smoothing_error(S) == 0
    Z, change = criterion.gradient(S), some_covariance(rng, n)
    assert np.allclose(Z, Z.T) and np.linalg.eigvalsh(Z)[0] >= -1e-12 * np.abs(Z).max()
    difference = criterion.value(S + e * change) - criterion.value(S - e * change)
    assert np.vdot(Z, change) == pytest.approx(difference / (2 * e), rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_convex_in_the_information_and_growing_with_the_covariance(kind):
    rng = np.random.default_rng(7)
    D = rng.normal(size=(2, 3))
    criterion = made(kind, D)
    for _ in range(200):
        Y0, Y1 = (some_covariance(rng, 3) for _ in range(2))
        f0, f1, middle = (criterion.value(np.linalg.inv(Y)) for Y in (Y0, Y1, (Y0 + Y1) / 2))
        assert middle <= (f0 + f1) / 2 + 1e-12 * (abs(f0) + abs(f1))
        S = np.linalg.inv(Y0)
        assert criterion.value(S + some_covariance(rng, 3)) > criterion.value(S)


def test_the_least_eigenvalue_is_not_convex_and_so_not_offered():
    least = [1 / np.max(y) for y in ([1, 4], [4, 1], [2.5, 2.5])]
    assert least[2] > (least[0] + least[1]) / 2 + 0.1


def test_units_apart_by_twenty_orders_cost_the_volume_no_digits():
    units = np.diag([1e-10, 1.0, 1e10])
    S = some_covariance(np.random.default_rng(3), 3)
    criterion, scaled = LogDeterminant(np.eye(3)), LogDeterminant(units)
    assert scaled.value(S) == pytest.approx(criterion.value(S), rel=1e-12)
    np.testing.assert_allclose(scaled.gradient(S), criterion.gradient(S), rtol=1e-9)


def test_outputs_that_depend_on_one_another_are_refused_and_projected():
    S, D = some_covariance(np.random.default_rng(5), 3), np.array([[1.0, 0, 0], [0, 1e3, 0], [1, 1e3, 0]])
    with pytest.raises(ValueError, match="depend on one another"):
        LogDeterminant(np.array([[1.0, 0, 0], [2, 0, 0]])).value(S)
    with pytest.raises(ValueError, match="known exactly"):
        LogDeterminant(np.zeros((1, 3))).value(S)
    with pytest.raises(ValueError, match="known exactly"):
        LogTrace(np.zeros((1, 3))).gradient(S)
    with pytest.raises(ValueError, match="no output is uncertain"):
        independent_outputs(np.zeros((2, 3)), S)
    with pytest.raises(ValueError, match="at least 1"):
        Schatten(D, 0.5)
    kept = independent_outputs(D, S)
    assert kept.shape == (2, 3)
    sizes = np.linalg.eigvalsh(D @ S @ D.T)  # the volume in the range: the product of what is not 0
    assert LogDeterminant(kept).value(S) == pytest.approx(np.sum(np.log(sizes[1:])), rel=1e-6)
    assert independent_outputs(D[:2], S) is not None and independent_outputs(D[:2], S).shape == (2, 3)
    assert Schatten(np.zeros((1, 3))).value(S) == 0 and not np.any(Schatten(np.zeros((1, 3))).gradient(S))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("small", [0, 1000], ids=["blas", "loops"])
@pytest.mark.parametrize("running", [False, True])
def test_the_gradient_along_policies(kind, small, running):
    problem = random_problem(4, running=running)
    sweep = Sweep(discretise(problem), small=small, criterion=made(kind, problem.output.at(0.0)))
    rng, e = np.random.default_rng(0), 1e-5
    v, w = random_policy(problem, rng), random_policy(problem, rng)
    _, g = sweep.cost_and_gradient(0.5 * (v + w))
    difference = sweep.cost((0.5 + e) * v + (0.5 - e) * w) - sweep.cost((0.5 - e) * v + (0.5 + e) * w)
    assert np.vdot(g, v - w) == pytest.approx(difference / (2 * e), rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", KINDS)
def test_no_bound_lies_above_the_best_schedule_by_the_true_criterion(kind, seed):
    problem = random_problem(seed, intervals=4, idle=True, running=seed % 2 == 1)
    recursion, allowed = discretise(problem), feasible_set(problem)
    criterion = made(kind, problem.output.at(0.0))
    true = Sweep(recursion, criterion=made("largest" if kind == "smoothed" else kind, problem.output.at(0.0)))
    best = min(true.cost(np.eye(4)[list(word)]) for word in itertools.product(range(4), repeat=4))
    sweep, rng = Sweep(recursion, criterion=criterion), np.random.default_rng(seed)
    room = 1e-11 * (1 + abs(best))
    for _ in range(20):
        v = random_policy(problem, rng)
        J, g = sweep.cost_and_gradient(v)
        assert allowed.bound(J - sweep.smoothing_error, v, g) <= best + room
        certificate = policy_certificate(true, allowed, v, floor=true.floor)
        assert certificate.lower_bound <= best + room
    if kind in ("largest", "smoothed"):
        worst = LargestEigenvalue(problem.output.at(0.0))
        found = minimise_smoothed(CriterionSweep(recursion, worst), allowed, options=RelaxedOptions(1e-3))
        assert found.status is Status.CERTIFIED
        assert found.cost == pytest.approx(true.cost(found.weights), rel=1e-13)
    else:
        found = minimise_relaxed(sweep, allowed, options=RelaxedOptions(absolute_gap=1e-4))
        assert found.status == "certified"
    assert found.cost - 1.001e-3 * (1 + abs(found.cost)) <= found.lower_bound <= best + room


def plant_of_readings() -> ReadingsProblem:
    plant = DiscretePlant(
        F=[[1, 0.5, 0], [-0.3, 0.9, 0.2], [0, 0, "0.95+0.05*cos(0.7*k)"]], Q=np.diag([0, 0.04, 0.09]),
        covariance=np.diag([4.0, 1, 2]),
    )  # fmt: skip
    sensors = [
        Sensor("one", [[1, 0, 0]], [[0.25]], 0.0, variable="k"),
        Sensor("two", [[0, 1, 0]], [[0.1]], 0.0, variable="k"),
        Sensor("three", [[0, 0, 1], [1, 0, 0]], [[0.5, 0.1], [0.1, 1.0]], 0.0, variable="k"),
    ]
    return ReadingsProblem("volume", plant, sensors, Steps(6), [[1, 0, 0], [0, 1, 1]])


def final_covariance(problem: ReadingsProblem, word) -> np.ndarray:
    """A plain filter: measure, then predict."""
    S = problem.plant.covariance
    for k, j in enumerate(word):
        H, R = (np.atleast_2d(x.at(float(k))) for x in (problem.sensors[j].C, problem.sensors[j].noise))
        S = np.linalg.inv(np.linalg.inv(S) + H.T @ np.linalg.inv(R) @ H)
        F = np.array([[1, 0.5, 0], [-0.3, 0.9, 0.2], [0, 0, 0.95 + 0.05 * np.cos(0.7 * k)]])
        S = F @ S @ F.T + np.diag([0, 0.04, 0.09])
    return S


def test_the_volume_after_six_readings_is_negative_and_its_bound_too():
    problem, D = plant_of_readings(), np.array([[1.0, 0, 0], [0, 1, 1]])
    filled, allowed = readings.fill(problem), readings.feasible_set(problem)
    sweep = Sweep(filled.recursion, criterion=LogDeterminant(filled.units.out_of(D)))
    words = list(itertools.product(range(3), repeat=6))
    volumes = np.array([np.log(np.linalg.det(D @ final_covariance(problem, w) @ D.T)) for w in words])
    costs = np.array([sweep.cost(np.eye(3)[list(w)]) for w in words])
    np.testing.assert_allclose(costs, volumes, rtol=1e-11, atol=1e-12)
    assert words[int(np.argmin(costs))] == (1, 2, 1, 2, 1, 0)
    assert costs.min() == pytest.approx(-2.3721411177032845, abs=1e-12)
    found = minimise_relaxed(sweep, allowed, options=RelaxedOptions(absolute_gap=1e-7))
    assert found.status == "certified" and found.lower_bound <= -2.45197917 <= found.cost + 1e-7
    # the worst schedule costs more than 0: a bound raised to 0 beside it would be above the best
    worst = np.eye(3)[list(words[int(np.argmax(costs))])]
    certificate = policy_certificate(sweep, allowed, worst, floor=sweep.floor)
    assert certificate.lower_bound <= costs.min() and sweep.floor == -np.inf


@pytest.mark.parametrize("seed", range(300, 306))
def test_every_criterion_against_a_plain_filter_over_all_schedules(seed):
    for name, (_, beyond, room, certified) in judged(seed).items():
        assert beyond <= 1e-12 and room >= -1e-10 and certified, name
