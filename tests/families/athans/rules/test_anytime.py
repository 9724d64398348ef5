"""A search under rules that is cut short keeps the best schedule and the best bound, and can be taken up again."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import occontrol as oc
from occontrol.core.monitor import Monitor
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.rules.statement import Constraints
from scripts.instances import oscillators

LIMITS = Constraints(max_switches=4, min_on=0.5)
ROUNDING = 1e-9


class Stopping:
    """A monitor that hears Ctrl-C at record number `at` of a stage, or of any, and keeps the records."""

    def __init__(self, at: int, stage: str | None = "rules"):
        self.at, self.stage, self.rows = at, stage, []
        self.monitor = Monitor(show=self.show)

    def show(self, record) -> None:
        if self.stage in (None, record["stage"]):
            self.rows.append(record)
        if len(self.rows) >= self.at:
            self.monitor.interrupted = 2


@pytest.fixture(scope="module")
def problem() -> oc.athans.SchedulingProblem:
    base = oscillators(4, 3, 50, 1)
    return replace(base, rules=LIMITS, integration=Integration(substeps=1))


@pytest.fixture(scope="module")
def best(problem) -> oc.Solution:
    solution = oc.solve(problem, oc.athans.RelaxRoundPolish(exact={"max_nodes": 20000}))
    assert solution.result["proven_optimal"]
    return solution


def check(cut: oc.Solution, best: oc.Solution) -> None:
    """The schedule keeps the rules, the bound is one."""
    r, optimum = cut.result, best.result["cost"]
    assert cut.schedule is not None and r["constraints"]["satisfied"]
    assert r["cost"] >= optimum * (1 - ROUNDING) and 0 < r["lower_bound"] <= optimum * (1 + ROUNDING)
    assert r["lower_bound"] >= r["relaxed_lower_bound"] * (1 - ROUNDING)
    assert oc.certify(cut.problem, cut.schedule).result["cost"] == pytest.approx(r["cost"], rel=1e-12)


@pytest.mark.parametrize("nodes", [1, 3, 30])
def test_the_number_of_nodes_is_a_limit(problem, best, nodes: int) -> None:
    cut = oc.solve(problem, oc.athans.RelaxRoundPolish(exact={"max_nodes": nodes}))
    check(cut, best)
    assert cut.result["nodes"] == nodes and not cut.result["proven_optimal"]
    assert str(cut.status) == "feasible" and cut.status.exit_code == 0


def test_more_nodes_never_lower_the_bound_nor_raise_the_cost(problem) -> None:
    found = [oc.solve(problem, oc.athans.RelaxRoundPolish(exact={"max_nodes": n})).result for n in (1, 8, 40)]
    bounds, costs = ([r[key] for r in found] for key in ("lower_bound", "cost"))
    assert all(a <= b * (1 + ROUNDING) for a, b in pairwise(bounds))
    assert all(b <= a * (1 + ROUNDING) for a, b in pairwise(costs))
    assert bounds[-1] > bounds[0]


def test_a_limit_of_time_keeps_both(problem, best) -> None:
    cut = oc.solve(problem, oc.athans.RelaxRoundPolish(exact={"time_limit": 0.05, "max_nodes": 100000}))
    check(cut, best)
    assert not cut.result["proven_optimal"] and str(cut.status) == "feasible"


@pytest.mark.parametrize("at", [2, 10])
def test_ctrl_c_keeps_both_and_the_search_is_taken_up_again(problem, best, at: int) -> None:
    method = oc.athans.RelaxRoundPolish(exact={"max_nodes": 20000})
    watch = Stopping(at)
    cut = oc.solve(problem, method, monitor=watch.monitor)
    check(cut, best)
    assert str(cut.status) == "interrupted" and cut.status.exit_code == 130
    assert at <= cut.result["nodes"] <= at + 2 < best.result["nodes"]
    # the pictures over time: every report's bound holds, every cost is one
    for row in watch.rows:
        assert row["lower_bound"] <= best.cost * (1 + ROUNDING) <= row["cost"] * (1 + 2 * ROUNDING)
    again = Monitor(resume=cut)
    ended = oc.solve(problem, method, monitor=again)
    assert again.resumed and ended.result["proven_optimal"]
    assert ended.cost == pytest.approx(best.cost, rel=1e-9)
    single = oc.solve(problem, oc.athans.RelaxRoundPolish(exact={"max_nodes": 1}, polish=0), Monitor(resume=cut))
    assert single.cost <= cut.cost * (1 + ROUNDING)


def test_ctrl_c_before_the_first_node_gives_a_schedule_that_keeps_the_rules(problem, best) -> None:
    cut = oc.solve(problem, monitor=Stopping(1, None).monitor)
    check(cut, best)
    assert str(cut.status) == "interrupted"
    assert np.all(cut.schedule.weights.sum(axis=1) == 1)
