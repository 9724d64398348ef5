"""`exact` where the steps of integration are ours: its bound against continuous time, and its run judged again."""

import dataclasses

import numpy as np
import pytest

from occontrol.api import certify, family_of, solve
from occontrol.core.plant import LinearPlant
from occontrol.core.printed import rounded_down
from occontrol.core.sensor import Sensor
from occontrol.core.solution import Status
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem


def made(**more) -> SchedulingProblem:
    """A diffuse start on six long intervals, which steps of equal length integrate badly."""
    plant = LinearPlant(A=[[0.0, 1], [-1, -0.4]], noise=np.diag([0, 0.5]), covariance=np.diag([5.0, 5.0]))
    sensors = [Sensor("a", [[1, 0]], [[0.1]], 0.1), Sensor("b", [[0, 1]], [[0.4]], 0.05)]
    running = np.diag([1, 0.1])
    return SchedulingProblem("x", plant, sensors, np.linspace(0, 3, 7), [[1, 0]], running=running, **more)


@pytest.fixture(scope="module")
def found():
    return solve(made(), RelaxRoundPolish(exact=True))


def test_the_pair_at_the_top_holds_for_what_the_schedule_costs_in_continuous_time(found):
    r = found.result
    assert r["proven_optimal"] is True and r["top"]["of"] == "grid"
    # the recursion is off by more than the accuracy asked for, and its own bound lies above the schedule's true cost
    assert r["lower_bound"] > r["continuous"]["cost"] * (1 + 1e-4)
    assert r["top"]["lower_bound"] <= r["continuous"]["cost"]
    assert r["top"]["lower_bound"] >= 0.99 * r["continuous"]["cost"]
    assert f"costs less than {rounded_down(r['top']['lower_bound'], 6)}" in found.message


def test_the_bound_is_below_every_schedule_in_continuous_time(found):
    """All 64 schedules, integrated by an adaptive solver."""
    from itertools import product

    from scipy.integrate import solve_ivp

    problem = made()
    A, Xi, R = problem.plant.A.at(0.0), problem.plant.noise.at(0.0), problem.running.at(0.0)
    C, theta, price = [np.array([[1.0, 0]]), np.array([[0.0, 1]])], [0.1, 0.4], [0.1, 0.05]
    best = np.inf
    for chosen in product([0, 1], repeat=6):
        y = np.append(problem.plant.covariance.ravel(), 0.0)
        for j in chosen:

            def rate(t, y, j=j):
                S = y[:4].reshape(2, 2)
                dS = A @ S + S @ A.T + Xi - S @ C[j].T @ C[j] @ S / theta[j]
                return np.append(dS.ravel(), price[j] + np.sum(R * S))

            y = solve_ivp(rate, (0, 0.5), y, "DOP853", rtol=1e-9, atol=1e-12).y[:, -1]
        best = min(best, y[4] + y[0])
    assert found.result["top"]["lower_bound"] <= best
    assert best == pytest.approx(found.result["continuous"]["cost"], rel=1e-6)


def test_a_run_of_exact_is_not_refuted_by_shares(found):
    problem = made()
    claims = family_of(problem).claims_of(problem, found)
    assert claims.whole
    assert found.result["lower_bound"] > found.result["relaxed_cost"]
    assert certify(problem, found.schedule, claims).status is not Status.DISAGREES
    false = dataclasses.replace(claims, lower_bound=found.cost * 1.01, relative_gap=None)
    again = certify(problem, found.schedule, false)
    assert again.status is Status.DISAGREES and "is not one: a known policy costs" in again.message


def test_stated_steps_are_the_problem():
    solution = solve(made(integration=Integration(substeps=1)), RelaxRoundPolish(exact=True))
    top = solution.result["top"]
    assert top["lower_bound"] == solution.result["lower_bound"] and top["of"] == "grid"
