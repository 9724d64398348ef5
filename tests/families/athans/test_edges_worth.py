"""Edges that are added: none that nothing depends on, and none that no clock can tell from another."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol import solve
from occontrol.families.athans.integration.refine import SMALLEST_WORTH, _apart
from scripts.campaign_enumeration import far_data
from tests.invariances import far_problem

SHORTEST = 1e-6  # of an interval; by numbers of steps alone the first piece had 1e-11


@pytest.mark.parametrize("seed", [19, 46, 397])
def test_a_diffuse_start_gets_no_edge_that_nothing_depends_on(seed: int) -> None:
    """Nothing runs up a cost in the first instant: its choice is worth 1e-11 of the whole."""
    data, origin = far_data(np.random.default_rng(seed), "prior", False)
    problem = far_problem(data, origin, "default")
    found = solve(problem)
    lengths = np.diff(found.problem.edges)
    assert len(lengths) > problem.intervals and found.result["added_edges"]
    assert np.min(lengths) > SHORTEST * np.max(problem.steps)
    assert found.result["top"]["relative_gap"] < 1e-3


def test_a_running_weight_makes_the_first_instant_worth_edges() -> None:
    """With a prior of 1e10 that is charged while it lasts, pieces far shorter than an interval pay."""
    from occontrol import LinearPlant, Sensor
    from occontrol.families.athans.problem import SchedulingProblem

    sensors = [Sensor("a", [[1.0, 0.0]], [[0.1]], 0.3), Sensor("b", [[0.0, 1.0]], [[0.2]], 0.1)]
    plant = LinearPlant([[0.0, 1.0], [-1.0, -0.4]], [[0.0, 0.0], [0.0, 0.5]], 1e10 * np.eye(2))
    problem = SchedulingProblem(
        "charged", plant, sensors, np.linspace(0, 10, 41), [[1.0, 0.0]], running=1e-3 * np.eye(2)
    )
    found = solve(problem)
    assert np.min(np.diff(found.problem.edges)) < 1e-3 * problem.steps[0]
    # what is left between bound and cost is rounding a shared policy, not the grid
    assert found.result["relaxed_cost"] - found.result["top"]["lower_bound"] < 1e-3 * found.cost


def test_times_that_no_clock_tells_apart() -> None:
    edges = 1.7e9 + np.array([0.0, 1.0, 2.0])
    ulp = float(np.spacing(1.7e9))
    times = [
        edges[1] - ulp,
        edges[1] + ulp,
        edges[0] + 0.5,
        edges[0] + 0.5 + 3 * ulp,
        edges[2] - 0.25,
        edges[2] - 2 * ulp,
    ]
    assert _apart(edges, times).tolist() == [edges[0] + 0.5, edges[2] - 0.25]
    assert _apart(edges, []).tolist() == []
    assert 0 < SMALLEST_WORTH < 1e-5
