"""The selection family: the paper's numbers, every chooser against the optimum, certificates, refusals."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import read_problem
from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.plant import DiscretePlant
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Status
from occontrol.families.vlambda.family import FAMILY as vlambda
from occontrol.families.vlambda.methods import Fixed, Lookahead, Optimal
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.sensor import DiscreteSensor

PROBLEMS = Path(__file__).parents[3] / "problems"
solve = vlambda.solve
CHOICES = [3, 2, 2, 2, 3, 2, 1, 2, 1, 2, 2, 2]


def joseph(P, H, R):
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    A = np.eye(len(P)) - K @ H
    return A @ P @ A.T + K @ R @ K.T


class Plain:
    """The paper's example again, in plain numpy: matrices typed a second time, a Joseph-form Kalman filter, eigh."""

    H = (
        np.array([[1.0, 0, 0], [0, 0.001, 0]]),
        np.array([[0, 0, 1.0], [0.001, 0, 0]]),
        np.array([[0, 1.05, 0], [0, 0, 0.001]]),
    )
    R = (0.1 * np.eye(2), 0.1 * np.eye(2), 0.05 * np.eye(2))
    Q = np.array([[0.01, 0.0001, 0.0001], [0.0001, 0.01, 0], [0.0001, 0, 0.015]])
    F = np.array([[0.95, 0.10, 0], [0, 0.95, 0], [0.001, 0, 0.975]])

    def run(self, epoch=25, fixed=None):
        P, chosen, posterior = 250 * np.eye(3), [], []
        for k in range(300):
            if k % epoch == 0:
                w, V = np.linalg.eigh(P)
                E = V[:, w >= w[-1] * (1 - 1e-9)]
                rho = [np.trace(E.T @ H.T @ np.linalg.inv(R) @ H @ E) for H, R in zip(self.H, self.R, strict=True)]
                j = fixed if fixed is not None else int(np.flatnonzero(rho >= np.max(rho) * (1 - 1e-10))[0])
                chosen.append(j + 1)
            P = joseph(P, self.H[j], self.R[j])
            posterior.append(P)
            F = self.F * (np.sin(0.01 * k) + 0.1)
            P = F @ P @ F.T + self.Q
        return chosen, np.array(posterior)


@pytest.fixture(scope="module")
def oshman():
    return read_problem(PROBLEMS / "oshman_example.yaml")


@pytest.fixture(scope="module")
def solutions(oshman):
    return {name: solve(oshman, vlambda.choose(oshman, name)) for name in vlambda.compare_names(oshman)}


def numbers(problem, solution):
    return [problem.sensors.index(entry["sensors"][0]) + 1 for entry in solution.result["schedule"]]


def test_the_papers_choices_scores_and_deviations(oshman):
    solution = solve(oshman)
    assert solution.method == "eigenspace"
    assert numbers(oshman, solution) == CHOICES
    assert solution.result["schedule"][0]["scores"] == pytest.approx([10.00001, 10.00001, 22.05002], rel=1e-9)
    deviations = solution.arrays["standard_deviations"]
    assert deviations[24] == pytest.approx([0.1052658286, 0.09355758172, 0.1292135546], rel=1e-9)
    assert deviations[174] == pytest.approx([0.1960251067, 0.4331344812, 1.955156781], rel=1e-9)
    alone = solve(oshman, Fixed("one")).arrays["standard_deviations"][174]
    assert alone == pytest.approx([0.1957441669, 0.4313637579, 12.17167981], rel=1e-9)


@pytest.mark.parametrize(("file", "epoch"), [("oshman_example", 25), ("oshman_every_step", 1)])
def test_the_whole_run_equals_a_joseph_form_filter_with_the_same_rule(file, epoch):
    problem = read_problem(PROBLEMS / f"{file}.yaml")
    solution = solve(problem)
    chosen, posterior = Plain().run(epoch)
    assert numbers(problem, solution) == chosen
    expected = np.sqrt(np.einsum("kii->ki", posterior))
    assert np.max(np.abs(solution.arrays["standard_deviations"] / expected - 1)) < 1e-9
    assert np.max(np.abs(solution.arrays["covariance"] - posterior)) < 1e-10
    largest = np.linalg.eigvalsh(posterior)[:, -1]
    r = solution.result
    assert r["sum_largest_eigenvalue"] == pytest.approx(largest.sum(), rel=1e-11)
    assert r["sum_trace"] == pytest.approx(np.trace(posterior, axis1=1, axis2=2).sum(), rel=1e-11)
    assert r["peak_largest_eigenvalue"] == pytest.approx(largest[1:].max(), rel=1e-11)
    assert r["cost"] == r["sum_largest_eigenvalue"]
    assert r["standard_deviations"] == pytest.approx(expected[-1], rel=1e-10)
    expect = problem.expect
    assert r["cost"] == pytest.approx(expect["cost"], rel=expect["tolerance"])
    assert r["sum_trace"] == pytest.approx(expect["sum_trace"], rel=expect["tolerance"])
    if "sensors" in expect:
        assert [e["sensors"][0] for e in r["schedule"]] == expect["sensors"]


def test_choosing_at_every_step_lowers_the_largest_eigenvalue_after_25():
    peaks = [
        solve(read_problem(PROBLEMS / f"{name}.yaml")).arrays["largest_eigenvalue"][26:].max()
        for name in ("oshman_example", "oshman_every_step")
    ]
    assert peaks == pytest.approx([3.82, 0.10], abs=5e-3)


def test_the_optimum_is_proven_and_no_chooser_beats_it(oshman, solutions):
    best = solutions["optimal"]
    assert best.status is Status.CERTIFIED
    assert best.result["relative_gap"] <= 1e-9
    assert numbers(oshman, best) == CHOICES  # the paper's rule happens to be optimal here
    assert best.result["nodes"] < 3**12 / 100
    for name, solution in solutions.items():
        assert solution.cost >= best.cost * (1 - 1e-10), name
    assert solutions["fixed:one"].cost > 10 * best.cost
    by_trace = dataclasses.replace(oshman, criterion="trace")
    traces = {name: solve(by_trace, vlambda.choose(by_trace, name)) for name in ("optimal", "eigenspace", "trace")}
    assert traces["optimal"].status is Status.CERTIFIED
    assert traces["optimal"].cost == pytest.approx(626.8439469509, rel=1e-10)
    assert traces["optimal"].cost <= min(traces["trace"].cost, traces["eigenspace"].cost) * (1 + 1e-12)


def test_the_greedy_rule_is_not_optimal_from_105_on():
    """Six epochs from k = 105: the rule costs 1.6 times the optimal sum of largest eigenvalues."""
    plain = Plain()
    P = 250 * np.eye(3)
    chosen, posterior = plain.run()
    del chosen
    F = plain.F * (np.sin(0.01 * 104) + 0.1)
    P = F @ posterior[104] @ F.T + plain.Q
    shape = "*(sin(0.01*(k+105))+0.1)"
    rows = [["0.95" + shape, "0.1" + shape, 0], [0, "0.95" + shape, 0], ["0.001" + shape, 0, "0.975" + shape]]
    sensors = [DiscreteSensor(str(j + 1), plain.H[j], plain.R[j]) for j in range(3)]
    problem = Problem("later", DiscretePlant(rows, plain.Q, P), sensors, 150, 25)
    best = solve(problem, Optimal())
    assert best.status is Status.CERTIFIED
    assert solve(problem).cost / best.cost == pytest.approx(1.6, abs=0.1)


def test_a_schedule_is_certified_against_the_proven_optimum(oshman, solutions):
    certified = vlambda.certify(oshman, solutions["eigenspace"].schedule)
    assert certified.status is Status.CERTIFIED
    other = vlambda.certify(oshman, solutions["fixed:two"].schedule)
    assert other.status is Status.FEASIBLE
    assert other.cost == pytest.approx(solutions["fixed:two"].cost, rel=1e-12)
    assert other.result["lower_bound"] == pytest.approx(solutions["optimal"].cost, rel=1e-9)
    good = vlambda.claims_of(oshman, solutions["fixed:two"])
    assert vlambda.certify(oshman, solutions["fixed:two"].schedule, good).status is Status.FEASIBLE
    for wrong in ({"cost": good.cost * 0.9}, {"lower_bound": 400.0}):
        claims = dataclasses.replace(good, **wrong)
        assert vlambda.certify(oshman, solutions["fixed:two"].schedule, claims).status is Status.DISAGREES


def test_claims_of_anybody_are_checked_and_what_is_certified_is_drawn(oshman, solutions):
    given = solutions["fixed:two"]
    optimum = solutions["optimal"].cost
    true = oc.certify(oshman, given.schedule, oc.Claims(cost=given.cost, lower_bound=optimum))
    assert true.status is Status.FEASIBLE and true.problem is oshman
    false = oc.certify(oshman, given.schedule, oc.Claims(cost=0.9 * given.cost, lower_bound=1.5 * optimum))
    assert false.status is Status.DISAGREES and false.status.exit_code == 7
    assert f"the stated cost is {0.9 * given.cost:.10g}, the schedule costs {given.cost:.10g}" in false.message
    assert f"the stated lower bound {1.5 * optimum:.10g} is not one: a known policy costs" in false.message
    assert "gap" in vlambda.figures(oshman, true)["overview"].axes[-1].texts[1].get_text()
    assert oc.plot(true) is not None


def test_claims_about_other_choices_do_not_replace_the_schedule(oshman, solutions):
    claims = vlambda.claims_of(oshman, solutions["fixed:two"])
    judged = vlambda.certify(oshman, solutions["eigenspace"].schedule, claims)
    assert judged.cost == pytest.approx(solutions["eigenspace"].cost, rel=1e-12)
    assert judged.status is Status.DISAGREES and "the stated cost is" in judged.message


def test_a_bound_above_the_cost_disagrees_and_is_not_hidden(oshman, solutions, monkeypatch):
    optimal = Optimal().run(oshman, Monitor())
    proof = dataclasses.replace(optimal.proof, lower_bound=2 * optimal.proof.lower_bound)
    high = dataclasses.replace(optimal, proof=proof)
    monkeypatch.setattr(Optimal, "run", lambda *_: high)
    judged = vlambda.certify(oshman, solutions["eigenspace"].schedule)
    assert judged.status is Status.DISAGREES and "lies above the cost" in judged.message
    assert judged.result["lower_bound"] == high.proof.lower_bound


def test_names_in_another_order_are_the_schedules_own(oshman, solutions):
    given = solutions["eigenspace"].schedule
    turned = Schedule(given.edges, given.weights[:, ::-1], given.names[::-1])
    assert vlambda.certify(oshman, turned).cost == vlambda.certify(oshman, given).cost


def test_a_schedule_of_another_kind_is_refused(oshman):
    names = tuple(oshman.sensors.names)
    with pytest.raises(ProblemError, match=r"changes inside of the epoch k = 0 \.\. 24"):
        vlambda.certify(oshman, Schedule(np.array([0.0, 20.0, 300.0]), np.eye(3)[:2], names))
    with pytest.raises(ProblemError, match="nothing is scheduled between t = 275 and 300"):
        vlambda.certify(oshman, Schedule(np.array([0.0, 275.0]), np.eye(3)[:1], names))
    with pytest.raises(ProblemError, match=r"t = 0 \.\. 300: 2 sensors are named, but select is 1"):
        vlambda.certify(oshman, Schedule(np.array([0.0, 300.0]), np.array([[1.0, 1.0, 0.0]]), names))
    with pytest.raises(ProblemError, match="the segment ends at 400, the horizon at 300"):
        vlambda.certify(oshman, Schedule(np.array([0.0, 400.0]), np.eye(3)[:1], names))
    with pytest.raises(ProblemError, match="shares an epoch between sensors"):
        vlambda.certify(oshman, Schedule(np.array([0.0, 300.0]), np.array([[0.5, 0.5, 0.0]]), names))


def test_names_that_carry_an_argument(oshman):
    assert vlambda.method_named(oshman, "fixed:two") == Fixed("two")
    assert vlambda.method_named(oshman, "lookahead:3") == Lookahead(depth=3)
    assert vlambda.method_named(oshman, "eigenspace") is None
    with pytest.raises(UsageError, match="there is no sensor 'four'"):
        vlambda.method_named(oshman, "fixed:four")
    with pytest.raises(UsageError, match=r"2 sensors are named, select is 1"):
        vlambda.method_named(oshman, "fixed:one+two")


def test_fixed_without_a_name_is_the_best_of_them(oshman, solutions):
    best = solve(oshman, Fixed())
    assert best.cost == min(solutions[f"fixed:{name}"].cost for name in oshman.sensors.names)
    assert "two" in best.message


def test_an_interrupted_run_keeps_the_last_choice(oshman):
    stopped = solve(oshman, None, Monitor(interrupted=2))
    assert stopped.status is Status.INTERRUPTED
    assert numbers(oshman, stopped) == [3] * 12
    assert "from k = 25 on the last choice is kept" in stopped.message
    best = solve(oshman, Optimal(), Monitor(interrupted=2))
    assert best.status is Status.INTERRUPTED
    assert best.result["lower_bound"] <= 352.3566146236 <= best.cost * (1 + 1e-9)


def test_the_peak_of_one_step_is_that_of_the_only_step(oshman):
    short = dataclasses.replace(oshman, steps=1, epoch=1, method=None)
    found = solve(short, Fixed("two"))
    lines = dict(vlambda.summarise(short, found))
    assert lines["peak largest eigenvalue"] == f"{found.arrays['largest_eigenvalue'][0]:.10g}  (k = 0, the only step)"
    two = solve(dataclasses.replace(short, steps=2), Fixed("two"))
    assert two.result["peak_largest_eigenvalue"] == two.arrays["largest_eigenvalue"][1]
    assert dict(vlambda.summarise(two.problem, two))["peak largest eigenvalue"].endswith("(k >= 1)")
