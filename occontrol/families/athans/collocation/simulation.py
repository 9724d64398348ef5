"""The covariance along a policy by SciPy's adaptive integrators, for the start and the mesh of the collocation.

Every interval is integrated in the covariance (packed triangle) or, where a large covariance meets a sharp sensor, in
the information matrix, whichever is less stiff there. Nothing is shared with the recursion or the re-integration.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from occontrol.families.athans.hamiltonian import information_rates
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.linalg import unvech, vech

STIFF = 30.0


class Data:
    """The matrices of a problem at times inside one interval."""

    def __init__(self, problem: SchedulingProblem):
        self.problem, self.n = problem, problem.states
        plant = problem.plant
        signals = [plant.A, plant.noise, *[x for s in problem.sensors for x in (s.C, s.noise)]]
        ends = float(problem.edges[0]), float(problem.edges[-1])
        self._kinks = [np.union1d(plant.A.breaks(*ends), plant.noise.breaks(*ends))]
        self._kinks += [np.union1d(s.C.breaks(*ends), s.noise.breaks(*ends)) for s in problem.sensors]
        self._fixed = self._rates(np.zeros(1))[0] if all(s.constant for s in signals[2:]) else None
        self._plant = (plant.A.at(0.0), plant.noise.at(0.0)) if all(s.constant for s in signals[:2]) else None

    def _rates(self, times: np.ndarray) -> np.ndarray:
        parts = [information_rates(s.C.sample(times), s.noise.sample(times)) for s in self.problem.sensors]
        return np.stack(parts, axis=1)

    def plant(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """A and Xi at t."""
        return self._plant or (self.problem.plant.A.at(t), self.problem.plant.noise.at(t))

    def kinks(self, start: float, end: float, weights: np.ndarray) -> np.ndarray:
        """Times strictly inside (start, end) at which what matters under these weights has a kink or a jump.

        `weights` (M,).
        """
        used = [self._kinks[0], *[self._kinks[1 + j] for j in np.flatnonzero(weights)]]
        slack = 1e-9 * (end - start)
        inside = [x[np.searchsorted(x, start + slack) : np.searchsorted(x, end - slack)] for x in used]
        return np.unique(np.concatenate(inside))

    def information(self, t: float, weights: np.ndarray) -> np.ndarray:
        """L(v) (n, n) at t for `weights` v (M,)."""
        if self._fixed is not None:
            return np.tensordot(weights, self._fixed, axes=1)
        total, time = np.zeros((self.n, self.n)), np.array([t])
        for j in np.flatnonzero(weights):
            sensor = self.problem.sensors[j]
            total += weights[j] * information_rates(sensor.C.sample(time), sensor.noise.sample(time))[0]
        return total


def simulate_interval(
    data: Data, start: float, end: float, covariance: np.ndarray, weights: np.ndarray, rtol: float = 1e-8
) -> Callable[[np.ndarray], np.ndarray]:
    """The covariance on one interval under constant weights, as a function of times (K,) -> (K, n, n).

    Integrated from kink to kink of the tables: the steps of an integrator are as long as what it integrates is smooth.
    """
    marks = np.concatenate([[start], data.kinks(start, end, weights), [end]])
    paths = []
    for a, b in itertools.pairwise(marks):
        paths.append(_simulate_smooth(data, a, b, covariance, weights, rtol))
        covariance = paths[-1](np.array([b]))[0]
    if len(paths) == 1:
        return paths[0]

    def path(times: np.ndarray) -> np.ndarray:
        place = np.clip(np.searchsorted(marks, times, side="right") - 1, 0, len(paths) - 1)
        found = np.empty((len(times), data.n, data.n))
        for i in np.unique(place):
            found[place == i] = paths[i](times[place == i])
        return found

    return path


def _simulate_smooth(
    data: Data, start: float, end: float, covariance: np.ndarray, weights: np.ndarray, rtol: float
) -> Callable[[np.ndarray], np.ndarray]:
    A, noise = data.plant(start)
    information = data.information((start + end) / 2, weights)
    forward_rate = (end - start) * float(np.trace(information @ covariance))
    scale = float(np.trace(covariance) + (end - start) * np.trace(noise)) or 1.0
    values = np.linalg.eigvalsh(covariance)
    invertible = values[0] > 1e-11 * values[-1] > 0
    if forward_rate > STIFF and invertible:
        inverse = np.linalg.inv(covariance)
        if (end - start) * float(np.trace(noise @ inverse)) < forward_rate:
            return _by_information(data, start, end, inverse, weights, rtol)

    last = end - 1e-9 * (end - start)  # from inside, because tables may jump at the end

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        t = min(t, last)
        S, (A, noise) = unvech(y), data.plant(t)
        drift = A @ S
        return vech(drift + drift.T + noise - S @ data.information(t, weights) @ S)

    work = forward_rate + (end - start) * np.linalg.norm(A, 2)
    method = "DOP853" if work < STIFF else "Radau"
    first = end - start if work < 1.0 else None  # one step will often do
    limits = {"rtol": rtol, "atol": 1e-11 * scale, "first_step": first}
    done = solve_ivp(rate, (start, end), vech(covariance), method=method, dense_output=True, **limits)
    return lambda times: unvech(np.asarray(done.sol(times)).T.copy())


def _by_information(
    data: Data, start: float, end: float, inverse: np.ndarray, weights: np.ndarray, rtol: float
) -> Callable[[np.ndarray], np.ndarray]:
    last = end - 1e-9 * (end - start)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        t = min(t, last)
        Y, (A, noise) = unvech(y), data.plant(t)
        drift = Y @ A
        return vech(data.information(t, weights) - drift - drift.T - Y @ noise @ Y)

    smallest = rtol * float(np.min(np.diag(inverse)))
    done = solve_ivp(rate, (start, end), vech(inverse), method="Radau", rtol=rtol, atol=smallest, dense_output=True)
    return lambda times: np.linalg.inv(unvech(np.asarray(done.sol(times)).T.copy()))


def terminal_weight(problem: SchedulingProblem) -> np.ndarray:
    """W = Phi(Tp,T)' D'D Phi(Tp,T), Phi by DOP853 with tight tolerances."""
    n, end, later = problem.states, float(problem.edges[-1]), float(problem.predict_at or 0.0)
    phi = np.eye(n)
    if later > end:
        breaks = problem.plant.A.breaks(end, later)
        points = np.unique([end, *breaks[(breaks > end) & (breaks < later)], later])
        for a, b in itertools.pairwise(points):

            def rate(t: float, y: np.ndarray, a: float = a, b: float = b) -> np.ndarray:
                inside = min(max(t, a + 1e-13 * (b - a)), b - 1e-13 * (b - a))
                return (problem.plant.A.at(inside) @ y.reshape(n, n)).ravel()

            phi = solve_ivp(rate, (a, b), phi.ravel(), method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1].reshape(n, n)
    half = problem.output.at(later) @ phi
    return half.T @ half
