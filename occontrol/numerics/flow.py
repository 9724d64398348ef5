"""How a nonlinear plant moves over spans of time: the state, the derivative of the map, and the noise on the way.

dx/dt = f(x, t) with noise of intensity Xi(x, t); one substep of length h is two Runge-Kutta steps of order four:

    x_m = step(x_0),   x_1 = step(x_m),   Phi_0 = d x_m/d x_0,   Phi_m = d x_1/d x_m
    F = Phi_m Phi_0,   Q = h/6 (F Xi_0 F' + 4 Phi_m Xi_m Phi_m' + Xi_1)

Phi is the derivative of the Runge-Kutta map itself, so F belongs to the simulated path to rounding; Simpson's rule
keeps Q positive semidefinite whatever h. In discrete time the map is given, F is its derivative and Q its noise.
Source: Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, sections I.14 and II.1.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from occontrol.core.kinds import Casadi, CasadiFunction

Made = TypeVar("Made")


def runge_kutta(right: Callable[[Casadi, Casadi], Casadi], x: Casadi, t: Casadi, h: Casadi | float) -> Casadi:
    """x(t + h) of dx/dt = right(x, t) by one classical Runge-Kutta step of order four, as CasADi expressions."""
    k1 = right(x, t)
    k2 = right(x + h / 2 * k1, t + h / 2)
    k3 = right(x + h / 2 * k2, t + h / 2)
    k4 = right(x + h * k3, t + h)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@dataclass(frozen=True, eq=False)
class Spans:
    """K spans of time along a path, each with its map.

    Parameters
    ----------
    nodes : (K, 2 s + 1, n) the path at the ends and middles of the s substeps of every span, in state units
    times : (K, 2 s + 1) of the nodes, in the unit of time
    transition : (K, n, n) F, derivative of the end of a span by its start
    noise : (K, n, n) Q, covariance that the plant noise adds
    halves : (K, 2 s, n, n) derivatives of the single Runge-Kutta steps
    intensity : (K, 2 s + 1, n, n) Xi at the nodes; in discrete time (K, 1, n, n) the covariance of the step
    """

    nodes: np.ndarray
    times: np.ndarray
    transition: np.ndarray
    noise: np.ndarray
    halves: np.ndarray
    intensity: np.ndarray

    @property
    def ends(self) -> np.ndarray:
        """(K, n) where the spans end."""
        return self.nodes[:, -1]


@dataclass(frozen=True, eq=False)
class Flow:
    """The movement of a plant, for any state and any span.

    Parameters
    ----------
    right : f, a CasADi function (x, t) -> dx/dt; in discrete time (x, k) -> the next state
    noise : CasADi function (x, t) -> (n, n) intensity Xi; in discrete time the covariance of one step
    states : n
    discrete : whether `right` is the map itself
    """

    right: CasadiFunction
    noise: CasadiFunction
    states: int
    discrete: bool = False
    _made: dict = field(default_factory=dict, init=False, repr=False)

    def __getstate__(self) -> dict:
        return {**self.__dict__, "_made": {}}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)

    def kept(self, name: Hashable, make: Callable[[], Made]) -> Made:
        """What `make` makes, once for every name; copies sent to other processes make their own."""
        if name not in self._made:
            self._made[name] = make()
        return self._made[name]

    @property
    def step(self) -> CasadiFunction:
        """One Runge-Kutta step, or the map: (x, t, h) -> its end and its derivative by x."""
        if "step" not in self._made:
            import casadi

            x, t, h = casadi.SX.sym("x", self.states), casadi.SX.sym("t"), casadi.SX.sym("h")
            end = self.right(x, t) if self.discrete else runge_kutta(self.right, x, t, h)
            self._made["step"] = casadi.Function("step", [x, t, h], [end, casadi.jacobian(end, x)])
            self._made["end"] = casadi.Function("end", [x, t, h], [end])
        return self._made["step"]

    @property
    def slope(self) -> CasadiFunction:
        """(x, t) -> derivative of the right side by x (n, n); in discrete time that of the map."""
        if "slope" not in self._made:
            import casadi

            x, t = casadi.SX.sym("x", self.states), casadi.SX.sym("t")
            jacobian = casadi.jacobian(self.right(x, t), x)
            self._made["slope"] = casadi.Function("slope", [x, t], [casadi.densify(jacobian)])
        return self._made["slope"]

    def path(self, start: np.ndarray, times: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States (K+1, n) along K steps of given lengths, and the derivatives (K, n, n) of the steps.

        Parameters
        ----------
        start : (n,) state at the first time, in state units
        times : (K,) where the steps begin, in the unit of time
        lengths : (K,) of the steps
        """
        count, n = len(lengths), self.states
        if count == 0:
            return np.array([start]), np.empty((0, n, n))
        if count not in self._made:
            while len([key for key in self._made if isinstance(key, int)]) >= 8:
                del self._made[next(key for key in self._made if isinstance(key, int))]
            self._made[count] = self.step.mapaccum("path", count)
        ends, derivatives = self._made[count](start, times[None], lengths[None])
        states = np.vstack([start, np.array(ends).T])
        return states, np.swapaxes(np.array(derivatives).T.reshape(count, n, n), 1, 2)

    def derivatives(self, states: np.ndarray, times: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        """(K, n, n) derivatives of K single steps, each from its own state.

        Parameters
        ----------
        states : (K, n), in state units
        times, lengths : (K,) where each step begins and how long it is, in the unit of time
        """
        count, n = states.shape
        if count == 0:
            return np.empty((0, n, n))
        _, found = self.step(states.T, times[None], lengths[None])
        return np.swapaxes(np.array(found).T.reshape(count, n, n), 1, 2)

    def advance(self, states: np.ndarray, since: float, length: float, substeps: int) -> np.ndarray:
        """Where K states end after a span, (n, K), one column each.

        Parameters
        ----------
        states : (n, K), in state units
        since : when the span begins, in the unit of time; k in discrete time
        length : of the span, in the unit of time; a span of length 0 moves nothing
        substeps : of the span
        """
        states = np.asarray(states, dtype=float)
        if length == 0 or not states.size:
            return states
        _ = self.step
        count, members = 1 if self.discrete else 2 * substeps, states.shape[1]
        if ("end", count) not in self._made:
            self._made["end", count] = self._made["end"].mapaccum("ends", count)
        times = np.tile(since + length * np.arange(count) / count, members)
        found = self._made["end", count](states, times[None], np.full((1, count * members), length / count))
        return np.array(found)[:, count - 1 :: count]

    def intensities(self, states: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(K, n, n) the noise at K states.

        Parameters
        ----------
        states : (K, n), in state units
        times : (K,), in the unit of time
        """
        count, n = states.shape
        if count == 0:
            return np.empty((0, n, n))
        found = np.array(self.noise(states.T, times[None])).T.reshape(count, n, n)
        return (found + np.swapaxes(found, 1, 2)) / 2

    def across(self, start: np.ndarray, since: float, length: float, substeps: int) -> tuple[np.ndarray, ...]:
        """End (n,), F and Q (n, n) of one span from a state.

        Parameters
        ----------
        start : (n,), in state units
        since : when the span begins, in the unit of time
        length : of the span, in the unit of time; a span of length 0 moves nothing
        substeps : of the span
        """
        n = self.states
        if length == 0:
            return start, np.eye(n), np.zeros((n, n))
        count = 1 if self.discrete else 2 * substeps
        times = since + length * np.arange(count + 1) / count
        states, halves = self.path(start, times[:-1], np.full(count, length / count))
        at = (states[:1], times[:1]) if self.discrete else (states, times)
        F, Q = combined(halves[None], self.intensities(*at)[None], np.array([length]))
        return states[-1], F[0], Q[0]


def combined(halves: np.ndarray, intensity: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F and Q (K, n, n) of whole spans from their single steps.

    Parameters
    ----------
    halves : (K, 2 s, n, n) derivatives of the Runge-Kutta steps; (K, 1, n, n) of the map in discrete time
    intensity : (K, 2 s + 1, n, n) Xi at the nodes; (K, 1, n, n) the covariance of the map's noise
    lengths : (K,) of the spans, in the unit of time
    """
    n = halves.shape[-1]
    if intensity.shape[1] == 1:
        return halves[:, 0], intensity[:, 0]
    F = np.broadcast_to(np.eye(n), (len(halves), n, n))
    Q = np.zeros((len(halves), n, n))
    h = (2 * lengths / halves.shape[1])[:, None, None]
    for i in range(0, halves.shape[1], 2):
        first, second = halves[:, i], halves[:, i + 1]
        whole = second @ first
        Q = _carried(whole, Q + h / 6 * intensity[:, i]) + h / 6 * intensity[:, i + 2]
        Q += 4 * h / 6 * _carried(second, intensity[:, i + 1])
        F = whole @ F
    return F, (Q + np.swapaxes(Q, 1, 2)) / 2


def charges(spans: Spans, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What int tr(R S) dt over a span is of S at its start: tr(M S) + c, as M (K, n, n) and c (K,).

    M = int Phi' R Phi dt,   c = int tr(R Q) dt, both by Simpson's rule on the substeps

    Parameters
    ----------
    spans : Spans
    weight : (K, 2 s + 1, n, n) R at the nodes
    """
    halves, Xi, R = spans.halves, spans.intensity, weight
    K, n = len(halves), halves.shape[-1]
    h = (2 * (spans.times[:, -1] - spans.times[:, 0]) / halves.shape[1])[:, None, None]
    F, Q = np.broadcast_to(np.eye(n), (K, n, n)), np.zeros((K, n, n))
    M, c = np.zeros((K, n, n)), np.zeros(K)
    for i in range(0, halves.shape[1], 2):
        first, second = halves[:, i], halves[:, i + 1]
        whole = second @ first
        back = np.linalg.inv(second)
        middle = h / 24 * (5 * _carried(first, Xi[:, i]) + 8 * Xi[:, i + 1] - _carried(back, Xi[:, i + 2]))
        local = h / 6 * (_carried(whole, Xi[:, i]) + 4 * _carried(second, Xi[:, i + 1]) + Xi[:, i + 2])
        charge = h / 6 * (R[:, i] + 4 * _weighed(first, R[:, i + 1]) + _weighed(whole, R[:, i + 2]))
        inner = 4 * _trace(R[:, i + 1], middle) + _trace(R[:, i + 2], local)
        c += _trace(charge, Q) + h[:, 0, 0] / 6 * inner
        M += _weighed(F, charge)
        Q, F = _carried(whole, Q) + local, whole @ F
    return (M + np.swapaxes(M, 1, 2)) / 2, c


def _carried(F: np.ndarray, S: np.ndarray) -> np.ndarray:
    return F @ S @ np.swapaxes(F, 1, 2)


def _weighed(F: np.ndarray, R: np.ndarray) -> np.ndarray:
    return np.swapaxes(F, 1, 2) @ R @ F


def _trace(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    return np.einsum("kij,kji->k", A, B)
