"""Grids that say little about continuous time: the check stays fair, the bound useful, the user is told."""

from __future__ import annotations

import numpy as np
import pytest

import occontrol
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor
from occontrol.core.solution import Certificate, Status
from occontrol.families.athans.assembly import _adds_up, _message, _remark
from occontrol.families.athans.certificate import discretisation_error
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import TopNumbers


def problem(intervals: int, end: float = 20.0, growth: float = -0.9) -> SchedulingProblem:
    plant = LinearPlant(A=[[growth, 0.3], [-0.2, growth]], noise=0.5 * np.eye(2), covariance=4 * np.eye(2))
    sensors = [Sensor("radar", [[0.4, 1.0]], [[0.2]], 0.3), Sensor("sonar", [[1.0, -0.2]], [[0.4]], 0.1)]
    edges = np.linspace(0, end, intervals + 1)
    return SchedulingProblem(
        "coarse", plant, sensors, edges, output=np.eye(2), cost_weight=0.2, running=0.1 * np.eye(2)
    )


@pytest.mark.parametrize("intervals", [1, 2, 3, 5])
def test_one_interval_of_many_time_constants_is_coarse_but_not_wrong(intervals: int) -> None:
    solution = occontrol.solve(problem(intervals))
    assert solution.status is Status.CERTIFIED
    continuous = solution.result["continuous"]
    difference = abs(continuous["cost"] - solution.cost)
    assert difference <= 5 * solution.result["discretisation_error"] + 1e-6 * solution.cost
    told = "The grid is coarse: in continuous time this schedule costs" in solution.message
    assert told == (difference > 0.1 * abs(continuous["cost"]))


def test_the_estimate_covers_the_error_where_two_halvings_do_not() -> None:
    from occontrol.families.athans.discretise import discretise
    from occontrol.scheduling.sweep import Sweep

    coarse = problem(1)
    weights = np.array([[1.0, 0.0]])
    cost = Sweep(discretise(coarse)).cost(weights)
    fine = Sweep(discretise(problem(8192))).cost(np.repeat(weights, 8192, axis=0))
    assert abs(fine - cost) <= 1.5 * discretisation_error(coarse, weights, cost)


def test_no_bound_lies_below_nothing() -> None:
    # on coarse intervals of a growing plant the switching functions prove less than what is plain: no cost is negative
    solution = occontrol.solve(problem(2, growth=0.8))
    continuous = solution.result["continuous"]
    assert solution.certificate is not None and solution.certificate.lower_bound >= 0
    assert 0 <= continuous["lower_bound"] <= continuous["cost"] and continuous["relative_gap"] <= 1


def test_a_cost_is_the_sum_of_its_parts() -> None:
    assert _adds_up(1.5, 1.0, 0.5, running=False) and _adds_up(2.5, 1.0, 0.5, running=True)
    assert not _adds_up(-1.16e11, 0.58, 6.7e9, running=False)
    assert not _adds_up(-1.16e11, 0.58, 6.7e9, running=True)
    assert not _adds_up(2.5, 1.0, 0.5, running=False)


def test_the_remark_on_a_coarse_grid() -> None:
    assert _remark(Certificate(1.05, 0.95), TopNumbers(1.0, 0.9, 0.1, "continuous"), "") == ""
    assert "puts the cost at 1.2; use more intervals" in _remark(
        Certificate(1.2, 1.0), TopNumbers(1.0, 0.9, 0.1, "continuous"), ""
    )
    weak = _remark(Certificate(1.0, 0.999), TopNumbers(1.0, 0.76, 0.24, "continuous"), "")
    assert weak == " With changes at these edges only the gap is 0.1 %: more intervals would bring the two together."
    assert _remark(Certificate(1.0, 0.999), TopNumbers(1.0, 0.995, 0.005, "continuous"), "") == ""
    assert "is not computed: too many panels" in _remark(
        Certificate(1.0, 0.9), TopNumbers(1.0, 0.9, 0.1, "grid"), "too many panels"
    )


def test_the_message_says_for_which_schedules_the_bound_holds() -> None:
    schedule = Schedule(np.array([0.0, 1.0]), np.array([[1.0]]), ("a",))
    everywhere = _message(Status.CERTIFIED, TopNumbers(1.0, 0.9, 0.1, "continuous"), 0.0, schedule)
    assert everywhere == "No schedule costs less than 0.9, whenever it switches."
    on_edges = _message(Status.FEASIBLE, TopNumbers(1.0, 0.9, 0.1, "grid"), 0.0, schedule)
    assert on_edges == "No schedule that changes at these edges costs less than 0.9."


def test_a_table_that_jumps_within_an_interval_is_no_disagreement() -> None:
    # midpoints of the halved intervals may lie on the same side of the jump as before, and see nothing of it
    from dataclasses import replace

    from occontrol.core.signal import TableSignal

    for place in (0.05, 0.2, 0.45, 0.8):
        values = np.array([0.1, 3.0, 3.0])[:, None, None] * np.eye(2)
        running = TableSignal(np.array([0.0, 10.0 + 0.1 * place, 20.0]), values, "previous")
        solution = occontrol.solve(replace(problem(200), running=running))
        assert solution.status is Status.CERTIFIED, place
        continuous = solution.result["continuous"]["cost"]
        assert abs(continuous - solution.cost) <= 2 * solution.result["discretisation_error"]
