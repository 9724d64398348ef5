"""Criteria of the outputs' covariance X = D S D' other than its trace: log-trace, volume, worst direction, Schatten.

Each is convex in the information Y = S^-1 and grows with S:

* log tr X: 1/tr(D Y^-1 D') is a harmonic mean of the concave 1/(d_i' Y^-1 d_i), and -log falls and is convex;
* log det X: (D Y^-1 D')^-1 is a Schur complement, concave and increasing in Y, and -log det falls and is convex;
* largest eigenvalue, Schatten p: the largest tr(Z X) over a set of Z >= 0, each of which is convex in Y.

The least eigenvalue is not here because it is not convex: Y = diag(1, 4) and diag(4, 1) both have least variance .25,
and their mean diag(2.5, 2.5) has .4, which is more. The condition number fails in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np


@dataclass(frozen=True, eq=False)
class LogTrace:
    """log tr(D S D'), by which an error of 1 % counts the same at every size.

    Parameters
    ----------
    output : (p, n) D
    """

    output: np.ndarray
    signed: ClassVar[bool] = True

    def value(self, covariance: np.ndarray) -> float:
        """log tr(D S D') for S, `covariance` (n, n); raises ValueError where the trace is 0."""
        return float(np.log(_positive(np.trace(_outputs(self.output, covariance)))))

    def gradient(self, covariance: np.ndarray) -> np.ndarray:
        """D'D / tr(D S D') (n, n) at S, `covariance` (n, n); raises ValueError where the trace is 0."""
        return self.output.T @ self.output / _positive(np.trace(_outputs(self.output, covariance)))

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """0 for any `covariance` (n, n): nothing is smoothed."""
        return 0.0

    def rounding(self, covariance: np.ndarray) -> float:
        """0 for any `covariance` (n, n): its logarithm is of one number."""
        return 0.0


@dataclass(frozen=True, eq=False)
class LogDeterminant:
    """log det(D S D'), twice the logarithm of the volume of the error ellipsoid but for a constant.

    Parameters
    ----------
    output : (p, n) D of full row rank; `independent_outputs` makes it so
    """

    output: np.ndarray
    signed: ClassVar[bool] = True

    def value(self, covariance: np.ndarray) -> float:
        """log det(D S D') for S, `covariance` (n, n); raises ValueError where it is not positive definite."""
        scale, factor = _scaled_factor(_outputs(self.output, covariance))
        return float(2 * np.sum(np.log(scale)) + 2 * np.sum(np.log(np.diagonal(factor))))

    def gradient(self, covariance: np.ndarray) -> np.ndarray:
        """D' X^-1 D (n, n) at S, `covariance` (n, n); raises ValueError where X is not positive definite."""
        scale, factor = _scaled_factor(_outputs(self.output, covariance))
        root = np.linalg.solve(factor, self.output / scale[:, None])
        return root.T @ root

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """0 for any `covariance` (n, n): nothing is smoothed."""
        return 0.0

    def rounding(self, covariance: np.ndarray) -> float:
        """What the last digit of S, `covariance` (n, n), moves: p^2 units of it times the condition of the outputs."""
        scale, factor = _scaled_factor(_outputs(self.output, covariance))
        sizes = np.linalg.svd(factor, compute_uv=False)
        return float(4 * len(scale) ** 2 * np.finfo(float).eps * (sizes[0] / sizes[-1]) ** 2)

    def curvature(self, covariance: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Second derivatives (m, m) at S, `covariance` (n, n), along `changes` (m, n, n): -tr(W S_a W S_b)."""
        along = self.gradient(covariance) @ changes
        return -np.einsum("aij,bji->ab", along, along)


@dataclass(frozen=True, eq=False)
class LargestEigenvalue:
    """The variance in the worst direction, the largest eigenvalue l_1 of D S D', smoothed from above.

        value = mu log sum_i exp(l_i / mu),     gradient = D' Z D,   Z = V diag(s) V',   s = softmax(l / mu)

    tr Z = 1, so that tr(Z X) is at most the largest eigenvalue of every X: with value - tr(Z X) = mu entropy(s) taken
    off, a tangent bounds the true criterion. With mu = 0 the value is the true one and Z lies on one worst direction,
    which still proves a bound.

    Parameters
    ----------
    output : (p, n) D
    smoothing : mu, in units of a variance; 0 for none
    """

    output: np.ndarray
    smoothing: float = 0.0
    signed: ClassVar[bool] = False

    def smoothed(self, smoothing: float) -> LargestEigenvalue:
        """The same with another mu, `smoothing`."""
        return replace(self, smoothing=smoothing)

    def value(self, covariance: np.ndarray) -> float:
        """The smoothed largest eigenvalue at S, `covariance` (n, n)."""
        values = np.linalg.eigvalsh(_outputs(self.output, covariance))
        if self.smoothing == 0:
            return float(values[-1])
        total = np.sum(np.exp((values - values[-1]) / self.smoothing))
        return float(values[-1] + self.smoothing * np.log(total))

    def gradient(self, covariance: np.ndarray) -> np.ndarray:
        """D' Z D (n, n) at S, `covariance` (n, n)."""
        values, vectors = np.linalg.eigh(_outputs(self.output, covariance))
        root = (vectors * np.sqrt(self._shares(values))).T @ self.output
        return root.T @ root

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """value - tr(Z X) >= 0 at S, `covariance` (n, n): mu times the entropy of the shares."""
        shares = self._shares(np.linalg.eigvalsh(_outputs(self.output, covariance)))
        shares = shares[shares > 0]
        return float(-self.smoothing * np.sum(shares * np.log(shares)))

    def rounding(self, covariance: np.ndarray) -> float:
        """0 for any `covariance` (n, n): any Z of trace 1 gives a bound."""
        return 0.0

    @property
    def spread(self) -> float:
        """log p: a smoothed value is at most mu log p above the true one."""
        return float(np.log(len(self.output)))

    def curvature(self, covariance: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Second derivatives (m, m) at S, `covariance` (n, n), along `changes` (m, n, n), for mu > 0.

        In the basis V: sum_i s_i A_ii B_ii / mu - (s.A)(s.B) / mu + sum_{i != j} (s_i - s_j)/(l_i - l_j) A_ij B_ij.
        """
        values, vectors = np.linalg.eigh(_outputs(self.output, covariance))
        s, basis = self._shares(values), self.output.T @ vectors
        along = basis.T @ changes @ basis
        apart = np.subtract.outer(values, values)
        near = np.abs(apart) <= 1e-6 * self.smoothing  # there the quotient is its limit
        both = np.add.outer(s, s) / (2 * self.smoothing)
        slope = np.where(near, both, np.subtract.outer(s, s) / np.where(near, 1.0, apart))
        drift = np.einsum("i,aii->a", s, along)
        return np.einsum("aij,ij,bij->ab", along, slope, along) - np.outer(drift, drift) / self.smoothing

    def _shares(self, values: np.ndarray) -> np.ndarray:
        if self.smoothing == 0:
            return (np.arange(len(values)) == len(values) - 1).astype(float)
        shares = np.exp((values - values[-1]) / self.smoothing)
        return shares / np.sum(shares)


@dataclass(frozen=True, eq=False)
class Schatten:
    """(tr X^p)^(1/p) for X = D S D': the trace for p = 1, towards the largest eigenvalue as p grows.

    Parameters
    ----------
    output : (rows, n) D
    power : p >= 1
    """

    output: np.ndarray
    power: float = 4.0
    signed: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not (np.isfinite(self.power) and self.power >= 1):
            raise ValueError(f"a Schatten norm needs a finite p of at least 1, not {self.power}")

    def value(self, covariance: np.ndarray) -> float:
        """(sum_i l_i^p)^(1/p) for the eigenvalues l of D S D', S being `covariance` (n, n)."""
        values = np.maximum(np.linalg.eigvalsh(_outputs(self.output, covariance)), 0.0)
        if values[-1] == 0:
            return 0.0
        return float(values[-1] * np.sum((values / values[-1]) ** self.power) ** (1 / self.power))

    def gradient(self, covariance: np.ndarray) -> np.ndarray:
        """D' (X/|X|_p)^(p-1) D (n, n) at S, `covariance` (n, n)."""
        values, vectors = np.linalg.eigh(_outputs(self.output, covariance))
        norm = self.value(covariance)
        shares = (np.maximum(values, 0.0) / norm) ** (self.power - 1) if norm > 0 else np.zeros(len(values))
        root = (vectors * np.sqrt(shares)).T @ self.output
        return root.T @ root

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """0 for any `covariance` (n, n): the norm is itself the criterion."""
        return 0.0

    def rounding(self, covariance: np.ndarray) -> float:
        """0 for any `covariance` (n, n): any Z of dual norm 1 gives a bound."""
        return 0.0


def independent_outputs(output: np.ndarray, covariance: np.ndarray, cutoff: float = 1e-12) -> np.ndarray:
    """Outputs whose covariance is not singular: D itself, or U'D with U an orthonormal basis of the range of D S D'.

    That range is the same for every policy with finite information, so that one S decides. The rank is that of the
    correlations, so that units do not matter.

    Parameters
    ----------
    output : (p, n) D
    covariance : (n, n) S of any policy
    cutoff : eigenvalues of the correlations below this share of the largest count as 0

    Returns (r, n) with r <= p; raises ValueError where nothing is uncertain.
    """
    X = _outputs(output, covariance)
    scale = np.sqrt(np.maximum(np.diagonal(X), 0.0))
    moving = scale > 0
    if not np.any(moving):
        raise ValueError("no output is uncertain: the covariance of the outputs is zero")
    safe = np.where(moving, scale, 1.0)
    values, vectors = np.linalg.eigh(X / np.outer(safe, safe))
    kept = values > cutoff * values[-1]
    if np.all(kept):
        return output
    basis, _ = np.linalg.qr(np.where(moving, scale, 0.0)[:, None] * vectors[:, kept])
    return basis.T @ output


def _outputs(output: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    X = output @ covariance @ output.T
    return (X + X.T) / 2


def _positive(trace: float) -> float:
    if not trace > 0:
        raise ValueError("the outputs are known exactly: their trace has no logarithm")
    return float(trace)


def _scaled_factor(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (p,) and the Cholesky factor (p, p) of the correlations: units cost no accuracy."""
    variances = np.diagonal(X)
    if not np.all(variances > 0):
        raise ValueError("an output is known exactly: the volume of its error is 0")
    scale = np.sqrt(variances)
    dependent = "the outputs depend on one another: the volume of their error is 0"
    try:
        factor = np.linalg.cholesky(X / np.outer(scale, scale))
    except np.linalg.LinAlgError as e:
        raise ValueError(dependent) from e
    # a pivot is a share of a variance that the outputs before it leave open; below rounding it says nothing
    if np.min(np.diagonal(factor)) ** 2 <= 4 * len(X) * np.finfo(float).eps:
        raise ValueError(dependent)
    return scale, factor
