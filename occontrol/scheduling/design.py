"""Experiments for constant parameters, with or without a prior: J as a function of the information F = F_0 + sum v L.

    J(v) = cost.v + phi(F^-1),    dJ/dv_a = cost_a - tr(W F^-1 L_a F^-1),    W = dphi/dS at S = F^-1
    d2J/dv_a dv_b = 2 tr(F^-1 W F^-1 L_a F^-1 L_b) + phi''(S_a, S_b),        S_a = -F^-1 L_a F^-1

F is linear in v, so that J is convex, and it is infinite where F is singular. The switching function is the sensitivity
function of design theory: that a design is optimal when no candidate lies below those it uses is the General
Equivalence Theorem (Kiefer & Wolfowitz 1960), and the bound of a policy measures by how much it is missed.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Certificate, Status
from occontrol.scheduling.criterion import CurvedCriterion
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome


class Design:
    """J and its derivatives on policies (N, M) of candidate readings; an Objective.

    Parameters
    ----------
    information : (N, M, n, n) L = H' R^-1 H of every candidate
    criterion : CurvedCriterion of the covariance F^-1
    prior : (n, n) F_0; zero if None
    cost : (N, M) prices; zero if None
    """

    def __init__(
        self,
        information: np.ndarray,
        criterion: CurvedCriterion,
        prior: np.ndarray | None = None,
        cost: np.ndarray | None = None,
    ):
        self.shape = information.shape[0], information.shape[1]
        self.states = information.shape[2]
        self.information = information.reshape(-1, self.states, self.states)
        self.criterion = criterion
        self.prior = np.zeros((self.states, self.states)) if prior is None else prior
        self.prices = np.zeros(self.shape) if cost is None else cost
        self.forward_count = self.backward_count = 0

    def covariance(self, weights: np.ndarray) -> np.ndarray | None:
        """F^-1 (n, n) of a policy, `weights` (N, M); None where F is singular."""
        root = self.root(weights)
        return None if root is None else root.T @ root

    def root(self, weights: np.ndarray) -> np.ndarray | None:
        """X (n, n) with X'X = F^-1 of a policy, `weights` (N, M); None where F is singular."""
        F = self.prior + np.tensordot(weights.ravel(), self.information, 1)
        scale = np.sqrt(np.diagonal(F))
        if not np.all(scale > 0):
            return None
        try:
            factor = np.linalg.cholesky(F / np.outer(scale, scale))
        except np.linalg.LinAlgError:
            return None
        if np.min(np.diagonal(factor)) ** 2 <= 4 * len(F) * np.finfo(float).eps:
            return None
        return np.linalg.inv(factor) / scale

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, M); inf where a direction is not seen."""
        self.forward_count += 1
        S = self.covariance(weights)
        return np.inf if S is None else float(np.vdot(self.prices, weights)) + self.criterion.value(S)

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy, `weights` (N, M); raises ValueError where a direction is not seen."""
        J, g, _ = self.derivatives(weights, curved=False)
        return J, g

    def smoothing_error(self, weights: np.ndarray) -> float:
        """What J at `weights` (N, M) has to lose before its tangent bounds the true criterion."""
        S = self.covariance(weights)
        return 0.0 if S is None else self.criterion.smoothing_error(S)

    def derivatives(self, weights: np.ndarray, curved: bool = True) -> tuple[float, np.ndarray, np.ndarray]:
        """J, dJ/dv (N, M) and the Hessian (N M, N M), or an empty array.

        Parameters
        ----------
        weights : (N, M) policy; raises ValueError where F is singular
        curved : whether the Hessian is wanted
        """
        S = self.covariance(weights)
        if S is None:
            raise ValueError("the information is singular: a direction of the parameters is not seen by any reading")
        self.backward_count += 1
        W = self.criterion.gradient(S)
        G = S @ W @ S
        J = float(np.vdot(self.prices, weights)) + self.criterion.value(S)
        gradient = self.prices - np.einsum("ij,aji->a", G, self.information).reshape(self.shape)
        if not curved:
            return J, gradient, np.empty((0, 0))
        seen = S @ self.information
        hessian = 2 * np.einsum("aij,bji->ab", G @ self.information, seen)
        hessian += self.criterion.curvature(S, -seen @ S)
        return J, gradient, (hessian + hessian.T) / 2


def minimise_design(
    design: Design,
    feasible_set: IntervalPolytopes,
    start: np.ndarray | None = None,
    options: RelaxedOptions | None = None,
    monitor: Monitor | None = None,
) -> RelaxedOutcome:
    """The best shares of the candidates, by Newton's method with a logarithmic barrier at 0 and at the upper limits.

    For some hundreds of candidates at most: every step solves with their Hessian. The bound is that of the shares
    themselves, of the true criterion where `design.criterion` smooths one, and it decides when to stop; the cost is
    then the smoothed one, which is not below the true. What rounding did is not taken off the bound: it is that of the
    inverse of F, whose correlations may be as near to singular as 1e-15.

    Parameters
    ----------
    design : Design
    feasible_set : IntervalPolytopes, each interval with `select` readings
    start : (N, M) shares strictly inside the limits; equal shares if None
    options : RelaxedOptions
    monitor : Monitor

    Returns RelaxedOutcome; raises ValueError where the start leaves a direction unseen.
    """
    options, monitor = options or RelaxedOptions(), monitor or Monitor()
    v = feasible_set.uniform() if start is None else start.copy()
    upper = feasible_set.upper
    free = ((v > 0) & (v < upper)).ravel()
    owner = np.repeat(np.arange(len(v)), v.shape[1])[free]
    E = (owner == np.unique(owner)[:, None]).astype(float)
    top, barrier, bound, iteration, status = upper.ravel()[free], np.inf, -np.inf, 0, Status.LIMIT

    def inside(x: np.ndarray) -> float:
        w = v.copy()
        w.ravel()[free] = x
        if np.min(x) <= 0 or np.min(top - x) <= 0:
            return np.inf
        return design.cost(w) - barrier * float(np.sum(np.log(x) + np.log(top - x)))

    while True:
        J, g, H = design.derivatives(v)
        bound = max(bound, feasible_set.bound(J - design.smoothing_error(v), v, g))
        monitor.report(iteration, J, bound)
        target = options.relative_gap * abs(J) if options.absolute_gap is None else options.absolute_gap
        if J - bound <= target:
            status = Status.CERTIFIED
            break
        if monitor.stop or iteration >= min(options.max_iterations, 500) or not np.any(free):
            status = Status.INTERRUPTED if monitor.interrupted else Status.LIMIT
            break
        iteration += 1
        x = v.ravel()[free]
        barrier = min(barrier, (J - bound) / (2 * len(x)))
        slope = g.ravel()[free] - barrier / x + barrier / (top - x)
        bent = H[np.ix_(free, free)] + np.diag(barrier / x**2 + barrier / (top - x) ** 2)
        d = _newton(bent, slope, E)
        falls = float(slope @ d)
        if -falls <= 0.1 * barrier:
            barrier *= 0.1  # near enough to the centre
        t = min(1.0, 0.95 / max(float(np.max(-d / x)), float(np.max(d / (top - x))), 1e-300))
        at = inside(x)
        slope = g.ravel()[free] - barrier / x + barrier / (top - x)
        for _ in range(40):
            if inside(x + t * d) <= at + 1e-4 * t * min(float(slope @ d), 0.0):
                v.ravel()[free] = x + t * d
                break
            t *= 0.5
    certificate = Certificate(J, bound)
    if certificate.contradicts:
        status = Status.DISAGREES
    spent = {"gradients": design.backward_count, "costs": design.forward_count}
    return RelaxedOutcome(v, J, certificate.lower_bound, g, iteration, status, spent)


def exchanged(design: Design, feasible_set: IntervalPolytopes, start: np.ndarray) -> tuple[np.ndarray, float]:
    """The best single exchange of readings, again and again until none lowers the true cost.

    Parameters
    ----------
    design : Design
    feasible_set : IntervalPolytopes
    start : (N, M) integral design

    Returns the design (N, M) and its J, which may be inf.
    """
    v, J = start.copy(), design.cost(start)
    while True:
        leaves, enters = feasible_set.exchange_masks(v)
        best, best_J = None, J
        for k, j in np.argwhere(leaves):
            for e in np.flatnonzero(enters[k]):
                trial = v.copy()
                trial[k, j] -= 1.0
                trial[k, e] += 1.0
                value = design.cost(trial)
                if value < best_J - 1e-14 * abs(best_J) if np.isfinite(best_J) else value < best_J:
                    best, best_J = trial, value
        if best is None:
            return v, J
        v, J = best, best_J


def _newton(H: np.ndarray, g: np.ndarray, E: np.ndarray) -> np.ndarray:
    """d (m,) that minimises g.d + d'Hd/2 with E d = 0, in units in which H has a diagonal of ones."""
    scale = 1 / np.sqrt(np.diagonal(H))
    m, e = len(g), len(E)
    KKT = np.zeros((m + e, m + e))
    KKT[:m, :m] = scale[:, None] * H * scale
    KKT[m:, :m] = E * scale
    KKT[:m, m:] = KKT[m:, :m].T
    return scale * np.linalg.lstsq(KKT, np.concatenate([-scale * g, np.zeros(e)]), rcond=None)[0][:m]
