"""The shipped problems of readings: as expected, and better than what one would do by hand."""

import numpy as np
import pytest

from occontrol.api import read_problem, solve
from occontrol.core.solution import Status

GAPS = {"brownian_one_look": 1e-6, "oshman_off_line": 0.16, "radar_discrete": 0.035, "reactor_assays": 0.15}


@pytest.mark.slow
@pytest.mark.parametrize("name", GAPS)
def test_a_shipped_problem_of_readings(name):
    problem = read_problem(f"problems/{name}.yaml")
    solution = solve(problem)
    result = solution.result
    assert solution.status is Status.CERTIFIED
    assert -1e-12 <= result["relative_gap"] <= GAPS[name]
    if problem.expect is not None:
        assert result["cost"] == pytest.approx(problem.expect["cost"], rel=problem.expect["tolerance"])
    if problem.budget is None:
        for other in ("greedy", "round-robin", "best-single"):
            assert solve(problem, other).cost >= result["cost"] * (1 - 1e-9)


def test_the_radar_looks_near_inside_its_sector_only():
    solution = solve(read_problem("problems/radar_discrete.yaml"))
    near = [entry["k"] for entry in solution.result["schedule"] if "near radar" in entry["sensors"]]
    assert near and all(12 <= k <= 32 for k in near)


@pytest.mark.slow
def test_six_assays_whichever():
    solution = solve(read_problem("problems/reactor_assays.yaml"))
    real = solution.schedule.weights[:, :2]
    assert np.sum(real) == 6 and np.max(np.sum(real, axis=1)) == 1
