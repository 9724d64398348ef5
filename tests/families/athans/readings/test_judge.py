"""What is wrong with a solution of readings must come out: spoilt recursions, false claims, and no true one refused."""

import dataclasses

import numpy as np
import pytest

from occontrol.api import certify, family_of, solve
from occontrol.core.claims import Claims
from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import Sensor
from occontrol.core.solution import Status
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.readings import solve as solving
from occontrol.families.athans.readings.clock import SampleTimes
from occontrol.families.athans.readings.problem import ReadingsProblem
from tests.families.athans.readings.test_check_values import discrete, oshman, sampled

SPOILT = {
    "noise": lambda r: dataclasses.replace(r, noise=1.01 * r.noise),
    "transpose": lambda r: dataclasses.replace(r, transition=np.ascontiguousarray(np.swapaxes(r.transition, 1, 2))),
    "start": lambda r: dataclasses.replace(r, initial=0.99 * r.initial),
    "rows": lambda r: dataclasses.replace(r, rows=1.001 * r.rows),
    "prices": lambda r: dataclasses.replace(r, cost=0.999 * r.cost),
    "weight": lambda r: dataclasses.replace(r, terminal=1.0001 * r.terminal),
}


@pytest.mark.parametrize("name", SPOILT)
@pytest.mark.parametrize("make", [discrete, sampled], ids=["steps", "samples"])
def test_a_recursion_spoilt_on_purpose_disagrees(monkeypatch, make, name):
    right = solving.fill

    def wrong(problem):
        filled = right(problem)
        return dataclasses.replace(filled, recursion=SPOILT[name](filled.recursion))

    monkeypatch.setattr(solving, "fill", wrong)
    solution = solve(make())
    assert solution.status is Status.DISAGREES and solution.status.exit_code == 7
    assert "an independent covariance filter at" in solution.message


def test_a_constant_of_the_running_integral_that_is_lost_disagrees(monkeypatch):
    right = solving.fill
    monkeypatch.setattr(solving, "fill", lambda problem: dataclasses.replace(right(problem), constant=0.0))
    assert solve(sampled()).status is Status.DISAGREES


def test_a_bound_from_a_longer_search_is_not_called_false():
    """27 by the relaxation, 530 by first choices, more by a longer tree: all of them are true."""
    problem = oshman(False)
    solution = solve(problem, RelaxRoundPolish(exact={"max_nodes": 120}))
    short = dataclasses.replace(problem, method=RelaxRoundPolish(branch_first=False))
    again = certify(short, solution.schedule, family_of(problem).claims_of(problem, solution))
    assert solution.result["lower_bound"] > again.result["relaxed_cost"]
    assert again.status is not Status.DISAGREES


@pytest.mark.parametrize(
    "claims, words",
    [
        (Claims(cost=0.3), "the stated cost is 0.3, the schedule costs 0.3441013555"),
        (Claims(lower_bound=0.35), "the stated lower bound 0.35 is not one: a known policy costs 0.3441013555"),
        (Claims(parts={"prediction_error": 0.2}), "the stated prediction error is 0.2, recomputed 0.264101"),
    ],
)
def test_false_claims_are_refuted(claims, words):
    problem = discrete()
    again = certify(problem, solve(problem).schedule, claims)
    assert again.status is Status.DISAGREES and words in again.message


def test_a_claimed_bound_above_another_schedule_is_refuted():
    """The schedule itself costs more than the claim, one that the relaxation rounds to does not."""
    problem = discrete()
    worst = solve(problem, "random")
    best = solve(problem)
    claim = Claims(lower_bound=(best.cost + worst.cost) / 2)
    assert certify(problem, worst.schedule, claim).status is Status.DISAGREES


@pytest.mark.parametrize("nodes, bound", [(3, 530.13), (30, 530.9)])
def test_a_tree_that_is_stopped_reports_its_bound_and_not_its_cost(nodes, bound):
    """Oshman off-line, 626.84: fixing the first of twelve decisions alone proves 530."""
    r = solve(oshman(False), RelaxRoundPolish(exact={"max_nodes": nodes})).result
    assert r["cost"] == pytest.approx(626.8439469509, rel=1e-11) and r["proven_optimal"] is False
    assert r["lower_bound"] == pytest.approx(bound, rel=5e-3)


def test_noise_between_the_end_and_the_prediction_is_reported_and_not_charged():
    """A random walk of intensity 1 and 3 more units of time: 3 more."""
    plant = LinearPlant([[0.0]], [[1.0]], [[4.0]])
    clock = SampleTimes([0.5, 1.0], 0.0, 1.5)
    problem = ReadingsProblem("walk", plant, [Sensor("look", [[1.0]], [[0.5]])], clock, [[1.0]], predict_at=4.5)
    r = solve(problem).result
    first = 1 / (1 / 4.5 + 2)
    last = 1 / (1 / (first + 0.5) + 2) + 0.5
    assert r["prediction_error"] == pytest.approx(last, rel=1e-12) and r["cost"] == pytest.approx(last, rel=1e-12)
    assert r["predicted_mean_square_error"] == pytest.approx(last + 3.0, rel=1e-12)
