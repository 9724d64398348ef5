"""The precision program in one well-scaled normal form.

Unknowns: values (m,) >= 0, lambda_i = scale_i values_i. The program is

    minimise  costs' values   subject to  constant + sum_i values_i f_i f_i' >= 0,  0 <= values <= upper

With Y = L L' (L of rank r) and G = W L', the posterior covariance is P - WW' + W (I + L'SL)^-1 W', so that the bound
Sigma+ <= P^d reads, when Delta = P^d - P + WW' > 0,   I + L'SL >= K = W' Delta^-1 W   (the reduced form, r x r).
States are measured in units of the bound (Cholesky factor of P^d), measurements in their own standard deviations, and
the inequality is multiplied by (I + K)^(-1/2) from both sides: its constant then has eigenvalues in (-1, 1].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.families.precision.moments import Moments
from occontrol.numerics.linalg import solve_lower

RANK_OF_MOMENT = 1e-12  # smallest eigenvalue of Y (unit diagonal) that counts, relative to the largest
RANK_OF_ANOMALIES = 1e-10  # the same for singular values of the measurement anomalies


@dataclass(frozen=True, eq=False)
class Factored:
    """P, G, Y in units of the bound: bound = I, P = residual + W W', G = W L', Y = L L'.

    Parameters
    ----------
    residual : (n, n) what stays when every sensor is exact
    influence : (n, r) W
    rows : (m, r) L, one row per sensor in its own standard deviation
    deviation : (m,) standard deviation of every noise-free measurement; 0 is a sensor that tells nothing
    root : (n, n) lower Cholesky factor of the bound
    """

    residual: np.ndarray
    influence: np.ndarray
    rows: np.ndarray
    deviation: np.ndarray
    root: np.ndarray

    def covariance(self, scaled: np.ndarray) -> np.ndarray:
        """(n, n) posterior in units of the bound; `scaled` (m,) = precisions * deviation^2, infinity allowed."""
        exact = np.isinf(scaled)
        basis = np.eye(self.rows.shape[1])
        if np.any(exact):
            _, s, vt = np.linalg.svd(self.rows[exact])
            basis = vt[int(np.sum(s > RANK_OF_ANOMALIES * max(s[0], 1e-300))) :].T
        rows, influence = self.rows[~exact] @ basis, self.influence @ basis
        inner = np.eye(basis.shape[1]) + rows.T @ (scaled[~exact, None] * rows)
        half = solve_lower(np.linalg.cholesky(inner), influence.T)
        return self.residual + half.T @ half


@dataclass(frozen=True, eq=False)
class NormalForm:
    """A scaled program; see the header. `index` (k,): which sensors its rows are; objective = unit * costs' values."""

    constant: np.ndarray
    factors: np.ndarray
    costs: np.ndarray
    upper: np.ndarray
    scale: np.ndarray
    unit: float
    index: np.ndarray

    @property
    def rows(self) -> int:
        """The size r of the matrix inequality."""
        return self.constant.shape[0]

    def matrix(self, values: np.ndarray) -> np.ndarray:
        """(r, r) constant + sum_i values_i f_i f_i' for `values` (m,)."""
        return self.constant + self.factors.T @ (values[:, None] * self.factors)

    def lower_bound(self, dual: np.ndarray) -> float:
        """The best bound on costs' values that a multiple of the dual matrix (r, r) >= 0 proves.

        For X >= 0 with a_i = f_i' X f_i:  costs' values >= -tr(X constant) - sum_i upper_i max(0, a_i - costs_i),
        where a_i <= costs_i is needed for sensors without a cap. The best multiple lies at a kink.
        """
        slope = -float(np.sum(dual * self.constant))
        if slope <= 0:
            return 0.0
        a = np.sum((self.factors @ dual) * self.factors, axis=1)
        with np.errstate(divide="ignore"):
            kinks = np.where(a > 0, self.costs / np.maximum(a, 1e-300), np.inf)
        free = np.isinf(self.upper)
        most = float(np.min(kinks[free], initial=np.inf))
        tries = np.append(kinks[~free & (kinks < most)], most)
        tries = tries[np.isfinite(tries)]
        over = np.maximum(0.0, tries[:, None] * a[~free] - self.costs[~free])
        return max(0.0, float(np.max(tries * slope - over @ self.upper[~free], initial=0.0)))


def factored(moments: Moments, bound: np.ndarray) -> Factored:
    """Moments in units of the bound (n, n) > 0, split as the header says; the rank is decided here."""
    root = np.linalg.cholesky(bound)
    deviation = np.sqrt(np.maximum(np.diag(moments.measurement), 0.0))
    safe = np.where(deviation > 0, deviation, 1.0)
    n = moments.states
    if moments.anomalies is not None:
        state = solve_lower(root, moments.anomalies[:n])
        u, s, vt = np.linalg.svd(moments.anomalies[n:] / safe[:, None], full_matrices=False)
        rank = int(np.sum(s > RANK_OF_ANOMALIES * max(s[0], 1e-300))) if s.size else 0
        influence = state @ vt[:rank].T
        rest = state - influence @ vt[:rank]
        return Factored(rest @ rest.T, influence, u[:, :rank] * s[:rank], deviation, root)
    state = solve_lower(root, solve_lower(root, moments.state).T)
    cross = solve_lower(root, moments.cross) / safe
    eigenvalues, vectors = np.linalg.eigh(moments.measurement / safe[:, None] / safe)
    keep = eigenvalues > RANK_OF_MOMENT * max(eigenvalues[-1], 1e-300) if eigenvalues.size else np.zeros(0, dtype=bool)
    spread, vectors = np.sqrt(eigenvalues[keep]), vectors[:, keep]
    influence = cross @ vectors / spread
    residual = (state + state.T) / 2 - influence @ influence.T
    return Factored(residual, influence, vectors * spread, deviation, root)


def reduced_form(
    split: Factored, prices: np.ndarray, caps: np.ndarray, keep: np.ndarray, slack: float = 0.0
) -> NormalForm:
    """The reduced form on the states spanned by `keep` (n, k); Delta > 0 there (see `precision_feasibility`).

    `slack` loosens the bound by that fraction: for programs whose only feasible point is the cap itself.

    `prices` and `caps` are (m,) each.
    """
    delta = (1.0 + slack) * np.eye(keep.shape[1]) - keep.T @ split.residual @ keep
    half = solve_lower(np.linalg.cholesky(delta), keep.T @ split.influence)
    _, s, vt = np.linalg.svd(half, full_matrices=True)
    kappa = np.zeros(vt.shape[0])
    kappa[: len(s)] = s**2
    factors = (split.rows @ vt.T) / np.sqrt(1 + kappa)
    return _scale(np.diag((1 - kappa) / (1 + kappa)), factors, split.deviation, prices, caps)


def factor_form(split: Factored, prices: np.ndarray, caps: np.ndarray) -> NormalForm:
    """Factor form, valid for any Delta: [[P^d - P, 0], [0, I_r]] + sum_i lambda_i f_i f_i' >= 0, f_i = [g_i; l_i].

    `prices` (m,) and `caps` (m,).
    """
    n, r = split.influence.shape
    constant = np.eye(n + r)
    constant[:n, :n] -= split.residual + split.influence @ split.influence.T
    factors = np.hstack([split.rows @ split.influence.T, split.rows])
    return _scale(constant, factors, split.deviation, prices, caps)


def _scale(
    constant: np.ndarray, factors: np.ndarray, deviation: np.ndarray, prices: np.ndarray, caps: np.ndarray
) -> NormalForm:
    norm2 = np.sum(factors**2, axis=1)
    index = np.flatnonzero((deviation > 0) & (caps > 0) & (norm2 > 0))
    scale = 1.0 / (norm2[index] * deviation[index] ** 2)
    costs = prices[index] * scale
    # the middle of the costs, so that one absurdly dear sensor does not set the unit
    unit = float(np.exp(np.mean(np.log(costs)))) if len(costs) else 1.0
    factors = factors[index] / np.sqrt(norm2[index])[:, None]
    return NormalForm(constant, factors, costs / unit, caps[index] / scale, scale, unit, index)
