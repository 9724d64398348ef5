"""Sizes of an ellipsoid {x: (x - a)' P^-1 (x - a) <= d}, and sums of them.

    trace         d tr P                         the sum of the squared semi-axes
    volume        pi^(n/2)/Gamma(n/2+1) sqrt(d^n det P)
    longest-axis  sqrt(d lambda_max(P))          the longest semi-axis, a length

Each grows with P and d, and is convex in P^-1, which is what the certificate of a schedule needs.
Savkin, Evans & Skafidas, assumptions 2.1-2.3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

SIZES = ("trace", "volume", "longest-axis")


@dataclass(frozen=True)
class Size:
    """A weighted sum of sizes.

    Parameters
    ----------
    terms : {name: weight}, names from SIZES, weights >= 0 and not all zero
    scales : d (n,) where shapes are given in states x/d: the size is that of D P D; empty for the states themselves
    """

    terms: tuple[tuple[str, float], ...]
    scales: tuple[float, ...] = ()

    @classmethod
    def of(cls, terms: str | Mapping[str, float]) -> Size:
        """From one name, or a mapping of names to weights."""
        pairs = ((terms, 1.0),) if isinstance(terms, str) else tuple((k, float(v)) for k, v in terms.items())
        return cls(tuple(pair for pair in pairs if pair[1] > 0))

    def _degree(self, name: str, states: int) -> float:
        return {"trace": 1.0, "volume": states / 2, "longest-axis": 0.5}[name]

    def degree(self, states: int) -> float:
        """The largest p with size(c P) <= c^p size(P) for all c >= 1."""
        return max(self._degree(name, states) for name, _ in self.terms)

    def homogeneous(self, states: int) -> bool:
        """Whether d is a mere factor, so that the best schedule depends on no measurement, on no x0 and not on d."""
        return len({self._degree(name, states) for name, _ in self.terms}) == 1

    def value(self, P: np.ndarray, level: float | np.ndarray) -> np.ndarray:
        """Sizes (...,) of shapes P (..., n, n) and `level` d (...,)."""
        total = np.zeros(P.shape[:-2])
        for name, weight in self.terms:
            total = total + weight * _value(name, P, level, self._scales(P))
        return total

    def _scales(self, P: np.ndarray) -> np.ndarray:
        return np.array(self.scales) if self.scales else np.ones(P.shape[-1])

    def support(self, P: np.ndarray, level: float, power: float = np.inf) -> tuple[float, np.ndarray]:
        """A convex function of P^-1 that nowhere exceeds the size: its value at P and its gradient (n, n) there.

        For the longest axis that function is sqrt(d tr(W P)) with a fixed W of trace one: the projector on that axis,
        or, with a finite `power`, W ~ P^(power-1), which weighs all axes that are nearly as long.

        Parameters
        ----------
        P : (n, n) shape
        level : d
        power : infinite for the longest axis alone
        """
        value, gradient = self._smooth_part(P, level)
        for name, weight in self.terms:
            if name == "longest-axis":
                _lengths, W, _ = _soft(P, power, self._scales(P))
                here = math.sqrt(level * np.sum(W * P))
                value, gradient = value + weight * here, gradient + weight * level * W / (2 * here)
        return float(value), gradient

    def smooth(self, P: np.ndarray, level: float, power: float) -> tuple[float, np.ndarray]:
        """The size with (tr P^power)^(1/power) for lambda_max, and its gradient (n, n): never below the size."""
        value, gradient = self._smooth_part(P, level)
        for name, weight in self.terms:
            if name == "longest-axis":
                lengths, W, total = _soft(P, power, self._scales(P))
                norm = lengths[-1] * total ** (1 / power)
                here = math.sqrt(level * norm)
                slope = W * (norm / np.sum(W * P))
                value, gradient = value + weight * here, gradient + weight * level * slope / (2 * here)
        return float(value), gradient

    @property
    def has_kink(self) -> bool:
        """Whether the size is not differentiable where two axes are equally long."""
        return any(name == "longest-axis" for name, _ in self.terms)

    def _smooth_part(self, P: np.ndarray, level: float) -> tuple[float, np.ndarray]:
        value, gradient, scales = 0.0, np.zeros(P.shape), self._scales(P)
        for name, weight in self.terms:
            if name == "trace":
                here = float(_value(name, P, level, scales))
                value, gradient = value + weight * here, gradient + weight * level * np.diag(scales**2)
            elif name == "volume":
                here = float(_value(name, P, level, scales))
                value, gradient = value + weight * here, gradient + weight * here / 2 * np.linalg.inv(P)
        return value, gradient

    @property
    def text(self) -> str:
        """As a user reads it."""
        return " + ".join(name if weight == 1 else f"{weight:g} {name}" for name, weight in self.terms)


def _value(name: str, P: np.ndarray, level: float | np.ndarray, scales: np.ndarray) -> np.ndarray:
    n = P.shape[-1]
    if name == "trace":
        return level * np.sum(np.diagonal(P, axis1=-2, axis2=-1) * scales**2, axis=-1)
    if name == "volume":
        sign, log = np.linalg.slogdet(P)
        log_ball = n / 2 * math.log(math.pi) - math.lgamma(n / 2 + 1) + float(np.sum(np.log(scales)))
        return np.where(sign > 0, np.exp(log_ball + 0.5 * (n * np.log(level) + log)), np.inf)
    return np.sqrt(level * np.linalg.eigvalsh(P * np.outer(scales, scales))[..., -1])


def _soft(P: np.ndarray, power: float, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Eigenvalues of D P D, D W D with W ~ (D P D)^(power-1) of trace one, and tr (D P D/lambda_max)^power."""
    both = np.outer(scales, scales)
    lengths, vectors = np.linalg.eigh(P * both)
    ratio = np.maximum(lengths / lengths[-1], 0.0)
    share = np.zeros(len(ratio))
    share[-1] = 1.0
    if np.isfinite(power):
        share = ratio ** (power - 1)
    W = (vectors * (share / np.sum(share))) @ vectors.T
    return lengths, W * both, float(np.sum(ratio**power)) if np.isfinite(power) else 1.0
