"""The trade-off front: monotone, convex, above its bounds, and as good as cold solves."""

from __future__ import annotations

from dataclasses import replace
from decimal import localcontext
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import occontrol
from occontrol.core.errors import ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.core.solution import Status
from occontrol.families.athans.certify import certify
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.tradeoff import tradeoff
from tests.decimal_flow import Flows
from tests.decimal_recursion import Data

PROBLEMS = Path(__file__).resolve().parents[3] / "problems"
ALPHAS = np.geomspace(1e-4, 1e-1, 9)


@pytest.fixture(scope="module")
def attitude():
    problem = occontrol.read_problem(PROBLEMS / "attitude_telemetry.yaml")
    return problem, tradeoff(problem, ALPHAS[::-1])


def tiny():
    plant = LinearPlant([[0, 1], [-1, -0.3]], [[0, 0], [0, 0.4]], [[1.0, 0], [0, 1.0]])
    sensors = [Sensor("near", [[1, 0]], 0.3, 1.0), Sensor("far", [[0, 1]], 0.2, 0.4), idle_sensor(2)]
    return SchedulingProblem("tiny", plant, sensors, np.linspace(0, 3, 8), [[1, 0]], 3.5)


def test_the_front_is_monotone_and_convex(attitude):
    _, front = attitude
    assert front.status is Status.CERTIFIED and np.all(np.diff(front.cost_weights) > 0)
    for policies in (front.schedules, front.relaxed):
        q, e = policies.observation_cost, policies.error
        assert len(np.unique(np.round(q, 9))) >= 6  # a front, not a point
        assert np.all(np.diff(q) <= 1e-12) and np.all(np.diff(e) >= -1e-12)
        keep = np.append(True, np.diff(q) < -1e-9)
        slopes = np.diff(e[keep]) / np.diff(q[keep])
        assert np.all(np.diff(slopes) <= 1e-12)  # steeper towards small observation cost


def test_every_point_lies_above_the_bound_and_close_to_it(attitude):
    _, front = attitude
    for policies in (front.schedules, front.relaxed):
        q, e = policies.observation_cost, policies.error
        np.testing.assert_allclose(policies.cost, front.cost_weights * q + e, rtol=1e-12)
        assert np.all(e >= front.least_error(q) - 1e-12)
    gap = (front.relaxed.cost - front.lower_bound) / front.relaxed.cost
    # the bound is that of all switching times, the relaxation changes at the edges only
    assert front.of == "continuous" and front.as_dict()["of"] == "continuous"
    assert np.all(gap <= 3e-4) and np.all(gap >= -1e-12)
    assert np.all(front.schedules.cost <= 1.01 * front.lower_bound)


@pytest.mark.parametrize("index", range(len(ALPHAS)))
def test_every_point_agrees_with_a_cold_solve(attitude, index):
    problem, front = attitude
    alpha = float(front.cost_weights[index])
    cold = occontrol.solve(replace(problem, cost_weight=alpha), "relaxed")
    assert cold.status is Status.CERTIFIED
    assert abs(front.relaxed.cost[index] - cold.cost) <= 1e-4 * cold.cost
    assert front.lower_bound[index] <= cold.cost and cold.certificate.lower_bound <= front.relaxed.cost[index]


def test_costs_are_those_of_the_weights_it_returns(attitude):
    problem, front = attitude
    for i in (0, 4, 8):
        alpha, names = float(front.cost_weights[i]), tuple(problem.sensors.names)
        schedule = Schedule(problem.edges, front.schedules.weights[i], names)
        judged = certify(replace(problem, cost_weight=alpha), schedule)
        assert judged.result["top"]["of"] == "continuous"
        assert judged.result["top"]["cost"] == pytest.approx(front.schedules.cost[i], rel=1e-9)
        assert judged.result["observation_cost"] == pytest.approx(front.schedules.observation_cost[i], rel=1e-9)
        assert np.all(np.isin(front.schedules.weights[i], (0.0, 1.0)))


def test_no_schedule_at_all_lies_below_the_bound():
    """All 3^7 schedules of a tiny problem, costed by exact flows in 60 digits, against the envelope of the bounds."""
    problem = tiny()
    front = tradeoff(problem, np.geomspace(0.01, 10, 12))
    q, e = all_schedules(problem)
    assert np.all(e >= front.least_error(q) - 1e-9)
    for i, alpha in enumerate(front.cost_weights):
        best = np.min(alpha * q + e)
        assert front.lower_bound[i] <= best + 1e-9 and front.schedules.cost[i] >= best - 1e-9
        assert front.schedules.cost[i] <= 1.001 * best


def all_schedules(problem):
    """Observation cost and error of every schedule of `tiny`, by flows that share no code with the product."""
    plant, ahead = problem.plant, problem.predict_at - problem.edges[-1]
    A = plant.A.at(0.0)
    sensors = [(s.C.at(0.0), s.noise.at(0.0), float(s.cost.at(0.0)[0, 0])) for s in problem.sensors]
    output = problem.output.at(0.0) @ expm(A * ahead)
    flows = Flows(Data(A, plant.noise.at(0.0), plant.covariance, sensors, output, problem.edges, 1.0))
    length = float(problem.steps[0])
    reached = [(flows.start, 0.0)]
    with localcontext() as context:
        context.prec = 60
        for _ in range(problem.intervals):
            reached = [
                (flows.step(S, j, length)[0], q + sensors[j][2] * length)
                for S, q in reached
                for j in range(len(sensors))
            ]
        errors = [float(np.trace(flows.W @ S)) for S, _ in reached]
    return np.array([q for _, q in reached]), np.array(errors)


def test_plain_data_has_every_point_and_its_schedule(attitude):
    problem, front = attitude
    content = front.as_dict()
    assert len(content["points"]) == len(ALPHAS) and content["status"] == "certified"
    point = content["points"][3]
    assert point["schedule"][0]["start"] == 0.0 and point["schedule"][-1]["end"] == problem.edges[-1]
    assert point["predicted_mean_square_error"] > point["error"]
    assert point["relative_gap"] == pytest.approx(1 - point["lower_bound"] / point["cost"])


def test_nothing_to_trade_and_interruption():
    problem = tiny()
    free = replace(problem, sensors=[replace(s, cost=0.0) for s in problem.sensors])
    with pytest.raises(ProblemError, match="nothing to trade"):
        tradeoff(free, [0.1])
    shown = []
    monitor = Monitor(show=shown.append)

    def stop(record):
        if record["stage"].startswith("alpha 1"):
            monitor.interrupted = 2

    monitor.show = stop
    front = tradeoff(problem, [0.1, 1.0, 10.0], monitor)
    assert 1 <= len(front.cost_weights) < 3


def test_a_running_weight_counts_as_error():
    problem = replace(tiny(), running=[[0.3, 0], [0, 0]])
    front = tradeoff(problem, [0.05, 0.5])
    assert np.all(np.diff(front.schedules.error) >= 0)
    weights = front.schedules.weights[0]
    schedule = Schedule(problem.edges, weights, tuple(problem.sensors.names))
    with_running, without = (
        certify(replace(p, cost_weight=0.0), schedule).result["top"]["cost"] for p in (problem, tiny())
    )
    assert front.schedules.error[0] == pytest.approx(with_running, rel=1e-9)
    assert with_running > without
