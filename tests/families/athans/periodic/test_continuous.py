"""Continuous plants for ever: what holds whenever sensors change, and how fast time sharing comes there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import family_of
from occontrol.families.athans.periodic.check import plain_cycle
from occontrol.families.athans.periodic.prove import averaged_of, setting_of
from occontrol.scheduling.periodic.potential import cycle_of
from tests.families.athans.periodic.test_periodic import RADARS, problem_of

ONE = RADARS.replace("  - {name: doppler, C: [[0, 1]], noise: [[0.4]], cost: 0.2}\n  - idle\n", "")
A, XI = np.array([[0.0, 1], [-1, -0.4]]), np.diag([0.05, 0.5])


@pytest.mark.parametrize("sensing", ["rate", "samples"])
def test_one_sensor_for_ever_is_the_riccati_equation_of_another_program(sensing: str, tmp_path: Path) -> None:
    control = pytest.importorskip("control")
    problem = problem_of(ONE.replace("step: 0.5}", f"step: 0.5}}\nsensing: {sensing}"), tmp_path)
    solution = oc.solve(problem)
    if sensing == "rate":
        S = control.care(A.T, np.array([[1.0], [0.0]]), XI, np.array([[0.1]]))[0]
        assert solution.cost == pytest.approx(np.trace(S) + 0.5 * 0.6, rel=1e-9)
        assert solution.numbers.bounds["averaged"] == pytest.approx(solution.cost, rel=1e-9)
    else:
        sampled = control.c2d(control.ss(A, np.eye(2), np.array([[1.0, 0.0]]), np.zeros((1, 2))), 0.5)
        nodes, weights = np.polynomial.legendre.leggauss(12)
        at = [control.c2d(control.ss(A, np.eye(2), np.eye(2), np.zeros((2, 2))), 0.25 * (1 + x)).A for x in nodes]
        Q = sum(0.25 * w * F @ XI @ F.T for F, w in zip(at, weights, strict=True))
        prior = control.dare(sampled.A.T, np.array([[1.0], [0.0]]), Q, np.array([[0.1]]))[0]
        assert solution.arrays["prior_covariance"][0] == pytest.approx(prior, rel=1e-9, abs=1e-12)


def test_fast_time_sharing_comes_to_the_averaged_bound_with_the_square_of_the_step(tmp_path: Path) -> None:
    """Prices at which both sensors for half of the time each are the averaged optimum; then sensors in turn."""
    from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

    gains = [np.diag([1 / 0.1, 0.0]), np.diag([0.0, 1 / 0.4])]
    S = solve_continuous_are(A.T, np.sqrt(sum(gains) / 2), XI, np.eye(2))
    P = solve_continuous_lyapunov((A - S @ sum(gains) / 2).T, -np.eye(2))
    worth = [float(np.trace(L @ S @ P @ S)) for L in gains]
    prices = 0.3 + worth[0] - worth[1], 0.3
    assert prices[0] > 0
    limit, far = float(np.trace(S) + sum(prices) / 2), []
    for step in (0.4, 0.2, 0.1, 0.05):
        text = RADARS.replace("  - idle\n", "").replace("step: 0.5", f"step: {step}").replace("cost_weight: 0.5, ", "")
        text = text.replace("cost: 0.6", f"cost: {prices[0]!r}").replace("cost: 0.2", f"cost: {prices[1]!r}")
        problem = problem_of(text, tmp_path)
        setting = setting_of(problem)
        averaged = averaged_of(problem, setting)
        assert averaged.lower_bound == pytest.approx(limit, rel=1e-9) and averaged.lower_bound <= limit * (1 + 1e-12)
        cycle = cycle_of(setting.letters, np.array([0, 1]))
        assert cycle is not None
        far.append(cycle.cost - averaged.lower_bound)
    ratios = np.array(far[:-1]) / np.array(far[1:])
    assert np.all(np.array(far) > 0) and ratios[-1] == pytest.approx(4.0, rel=0.02)


def test_a_schedule_off_the_steps_may_cost_less_than_the_tree_but_not_less_than_the_averaged_bound(
    tmp_path: Path,
) -> None:
    problem = problem_of(RADARS.replace("max_period: 5", "max_nodes: 2000, max_period: 5"), tmp_path)
    solution = oc.solve(problem)
    bounds, fine = solution.numbers.bounds, problem_of(RADARS.replace("step: 0.5", "step: 0.05"), tmp_path)
    setting, costs = setting_of(fine), []
    root = setting.root
    for word in ([0, 1, 2], [0, 1, 1, 2], [0] * 3 + [1] * 4 + [2] * 2, [0, 1]):
        cycle = cycle_of(setting.letters, np.array(word))
        assert cycle is not None
        costs.append(plain_cycle(fine, np.array(word), root @ cycle.priors[0] @ root.T).cost)
    assert bounds["averaged"] <= min(costs) < bounds["tree"] <= solution.cost
    lines = dict(family_of(problem).summarise(problem, solution))
    assert "for schedules that change at multiples of 0.5" in lines["lower bound"]
    assert "whenever it switches" in lines["continuous"]
