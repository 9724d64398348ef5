"""Switching problems in states of any units: the same decisions, horizons, matrices and sizes."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol import solve
from occontrol.core.errors import InfeasibleError
from occontrol.core.sensor import Sensor
from occontrol.families.robust.balanced import balanced
from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.family import FAMILY
from occontrol.families.robust.observability import observability, uniformly_observable
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.problem import Problem

RANDOM = 40
NAMES = ("trace", "volume", "longest-axis")


def random_problem(seed: int, e: np.ndarray | float = 1.0, size: object = "volume", formulas: bool = False) -> Problem:
    """A random problem, near the edge of uniform observability as often as not, in states e * x."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    e = np.ones(n) * e
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, int(rng.integers(1, n + 1))))
    K, weight = rng.normal(size=(1, n)) * rng.uniform(0.1, 0.6), np.diag(rng.uniform(0.3, 3, n))
    C = [rng.normal(size=(1, n)) for _ in range(2)]
    moved = A * np.outer(e, 1 / e)
    given = [[f"{x!r}*(1 + 0.1*sin(t))" for x in row] for row in moved.tolist()] if formulas else moved
    plant = UncertainPlant(given, B * e[:, None], K / e, weight / np.outer(e, e), rng.normal(size=n) * e)
    sensors = [Sensor(f"s{j}", c / e, [[1.0]]) for j, c in enumerate(C)]
    return Problem("random", plant, sensors, np.linspace(0, 1.5, 5), size)


def units(seed: int) -> np.ndarray:
    """Powers of two whose ratios reach 1e12."""
    rng = np.random.default_rng(seed)
    return 2.0 ** rng.integers(-20, 21, random_problem(seed).states)


def test_observability_does_not_depend_on_units() -> None:
    seen = set()
    for seed in range(RANDOM):
        plain, there = balanced(random_problem(seed)), balanced(random_problem(seed, units(seed)))
        verdict = uniformly_observable(plain)
        assert uniformly_observable(there) is verdict
        assert observability(there) == observability(plain)
        seen.add(verdict)
    assert seen == {True, False}


@pytest.mark.parametrize("formulas", [False, True])
def test_matrices_come_back_in_the_users_states(formulas: bool) -> None:
    seed = next(s for s in range(RANDOM) if uniformly_observable(balanced(random_problem(s, formulas=formulas))))
    e = units(seed)
    first, other = (solve(random_problem(seed, each, formulas=formulas)) for each in (1.0, e))
    both = np.outer(e, e)
    assert np.array_equal(first.schedule.weights, other.schedule.weights)
    for name in ("shape", "ordinary", "fine_shape"):
        assert np.allclose(other.arrays[name] / both, first.arrays[name], rtol=1e-12, atol=1e-300), name
    for name in ("center_weight", "free_weight"):
        assert np.allclose(other.arrays[name] * both, first.arrays[name], rtol=1e-12, atol=1e-300), name
    for name in ("X_initial", "Y_initial"):
        assert np.allclose(np.array(other.result[name]) * both, first.result[name], rtol=1e-12, atol=1e-300), name
    judged = [np.array(each.result["independent"]["Y_initial"]) for each in (first, other)]
    assert np.allclose(judged[1] * both, judged[0], rtol=1e-7, atol=1e-9 * np.max(np.abs(judged[0])))
    assert other.cost == pytest.approx(first.cost * np.prod(e), rel=1e-12)
    # in its own states: P at the start is the inverse of the weight, and the size is that of P at the end
    plant = other.problem.plant
    assert np.allclose(other.arrays["shape"][0] @ plant.weight, np.eye(len(e)), atol=1e-9 * np.max(both) / np.min(both))
    assert other.problem.plant is plant and type(other.problem) is Problem
    assert Size.of("volume").value(other.arrays["shape"][-1], other.result["level"]) == pytest.approx(other.cost)


@pytest.mark.parametrize("name", NAMES)
def test_a_size_in_scaled_states(name: str) -> None:
    """Values and gradients against the same size of D P D, and against differences."""
    rng = np.random.default_rng(3)
    S, d = rng.normal(size=(3, 3)), np.array([4.0, 0.5, 1.0])
    P, both, level = S @ S.T + np.eye(3), np.outer(d, d), 1.7
    plain, there = Size.of(name), Size(Size.of(name).terms, tuple(d))
    assert there.value(P, level) == pytest.approx(float(plain.value(P * both, level)), rel=1e-13)
    for found, wanted in (
        (there.smooth(P, level, 8.0), plain.smooth(P * both, level, 8.0)),
        (there.support(P, level), plain.support(P * both, level)),
    ):
        assert found[0] == pytest.approx(wanted[0], rel=1e-13)
        assert np.allclose(found[1], wanted[1] * both, rtol=1e-10)
        V = rng.normal(size=(3, 3))
        V, step = V + V.T, 1e-6
        up, down = (there.smooth(P + s * step * V, level, 8.0)[0] for s in (1, -1))
        slope = float(np.sum(there.smooth(P, level, 8.0)[1] * V))
        assert (up - down) / (2 * step) == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("size", ["trace", "longest-axis", {"volume": 1.0, "longest-axis": 3.0}])
def test_sizes_that_know_units_are_those_of_the_users_states(size: object) -> None:
    """The best sequence for states in metres and kilometres, against every sequence in plain double arithmetic."""
    seed = next(s for s in range(RANDOM) if uniformly_observable(balanced(random_problem(s))))
    e = np.ones(random_problem(seed).states)
    e[0] = 1024.0
    problem = random_problem(seed, e, size)
    found, ranked = solve(problem), solve(problem, "all")
    assert found.cost == pytest.approx(ranked.cost, rel=1e-9)
    shape = found.arrays["shape"][-1]
    assert found.cost == pytest.approx(float(Size.of(size).value(shape, found.result["level"])), rel=1e-9)  # type: ignore[arg-type]
    assert found.result["independent"]["cost"] == pytest.approx(found.cost, rel=1e-7)


def test_a_plant_that_no_sensor_can_observe_is_refused_in_any_units() -> None:
    seed = next(s for s in range(RANDOM) if not uniformly_observable(balanced(random_problem(s))))
    words = []
    for e in (1.0, units(seed)):
        with pytest.raises(InfeasibleError, match="not uniformly robustly observable") as refused:
            FAMILY.require_feasible(random_problem(seed, e))
        words.append(str(refused.value))
        assert solve(random_problem(seed, e)).schedule is None
    assert words[0] == words[1]
