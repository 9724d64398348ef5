"""The independent judge of the athans family must be able to say no, and certify must find what is wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import occontrol as oc
from occontrol.core.claims import Claims
from occontrol.core.errors import ProblemError
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor
from occontrol.core.signal import TableSignal
from occontrol.core.solution import Solution, Status
from occontrol.families.athans import assembly, certificate, certify
from occontrol.families.athans.certificate import discretisation_error, judge
from occontrol.families.athans.certify import claims_of
from occontrol.families.athans.discretise import discretise, prediction_weight
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.random_problems import random_policy, random_problem


def given(seed: int = 2, **changes) -> tuple[SchedulingProblem, Schedule]:
    """A small problem and a schedule of it that uses every sensor."""
    problem = random_problem(seed, intervals=6, **changes)
    weights = np.eye(3)[[0, 1, 2, 2, 0, 1]]
    return problem, Schedule(problem.edges, weights, tuple(problem.sensors.names))


# ---- costs that do not agree


@pytest.mark.parametrize(("errors", "agrees"), [(4.9, True), (5.1, False), (-4.9, True), (-5.1, False)])
def test_the_costs_may_differ_by_five_errors_and_not_by_more(errors, agrees):
    problem, schedule = given()
    true = judge(problem, schedule.weights, 1.0, error=1.0).continuous.cost
    error = 1e-2 * true
    judged = judge(problem, schedule.weights, true + errors * error, error=error)
    assert judged.agrees is agrees
    assert judged.discretisation_error == error
    if not agrees:
        assert judged.text.endswith("the independent integration differ by more than 5 discretisation errors")


@pytest.mark.parametrize(("share", "agrees"), [(5e-7, True), (5e-6, False)])
def test_without_an_error_a_millionth_is_forgiven(share, agrees):
    problem, schedule = given()
    true = judge(problem, schedule.weights, 1.0, error=1.0).continuous.cost
    assert judge(problem, schedule.weights, true * (1 + share), error=0.0).agrees is agrees


@pytest.mark.parametrize("peak", [None, 10.0, 100.0])
def test_the_error_estimate_is_right_from_both_sides(peak):
    problem, schedule = given(seed=5)
    if peak:
        # a running weight that jumps up and down between the midpoints of two halvings, seen as its times become edges
        start, end = problem.edges[2:4]
        times = np.array([0.0, start + 0.9 * (end - start), start + 0.98 * (end - start)])
        table = TableSignal(times, np.array([0.1, peak, 0.1])[:, None, None] * np.eye(3), "previous")
        problem = dataclasses.replace(problem, running=table)
    cost = Sweep(discretise(problem)).cost(schedule.weights)
    true = abs(cost - judge(problem, schedule.weights, cost, error=1.0).continuous.cost)
    assert true > 1e-4 * cost
    assert true / 2 < discretisation_error(problem, schedule.weights, cost) < 2 * true


def noisier(r: Recursion) -> dict[str, np.ndarray]:
    return {"noise": 1.2 * r.noise}


def transposed(r: Recursion) -> dict[str, np.ndarray]:
    return {"transition": np.ascontiguousarray(np.swapaxes(r.transition, 1, 2))}


def stepless(r: Recursion) -> dict[str, np.ndarray]:
    """No prediction over an eighth of the steps: a single step gets shorter with the grid, and so does its effect."""
    n, predict = r.states, r.predict.copy()
    predict[len(predict) // 2 :][: len(predict) // 8] = len(r.transition)
    more = {"transition": np.eye(n)[None], "noise": np.zeros((1, n, n))}
    return {"predict": predict, **{name: np.concatenate([getattr(r, name), part]) for name, part in more.items()}}


def blind(r: Recursion) -> dict[str, np.ndarray]:
    return {"rows": 0.9 * r.rows}


@pytest.mark.parametrize("integration", [Integration(substeps=1), Integration()], ids=["one step", "as needed"])
@pytest.mark.parametrize("spoil", [noisier, transposed, stepless, blind])
def test_a_recursion_spoilt_on_purpose_disagrees(spoil, integration, monkeypatch):
    """Every number of the engine comes from a Recursion, of the judge none."""
    problem = dataclasses.replace(given(seed=4)[0], edges=np.linspace(0, 2, 41), integration=integration)
    schedule = Schedule(problem.edges, np.eye(3)[np.arange(40) // 10 % 3], tuple(problem.sensors.names))
    assert oc.certify(problem, schedule).status is Status.FEASIBLE
    known: list[np.ndarray] = []
    made = Recursion.__post_init__

    def spoilt(self: Recursion) -> None:
        made(self)
        for name, array in spoil(self).items():
            before = getattr(self, name)
            if not any(before is each for each in known):  # a copy of a spoilt one is not spoilt twice
                object.__setattr__(self, name, array)
                known.append(array)

    monkeypatch.setattr(Recursion, "__post_init__", spoilt)
    found = oc.certify(problem, schedule)
    assert found.status is Status.DISAGREES, found.message


# ---- bounds


def told(monkeypatch: pytest.MonkeyPatch, *bounds: float, error: float = 0.0) -> None:
    """Let the integration state these bounds, one policy after the other, and this error, as a share of the cost."""
    honest, left = certificate.reintegrate, list(bounds)

    def stated(problem, schedule):
        check = honest(problem, schedule)
        return dataclasses.replace(check, lower_bound=left.pop(0), error=error * check.cost)

    monkeypatch.setattr(certificate, "reintegrate", stated)


def test_the_better_bound_of_two_policies_counts_and_none_is_below_zero(monkeypatch):
    problem, schedule = given()
    relaxed = random_policy(problem, np.random.default_rng(0))
    for first, second in ((0.3, 0.6), (0.6, 0.3)):
        told(monkeypatch, first, second)
        assert judge(problem, schedule.weights, 1.0, relaxed, error=1.0).lower_bound == 0.6
        monkeypatch.undo()
    told(monkeypatch, -0.5)
    assert judge(problem, schedule.weights, 1.0, error=1.0).lower_bound == 0.0


def test_a_bound_above_the_cost_disagrees_beyond_what_the_integration_states(monkeypatch):
    problem, schedule = given()
    true = judge(problem, schedule.weights, 1.0, error=1.0).continuous.cost
    told(monkeypatch, 1.001 * true)
    judged = judge(problem, schedule.weights, true, error=0.0)
    assert not judged.agrees and "lies above the cost" in judged.text
    monkeypatch.undo()
    told(monkeypatch, 1.001 * true, error=0.002)
    judged = judge(problem, schedule.weights, true, error=0.0)
    assert judged.agrees and judged.certificate.lower_bound == judged.certificate.cost


# ---- certify


def test_sensors_in_another_order_are_the_same_schedule():
    problem, schedule = given()
    turned = Schedule(schedule.edges, schedule.weights[:, [2, 0, 1]], tuple(schedule.names[j] for j in (2, 0, 1)))
    wrong = Schedule(schedule.edges, schedule.weights[:, [2, 0, 1]], schedule.names)
    costs = [oc.certify(problem, each).cost for each in (schedule, turned, wrong)]
    assert costs[1] == costs[0] and abs(costs[2] - costs[0]) > 1e-3 * costs[0]
    _, weights = certify.on_common_grid(problem, turned)
    np.testing.assert_array_equal(weights, schedule.weights)


def test_what_measuring_costs_is_told_even_where_it_does_not_count():
    problem, schedule = given()
    rates = np.array([s.cost.at(0.0)[0, 0] for s in problem.sensors])
    expected = float(np.sum(schedule.weights @ rates * np.diff(problem.edges)))
    assert expected > 0.1
    for alpha in (0.0, 0.3, 2.0):
        found = oc.certify(dataclasses.replace(problem, cost_weight=alpha), schedule)
        assert found.result["observation_cost"] == pytest.approx(expected, rel=1e-9)


def test_the_parts_of_the_cost_are_its_parts():
    problem, schedule = given(running=True)
    r = oc.certify(problem, schedule).result
    assert r["running_cost"] > 0.1 * r["cost"]
    assert 0.3 * r["observation_cost"] + r["running_cost"] + r["prediction_error"] == pytest.approx(r["cost"], rel=1e-9)
    later = prediction_weight(problem)[1]
    assert later > 0
    assert r["predicted_mean_square_error"] == pytest.approx(r["prediction_error"] + later, rel=1e-12)


def test_a_bound_above_the_relaxed_optimum_is_refuted_though_the_schedule_costs_more():
    problem, schedule = given()
    best = oc.solve(problem, oc.Relaxed(relative_gap=1e-6)).cost
    mine = oc.certify(problem, schedule)
    assert mine.cost > 1.01 * best
    claims = dataclasses.replace(claims_of(mine), lower_bound=best * 1.005, relative_gap=None)
    found = certify.certify(problem, schedule, claims)
    assert found.status is Status.DISAGREES and "is not one: a known policy costs" in found.message
    assert certify.certify(problem, schedule, claims_of(mine)).status is mine.status


PARTS = ["observation_cost", "running_cost", "prediction_error", "predicted_mean_square_error"]


@pytest.mark.parametrize("part", PARTS)
def test_a_stated_part_that_is_false_is_refuted(part):
    problem, schedule = given(running=True)
    mine = oc.certify(problem, schedule)
    claims = claims_of(mine)
    false = Claims(parts={part: claims.parts[part] * 1.01})
    found = certify.certify(problem, schedule, false)
    assert found.status is Status.DISAGREES and f"the stated {part.replace('_', ' ')} is" in found.message


def test_certify_refuses_two_sensors_at_a_time():
    problem, schedule = given()
    with pytest.raises(ProblemError, match="select is 1"):
        oc.certify(problem, Schedule(schedule.edges, np.ones((6, 3)), schedule.names))


def test_what_the_reader_of_schedules_overlooks_is_refused_by_the_set_itself(monkeypatch):
    problem, _ = given(windows=True)
    monkeypatch.setattr(certify, "as_read", lambda schedule, problem: schedule)
    outside = Schedule(problem.edges, np.eye(3)[[0, 1, 2, 2, 0, 1]], tuple(problem.sensors.names))
    with pytest.raises(ProblemError, match="sensor 's0' has weight 1, but is not available"):
        oc.certify(problem, outside)


def test_the_relaxations_bound_is_handed_on_to_the_proof(monkeypatch):
    problem, schedule = given()
    real, told_bounds = assembly.prove, []
    monkeypatch.setattr(assembly, "prove", lambda p, a, known: (told_bounds.append(known), real(p, a, known))[1])
    found = oc.certify(problem, schedule)
    (known,) = told_bounds
    assert 0.99 * found.certificate.lower_bound < known == found.result["relaxed_lower_bound"]


# ---- the status


def test_a_proof_on_the_grid_alone_is_not_called_certified(monkeypatch):
    """Where the check in continuous time does not finish, and where rounding is larger than the target."""
    problem = random_problem(3)
    assert oc.solve(problem, oc.Relaxed(relative_gap=1e-3)).status is Status.CERTIFIED
    real = assembly.prove

    def rough(policies, allowed, known):
        proof = real(policies, allowed, known)
        wide = dataclasses.replace(proof.certificate, lower_bound=0.5 * proof.certificate.cost)
        return dataclasses.replace(proof, certificate=wide, allowance=0.5 * wide.cost)

    monkeypatch.setattr(assembly, "prove", rough)
    found = oc.solve(problem, oc.Relaxed(relative_gap=1e-3))
    assert found.status is Status.FEASIBLE and "Rounding alone may move cost and bound by" in found.message


def test_a_cost_that_is_not_the_sum_of_its_parts_disagrees(monkeypatch):
    problem, schedule = given()
    real = assembly.parts_of

    def wrong(integrator, found):
        parts = real(integrator, found)
        return dataclasses.replace(parts, prediction=0.8 * parts.prediction)

    monkeypatch.setattr(assembly, "parts_of", wrong)
    found = oc.certify(problem, schedule)
    assert found.status is Status.DISAGREES and "its cost is not the sum of its parts" in found.message


def walks(names: str) -> Solution:
    """Random walks, each seen by a sensor of its own."""
    n = len(names)
    plant = LinearPlant(np.zeros((n, n)), 0.2 * np.eye(n), np.eye(n))
    sensors = [Sensor(name, np.eye(n)[[j]], [[0.1]]) for j, name in enumerate(names)]
    problem = SchedulingProblem("walks", plant, sensors, np.linspace(0, 2, 41), np.eye(n))
    return oc.solve(problem, oc.RelaxRoundPolish(relative_gap=1e-3))


def test_the_singular_fraction_is_where_the_relaxed_optimum_shares():
    """Two equal walks: only at the end do both sensors share, as what is seen early is forgotten to nobody."""
    found = walks("ab")
    shares = found.arrays["relaxed_weights"]
    mixed = np.mean(np.all((shares > 0.05) & (shares < 0.95), axis=1))
    assert mixed > 0.6
    assert found.result["singular_fraction"] == pytest.approx(mixed, abs=0.1)
    assert f"singular on {100 * found.result['singular_fraction']:.3g} % of the horizon" in found.message
    assert walks("a").result["singular_fraction"] == 0.0
