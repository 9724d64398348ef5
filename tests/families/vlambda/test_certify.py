"""What a run claims of its choices, computed again."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from occontrol.core.plant import DiscretePlant
from occontrol.core.solution import Status
from occontrol.families.vlambda.family import FAMILY
from occontrol.families.vlambda.methods import Fixed, Optimal
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.sensor import DiscreteSensor


@pytest.fixture(scope="module")
def run():
    plant = DiscretePlant([[1, 0.1], [0, 1]], 0.1 * np.eye(2), np.eye(2))
    sensors = [DiscreteSensor("one", [[1, 0]], [[1]]), DiscreteSensor("two", [[0, 1]], [[1]])]
    problem = Problem("walk", plant, sensors, 6, 2)
    return problem, FAMILY.solve(problem, Fixed("one")), FAMILY.solve(problem, Optimal())


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda cost, best: {"cost": cost * (1 + 1e-7)}, "the stated cost is "),
        (lambda cost, best: {"cost": cost * (1 - 1e-7)}, "the stated cost is "),
        (lambda cost, best: {"lower_bound": best * (1 + 1e-7)}, "the stated lower bound "),
        (lambda cost, best: {"lower_bound": (cost + best) / 2}, "the stated lower bound "),
        (lambda cost, best: {"cost": cost * (1 + 1e-9), "lower_bound": best * (1 + 1e-9)}, ""),
    ],
)
def test_a_false_cost_or_bound_disagrees_and_rounding_does_not(run, wrong, words):
    problem, fixed, optimal = run
    assert fixed.cost > 1.01 * optimal.cost
    claims = dataclasses.replace(FAMILY.claims_of(problem, fixed), **wrong(fixed.cost, optimal.cost))
    found = FAMILY.certify(problem, fixed.schedule, claims)
    assert found.status is (Status.DISAGREES if words else Status.FEASIBLE)
    assert found.message.startswith(words)
    assert found.cost == pytest.approx(fixed.cost, rel=1e-12)
    assert found.result["lower_bound"] == pytest.approx(optimal.cost, rel=1e-9)


@pytest.mark.parametrize(("share", "status"), [(1e-9, Status.CERTIFIED), (1e-7, Status.DISAGREES)])
def test_a_bound_above_the_cost_is_rounding_only_within_a_hundred_millionth(run, share, status, monkeypatch):
    problem, _, optimal = run
    honest = Optimal.run

    def higher(self, problem, monitor):
        found = honest(self, problem, monitor)
        above = dataclasses.replace(found.proof, lower_bound=optimal.cost * (1 + share))
        return dataclasses.replace(found, proof=above)

    monkeypatch.setattr(Optimal, "run", higher)
    assert FAMILY.certify(problem, optimal.schedule).status is status
