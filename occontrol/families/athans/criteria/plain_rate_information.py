"""The independent check of continuous sensing without a prior: one least-squares problem by other rules.

Phi is integrated by Runge-Kutta steps, every stretch between edges and kinks is summed by Clenshaw and Curtis's rule,
finer and finer, and the covariance of what all whitened rows together determine is taken by their singular values.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.integrate import solve_ivp

from occontrol.core.errors import SolveFailed
from occontrol.families.athans.criteria.plain import plain_value
from occontrol.families.athans.criteria.plain_information import LOST
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.readings.plain import PlainCost

DEGREES = (8, 16, 32, 64)  # of the rule on a stretch
SETTLED = 1e-10  # of the cost
DIGITS = 1e-12  # of the steps of Phi


def plain_rate_cost(problem: SchedulingProblem, weights: np.ndarray) -> PlainCost:
    """Cost of a policy of continuous sensing without a prior; a share v of a sensor has the intensity Theta/v.

    Parameters
    ----------
    problem : without a prior and without plant noise, N intervals and M sensors
    weights : (N, M) policy

    Raises SolveFailed where the plant cannot be integrated.
    """
    found = None
    for degree in DEGREES:
        before, found = found, _by_rule(problem, weights, degree)
        if before is not None and abs(found.cost - before.cost) <= SETTLED * (abs(found.cost) + found.observation):
            break
    assert found is not None
    return found


def _by_rule(problem: SchedulingProblem, weights: np.ndarray, degree: int) -> PlainCost:
    edges, n = problem.edges, problem.states
    across = np.eye(n)[:, problem.unknown]
    kinks = [signal.breaks(edges[0], edges[-1]) for signal in problem.signals.values()]
    kinks = np.unique(np.concatenate([np.empty(0), *kinks]))
    x, rule = clenshaw_curtis(degree)
    rows, observation = [np.zeros((across.shape[1], across.shape[1]))], 0.0
    for k in range(problem.intervals):
        inner = kinks[(kinks > edges[k]) & (kinks < edges[k + 1])]
        cuts = np.concatenate([edges[k : k + 1], inner, edges[k + 1 : k + 2]])
        for a, b in itertools.pairwise(cuts):
            times = a + (b - a) * x
            states = _through(problem, a, b, times, across)
            # jumps are at the ends: look a little inside
            inside = np.clip(times, a + 1e-12 * (b - a), b - 1e-12 * (b - a))
            for j in np.flatnonzero(weights[k] > 0):
                sensor, v = problem.sensors[j], weights[k, j] * (b - a) * rule
                observation += float(v @ sensor.cost.sample(inside)[:, 0, 0])
                for i, t in enumerate(inside) if sensor.rows else ():
                    theta = sensor.noise.at(t)
                    lower = np.linalg.cholesky((theta + theta.T) / 2)
                    rows.append(np.sqrt(v[i]) * np.linalg.solve(lower, sensor.C.at(t) @ states[i]))
            across = states[-1]
    at = float(problem.predict_at or edges[-1])
    if at > edges[-1]:
        across = _through(problem, edges[-1], at, np.array([at]), across)[-1]
    H = np.vstack(rows)
    scale = np.linalg.norm(H, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    _, sizes, basis = np.linalg.svd(H / scale, full_matrices=False)
    kept = sizes > LOST * sizes[0]
    Z = (problem.output.at(at) @ across / scale) @ basis[kept].T / sizes[kept]
    X = Z @ Z.T
    prediction = float(np.trace(X))
    value = prediction if problem.criterion is None else plain_value(problem.criterion, X)
    observation *= problem.cost_weight
    return PlainCost(observation + value, observation, 0.0, prediction, value)


def _through(problem: SchedulingProblem, a: float, b: float, times: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(T, n, d) Phi(t, a) start at the `times`."""
    def rate(t: float, x: np.ndarray) -> np.ndarray:
        inside = min(max(t, a + 1e-12 * (b - a)), b - 1e-12 * (b - a))
        return (problem.plant.A.at(inside) @ x.reshape(start.shape)).ravel()

    size = max(float(np.max(np.abs(start))), 1e-300)
    found = solve_ivp(rate, (a, b), start.ravel(), method="DOP853", t_eval=times, rtol=DIGITS, atol=1e-15 * size)
    if not found.success:
        raise SolveFailed(f"the plant cannot be integrated from {a:g} to {b:g}: {found.message}")
    return found.y.T.reshape(len(times), *start.shape)


def clenshaw_curtis(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (degree+1,) on [0, 1] and weights of Clenshaw and Curtis's rule (1960), all positive.

    Parameters
    ----------
    degree : even
    """
    theta = np.pi * np.arange(degree + 1) / degree
    weights = np.empty(degree + 1)
    j = np.arange(1, degree // 2 + 1)
    b = np.where(j == degree // 2, 1.0, 2.0)
    for i, angle in enumerate(theta):
        total = 1.0 - float(np.sum(b / (4.0 * j**2 - 1) * np.cos(2 * j * angle)))
        weights[i] = (1.0 if i in (0, degree) else 2.0) / degree * total
    return (1 - np.cos(theta)) / 2, weights / 2
