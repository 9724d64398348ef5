"""Steps of integration apart from decisions: error estimate, extrapolation, gradients, invariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import occontrol
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor
from occontrol.core.signal import TableSignal
from occontrol.core.solution import Status
from occontrol.families.athans.certificate import judge
from occontrol.families.athans.continuous.reintegration import reintegrate
from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.families.athans.integration.features import features, samples
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.integration.local_error import step_errors
from occontrol.families.athans.integration.mesh import Mesh
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.integration.priced import Judged
from occontrol.families.athans.integration.refine import _shared, relax_and_refine
from occontrol.families.athans.integration.relaxed import interval_loss
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.random_problems import random_policy, random_problem

SEEDS = range(4)


def accurate(seed: int, **features: bool) -> SchedulingProblem:
    problem = random_problem(seed, **features)
    return replace(problem, integration=Integration())


def flow_cost(problem: SchedulingProblem, weights: np.ndarray) -> float:
    return reintegrate(problem, Schedule(problem.edges, weights, tuple(problem.sensors.names))).cost


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", [{}, {"running": True}, {"varying": True}, {"select": 2}])
def test_the_local_errors_are_the_error(seed: int, kind: dict) -> None:
    problem = accurate(seed, **kind)
    integrator, v = Integrator(problem), random_policy(problem, np.random.default_rng(seed))
    fine = Mesh.coarsest(problem, 1).halved().halved().halved()
    on = integrator.extrapolated(fine)
    J, _ = on.cost_and_gradient(v)
    error = on.whole.cost(v) - flow_cost(problem, v)
    estimate = 4 / 3 * float(np.sum(step_errors(on.whole, on.half, v)))
    # e is two halves minus one step: the error with the other sign
    assert -estimate == pytest.approx(error, rel=0.1)
    assert abs(J - flow_cost(problem, v)) < 0.12 * abs(error)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_gradient_on_the_decisions_is_that_of_the_cost(seed: int) -> None:
    problem = accurate(seed, running=seed % 2 == 0, varying=seed > 1)
    rng = np.random.default_rng(seed)
    v, w = random_policy(problem, rng), random_policy(problem, rng)
    v = (v + w) / 2  # with room to both sides
    integrator = Integrator(problem)
    on, J, g = integrator.refined(v, integrator.first)
    step = 1e-5
    difference = (on.cost(v + step * (w - v)) - on.cost(v - step * (w - v))) / (2 * step)
    assert float(np.vdot(g, w - v)) == pytest.approx(difference, rel=1e-6, abs=1e-9 * J)


@pytest.mark.parametrize("seed", SEEDS)
def test_corrected_prices_make_the_gradients_equal(seed: int) -> None:
    problem = accurate(seed)
    v = random_policy(problem, np.random.default_rng(seed))
    integrator = Integrator(problem)
    on, _, g = integrator.refined(v, integrator.first)
    priced = Judged(on, integrator.recursion).repriced(v)
    assert np.allclose(priced.cost_and_gradient(v)[1], g, rtol=1e-10, atol=1e-12 * np.max(np.abs(g)))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", [{}, {"running": True}, {"varying": True, "idle": True}, {"windows": True}])
def test_a_solution_costs_in_continuous_time_what_it_says(seed: int, kind: dict) -> None:
    solution = occontrol.solve(accurate(seed, **kind))
    continuous = solution.result["continuous"]
    assert abs(solution.cost - continuous["cost"]) <= 1e-5 * abs(solution.cost)
    assert solution.result["relaxed_cost"] - solution.result["relaxed_lower_bound"] <= 1.01e-4 * abs(solution.cost)
    assert continuous["lower_bound"] <= continuous["cost"] * (1 + 1e-9)
    again = occontrol.certify(solution.problem, solution.schedule)
    assert again.cost == pytest.approx(solution.cost, rel=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_refining_the_steps_moves_the_cost_towards_the_flow(seed: int) -> None:
    problem = random_problem(seed, running=seed % 2 == 0)
    v = random_policy(problem, np.random.default_rng(seed))
    right = flow_cost(problem, v)
    off = []
    for count in (1, 3, 9, 27):
        stepped = replace(problem, integration=Integration(substeps=count, windows="cover"))
        found = Integrator(stepped).evaluate(v)
        assert found.steps == count * problem.intervals
        off.append(abs(found.cost - right))
        if count > 1:
            assert found.error == pytest.approx(off[-1], rel=0.3)
    assert off[1] < off[0] / 5 and off[2] < off[1] / 5 and off[3] < off[2] / 5


def test_one_substep_is_the_first_edition_exactly() -> None:
    problem = random_problem(3, running=True)
    v = random_policy(problem, np.random.default_rng(3))
    assert Integrator(problem).evaluate(v).cost == Sweep(discretise(problem)).cost(v)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_time_origin_changes_nothing(seed: int) -> None:
    # (an edge that is added for accuracy is a double, too: on the other clock it moves by 2e-7)
    problem = replace(accurate(seed, running=seed % 2 == 0), integration=Integration(refine=False))
    edges = np.round(problem.edges * 64) / 64  # times that both clocks can say
    here = replace(problem, edges=edges, predict_at=float(edges[-1]) + 0.25)
    there = replace(here, edges=edges + 1.7e9, predict_at=here.predict_at + 1.7e9)
    one, other = occontrol.solve(here), occontrol.solve(there)
    for name in ("cost", "relaxed_cost", "lower_bound"):
        assert other.result[name] == pytest.approx(one.result[name], rel=1e-9), name
    assert other.result["continuous"]["lower_bound"] == pytest.approx(one.result["continuous"]["lower_bound"], rel=1e-8)
    assert np.array_equal(one.arrays["weights"], other.arrays["weights"])


@pytest.mark.parametrize("unit", [1e-9, 1e9])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_unit_of_time_changes_nothing(seed: int, unit: float) -> None:
    problem = accurate(seed, running=True)
    plant = problem.plant
    scaled = replace(
        problem,
        edges=problem.edges * unit,
        predict_at=problem.predict_at * unit,
        plant=LinearPlant(plant.A.at(0.0) / unit, plant.noise.at(0.0) / unit, plant.covariance),
        sensors=[Sensor(s.name, s.C, s.noise.at(0.0) * unit, s.cost.at(0.0) / unit) for s in problem.sensors],
        running=problem.running.at(0.0) / unit,
    )
    one, other = occontrol.solve(problem), occontrol.solve(scaled)
    assert other.cost == pytest.approx(one.cost, rel=1e-9)
    assert other.result["continuous"]["cost"] == pytest.approx(one.result["continuous"]["cost"], rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_interval_cut_in_two_with_one_decision(seed: int) -> None:
    problem = accurate(seed, varying=True)
    v = random_policy(problem, np.random.default_rng(seed))
    middle = float(problem.midpoints[2])
    cut = problem.with_edges([(middle, "for a test")])
    assert cut.added_edges == ((middle, "for a test"),) and cut.intervals == problem.intervals + 1
    whole, parts = Integrator(problem).evaluate(v), Integrator(cut).evaluate(np.insert(v, 2, v[2], axis=0))
    assert parts.cost == pytest.approx(whole.cost, rel=2e-5)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_bound_exceeds_the_cost_on_a_coarser_grid(seed: int) -> None:
    coarse = accurate(seed, idle=True)
    fine = replace(coarse, edges=np.sort(np.concatenate([coarse.edges, coarse.midpoints])))
    one, other = occontrol.solve(coarse).result, occontrol.solve(fine).result
    assert other["continuous"]["lower_bound"] <= one["continuous"]["cost"] * (1 + 1e-9)
    assert one["continuous"]["lower_bound"] <= other["continuous"]["cost"] * (1 + 1e-9)


def test_what_one_choice_an_interval_loses_is_what_the_continuous_bound_lacks() -> None:
    problem = replace(accurate(2), edges=np.linspace(0, 3, 5))
    integrator, sweep = relax_and_refine(problem, RelaxedOptions(1e-5), occontrol.Monitor(), refine=False)
    on, v = sweep.on, sweep.outcome.weights
    on.cost_and_gradient(v)
    loss = float(np.sum(interval_loss(on, feasible_set(problem))))
    judged = judge(problem, v, sweep.outcome.cost, None, 0.0)
    own = sweep.outcome.cost - sweep.outcome.lower_bound
    assert judged.continuous.cost - judged.lower_bound == pytest.approx(loss + own, rel=0.1, abs=1e-5)
    assert integrator.problem is problem


def test_a_jump_of_a_held_table_becomes_an_edge() -> None:
    values = np.array([0.1, 3.0, 3.0])[:, None, None] * np.eye(3)
    times = np.array([0.0, 1.234, 2.0])
    problem = replace(accurate(1), running=TableSignal(times, values, "previous"))
    assert problem.added_edges == ((1.234, "jump of objective.running"),)
    fixed = replace(accurate(1), running=TableSignal(times, values, "previous"), integration=Integration(substeps=2))
    assert fixed.added_edges == ()


def test_a_formula_is_followed_down_to_its_pulse() -> None:
    from occontrol.core.signal import as_signal

    pulse = as_signal("0.01+1e4*exp(-((t-5.3)/0.003)**2)")
    times, values = samples(pulse, 0.0, 10.0)
    assert np.max(values) == pytest.approx(1e4, rel=1e-3) and len(times) < 600
    assert 5.25 < features(pulse, 0.0, 10.0)[0] < 5.3 < features(pulse, 0.0, 10.0)[-1] < 5.35
    assert len(features(as_signal("sin(t)"), 0.0, 10.0)) == 0


def test_options_are_refused_in_words() -> None:
    for options, words in (
        (Integration(accuracy=0.0), "horizon.accuracy is 0"),
        (Integration(substeps=0), "horizon.substeps is 0, it must be at least 1"),
        (Integration(substeps=2, accuracy=1e-4), "both 'substeps' and 'accuracy'"),
        (Integration(windows="none"), "horizon.windows is 'none'"),
    ):
        with pytest.raises(occontrol.ProblemError, match=words):
            replace(random_problem(0), integration=options)


def test_the_exact_model_is_the_matched_filter_where_steps_are_many() -> None:
    from occontrol.families.athans.filter.consistency import expected_nees
    from occontrol.families.athans.filter.planned import default_model

    unrefined = Integration(refine=False)
    solution = occontrol.solve(replace(accurate(0), edges=np.linspace(0, 4, 5), predict_at=4.3, integration=unrefined))
    assert default_model(solution.result) == "exact" and solution.arrays["filter_covariance"].shape == (5, 3, 3)
    assert solution.arrays["gain"].shape[:2] == (4, 3)
    assert expected_nees(solution.problem, solution.schedule, "exact") == pytest.approx(1.0, abs=1e-8)
    assert np.max(np.abs(expected_nees(solution.problem, solution.schedule, "split") - 1)) > 0.01
    plain = occontrol.solve(random_problem(0))
    assert default_model(plain.result) == "split" and "filter_covariance" not in plain.arrays


def test_a_share_that_the_clock_does_not_resolve_gets_no_edge_of_its_own() -> None:
    """Edges that fall together would leave fewer intervals than pieces of the policy."""
    problem = random_problem(1, intervals=4)
    problem = replace(problem, edges=1.7e9 + 1e-3 * np.arange(5), predict_at=None)
    weights = np.eye(3)[[0, 0, 1, 2]]
    weights[1], weights[2] = [0.9999, 0.0001, 0.0], [0.0, 0.7, 0.3]  # 1e-7 and 3e-4 of time; a double resolves 2.4e-7
    outcome = RelaxedOutcome(weights, 1.0, 0.0, np.ones((4, 3)), 1, Status.CERTIFIED)
    extra, pieces = _shared(problem, outcome, 10)
    assert len(extra) == 1 and len(pieces) == 5
    finer = problem.with_edges([(float(t), "") for t in extra])
    assert len(finer.edges) == len(pieces) + 1
    assert finer.steps @ pieces == pytest.approx(problem.steps @ weights, rel=1e-3)
