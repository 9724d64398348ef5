"""The shipped problems of many targets: solved from their files, as they expect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.core.monitor import Monitor
from occontrol.families.athans.targets.fill import fill
from occontrol.scheduling.blocks.relaxation import relax

PROBLEMS = Path(__file__).resolve().parents[4] / "problems"


@pytest.mark.slow
def test_fifty_aircraft_cost_what_their_file_expects() -> None:
    solution = oc.solve(oc.read_problem(PROBLEMS / "radar_fifty.yaml"))
    result, expect = solution.result, solution.problem.expect
    assert solution.status is oc.Status.CERTIFIED
    assert expect["source"] and result["cost"] == pytest.approx(expect["cost"], rel=expect["tolerance"])
    assert result["lower_bound"] <= expect["cost"]
    assert result["relative_gap"] < 0.005
    capacity = np.array([r.capacity for r in solution.problem.resources])
    used = np.zeros(capacity.shape)
    np.add.at(used, (solution.schedule.resource, solution.schedule.interval), 1)
    assert np.all(used <= capacity) and np.all(used[1, 96:108] == 0)  # serviced from minute 8 to 9


def test_the_catalogue_has_the_bound_that_its_file_expects() -> None:
    problem = oc.read_problem(PROBLEMS / "catalogue_1000.yaml")
    filled = fill(problem)
    sweep = filled.sweep()
    assert problem.targets == 1000 and problem.states == 6000 and np.all(problem.seen)
    found = relax(sweep, filled.allowed, 1e-2, 60, Monitor())
    assert found.status is oc.Status.CERTIFIED
    assert found.lower_bound <= problem.expect["cost"]
