"""Three routes to the same number: the compiled recursion, collocation by Ipopt, and adaptive re-integration."""

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.core.solution import Status
from occontrol.families.athans.collocation.solve import solve_collocation
from occontrol.families.athans.continuous.reintegration import reintegrate
from occontrol.families.athans.discretise import discretise, feasible_set, half_predicts
from occontrol.families.athans.methods import Collocation
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep


def coupled_oscillators(intervals, masses=3, sensors=4, prior=5.0):
    """A chain of masses between walls, positions measured (and the first speed), one at a time."""
    n, eye = 2 * masses, np.eye(masses)
    stiffness = 2 * eye - np.eye(masses, k=1) - np.eye(masses, k=-1)
    A = np.block([[np.zeros((masses, masses)), eye], [-stiffness, -0.1 * eye]])
    noise = np.diag([0.0] * masses + [0.3] * masses)
    suite = [Sensor(f"s{j}", np.eye(n)[j : j + 1], [[0.1]], cost=0.2 + 0.3 * j) for j in range(sensors)]
    edges = np.linspace(0, 6, intervals + 1)
    return SchedulingProblem(
        "oscillators",
        LinearPlant(A, noise, prior * np.eye(n)),
        suite,
        edges,
        np.eye(n)[:1],
        cost_weight=0.1,
        predict_at=7.0,
    )


def varying(intervals):
    plant = LinearPlant([[0, 1], ["-(1+0.2*sin(t))", -0.4]], [["0.05*exp(-t)", 0], [0, 0.5]], np.diag([5.0, 5.0]))
    sensors = [
        Sensor("range", [["1+0.2*cos(t)", 0]], [[0.1]], cost=0.6, windows=[(0, 2), (2.5, 4)]),
        Sensor("doppler", [[0, 1]], [["0.4+0.1*t"]], cost="0.3+0.1*t"),
        idle_sensor(2),
    ]
    return SchedulingProblem(
        "varying", plant, sensors, np.linspace(0, 4, intervals + 1), [[1, 0]], cost_weight=0.1, predict_at=4.5
    )


def relaxed_weights(problem, gap=1e-6):
    sweep = Sweep(discretise(problem, half_predicts(problem)))
    return minimise_relaxed(sweep, feasible_set(problem), None, RelaxedOptions(gap, 5000), Monitor()).weights


def routes(problem):
    """Continuous costs of both optima, and the collocation's own number."""
    names = tuple(problem.sensors.names)
    one = reintegrate(problem, Schedule(problem.edges, relaxed_weights(problem), names))
    found = solve_collocation(problem, Collocation())
    assert found.status is Status.FEASIBLE, found.message
    two = reintegrate(problem, Schedule(problem.edges, found.weights, names))
    return one, two, found


def agree(problem):
    one, two, found = routes(problem)
    assert one.cost == pytest.approx(two.cost, rel=1e-4)
    assert found.cost == pytest.approx(two.cost, rel=3e-5)
    # neither is below what the other proves
    assert max(one.lower_bound, two.lower_bound) <= min(one.cost, two.cost)
    # the comparison is not an empty one: a constant policy is clearly worse
    uniform = problem.upper / problem.upper.sum(axis=1, keepdims=True) * problem.select
    names = tuple(problem.sensors.names)
    assert reintegrate(problem, Schedule(problem.edges, uniform, names)).cost > 1.02 * one.cost


@pytest.mark.parametrize("scheme", ["radau", "legendre"])
def test_scalar_on_off_all_three_routes(scheme):
    plant = LinearPlant([[0.0]], [[1.0]], [[1.0]])
    sensors = [Sensor("on", [[1.0]], [[1.0]], cost=1.0), idle_sensor(1)]
    problem = SchedulingProblem("on or off", plant, sensors, np.linspace(0, 5, 101), [[1.0]], cost_weight=0.1)
    one, two, found = routes(problem)
    for cost in (one.cost, two.cost, found.cost):
        assert cost == pytest.approx(1.2122712, rel=1e-4)
    assert one.lower_bound <= 1.2122712 * (1 + 1e-7)


def test_varying_data_with_windows():
    agree(varying(40))


def test_large_prior():
    agree(coupled_oscillators(24, masses=1, sensors=2, prior=250.0))


@pytest.mark.slow
def test_coupled_oscillators_with_six_states():
    agree(coupled_oscillators(36))


def test_recursion_is_second_order_against_the_reintegration():
    """The recursion's cost of one policy approaches the re-integrated cost with the square of the step."""
    coarse = varying(8)
    weights = np.random.default_rng(5).dirichlet(np.ones(3), size=8)
    weights[coarse.upper[:, 0] == 0] = [0.0, 0.5, 0.5]
    exact = reintegrate(coarse, Schedule(coarse.edges, weights, tuple(coarse.sensors.names))).cost
    errors = []
    for factor in (4, 8, 16):
        fine = varying(8 * factor)
        sweep = Sweep(discretise(fine, half_predicts(fine)))
        errors.append(sweep.cost(np.repeat(weights, factor, axis=0)) - exact)
    order = np.log2(np.abs(np.array(errors[:-1]) / np.array(errors[1:])))
    assert np.all(np.abs(order - 2) < 0.15), (errors, order)
