"""The V-Lambda filter: spectral factors and mean of the state, updated step by step.

Unknown: a root S of the covariance, P = S S', carried by the compiled square-root form that all filters share; the
spectral factors V, Lambda of the paper are decomposed from it when somebody asks for them. Where P is graded (its
deviations, or those after the next measurement, differ by more than GRADED) a root would lose digits of the small ones:
there the factors themselves are carried, in the information form of the paper. Where that has nothing to stand on
either, because the covariance is singular or F is nearly so, that one step is done with the factors in covariance form,
and `notes` says so. Works in the scaled states of a SampledPlant.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.families.vlambda.eigenfactor import (
    GRADED,
    Eigenfactors,
    eigenfactors_of,
    measurement_update,
    time_update,
)
from occontrol.families.vlambda.eigenfactor_covariance import (
    factors_of_root,
    measurement_update_covariance,
    time_update_covariance,
)
from occontrol.numerics.linalg import whiten
from occontrol.numerics.square_root_filter import condition, predict, update, whitened

OVERFLOW = 1e140  # of a deviation; its square must stay finite, with room for the products of the next step
LOSS = 1e-12  # estimated relative error of a time update in information form above which the covariance form is tried


@dataclass
class EigenfactorFilter:
    """State of the filter: error covariance, as a root or as eigenfactors, and mean, before or after a measurement.

    Parameters
    ----------
    root : (n, n) S with P = S S'; None while the factors are carried
    mean : (n,)
    step : k of the covariance
    fallbacks : steps that were done with the factors in covariance form, and why
    """

    root: np.ndarray | None
    mean: np.ndarray
    step: int = 0
    fallbacks: list[tuple[int, str]] = field(default_factory=list)
    _factors: Eigenfactors | None = None
    _condition: float = 1.0

    @classmethod
    def start(cls, covariance: np.ndarray, mean: np.ndarray) -> EigenfactorFilter:
        """From the covariance (n, n), which may be singular, and the mean (n,) of x(0)."""
        state = cls(None, np.array(mean, dtype=float))
        state._carry(eigenfactors_of(covariance))
        return state

    @property
    def factors(self) -> Eigenfactors:
        """The eigenfactors of the covariance as it is now."""
        if self._factors is None:
            self._factors = factors_of_root(self.covariance_root)
        return self._factors

    @property
    def covariance_root(self) -> np.ndarray:
        """(n, n) a root of the covariance as it is now, whichever form is carried."""
        return self.factors.root if self.root is None else self.root

    def _carry(self, factors: Eigenfactors) -> None:
        """Go on from `factors`: with a root where that is safe."""
        deviations = factors.deviations
        graded = not deviations[-1] * GRADED > deviations[0]
        self._factors, self.root = factors, None if graded else np.ascontiguousarray(factors.root)
        self._condition = np.inf if graded else float(deviations[0] / deviations[-1])

    def measure(self, rows: np.ndarray, values: np.ndarray | None = None) -> float:
        """Take a whitened measurement in; returns the normalised innovation squared.

        Parameters
        ----------
        rows : (m, n) R^{-1/2} H
        values : (m,) R^{-1/2} y; None updates the covariance alone and returns NaN
        """
        if self.root is not None:
            rows = np.ascontiguousarray(rows)
            after, normalised, innovation_root = update(self.root, rows)
            # what a measurement shrinks by |D| makes the covariance that much more graded
            shrinking = self._condition * float(np.abs(innovation_root.diagonal()).max(initial=1.0))
            if shrinking < GRADED:
                self.root, self._factors = after, None
                if values is None:
                    return float("nan")
                white = whitened(innovation_root, values - rows @ self.mean)
                self.mean = self.mean + normalised @ white
                return float(white @ white)
        take_in = measurement_update if self.factors.invertible else measurement_update_covariance
        if not self.factors.invertible:
            self.fallbacks.append((self.step, "the covariance is singular"))
        factors, self.mean, innovation = take_in(self.factors, self.mean, rows, values)
        self._factors, self.root = factors, None
        return innovation

    def observe(self, H: np.ndarray, R: np.ndarray, y: np.ndarray) -> float:
        """`measure` for y (m,) = H x + v, cov v = R, that is not whitened yet; H (m, n), R (m, m)."""
        rows, values = whiten(R, H, y)
        return self.measure(rows, values)

    def propagate(self, transition: np.ndarray, noise_root: np.ndarray) -> None:
        """Go from P(k|k) to P(k+1|k).

        Parameters
        ----------
        transition : (n, n) F
        noise_root : (n, p) G Q^{1/2}

        Raises SolveFailed when the covariance overflows.
        """
        if self.root is not None:
            root = predict(self.root, np.ascontiguousarray(transition), np.ascontiguousarray(noise_root))
            self.root, self._factors = root, None
            self._condition = condition(root)
            largest = float(np.abs(root).max())
            if not self._condition < GRADED and largest < OVERFLOW:
                self._carry(self.factors)
        else:
            factors = self._propagated(transition, noise_root)
            self._carry(factors)
            largest = float(factors.deviations[0])
        self.mean = transition @ self.mean
        self.step += 1
        if not largest < OVERFLOW:
            raise SolveFailed(
                f"the error covariance overflows at k = {self.step}\n"
                "  hint: an unstable direction is not measured; fewer steps, or a sensor that sees it"
            )

    def _propagated(self, transition: np.ndarray, noise_root: np.ndarray) -> Eigenfactors:
        """The factors of P(k+1|k), in information form where that keeps its digits."""
        loss, found, factors = 1.0, None, self.factors
        if factors.invertible:
            result = time_update(factors, transition, noise_root)
            loss, found = result.loss, result.factors
        if loss > LOSS or found is None:
            other = time_update_covariance(factors, transition, noise_root)
            if found is None or loss == 1.0 or other.loss <= loss:
                reason = "the covariance is singular"
                if factors.invertible:
                    reason = (
                        "F is singular" if loss == 1.0 else f"the information form would lose {digits(loss)} digits"
                    )
                self.fallbacks.append((self.step, reason))
                found = other.factors
        return found  # type: ignore[return-value]

    @property
    def notes(self) -> tuple[str, ...]:
        """One announcement for each reason that the covariance form was used."""
        reasons: dict[str, list[int]] = {}
        for step, reason in self.fallbacks:
            kind = "the information form would lose digits" if "digits" in reason else reason
            reasons.setdefault(kind, []).append(step)
        found = []
        for reason, steps in reasons.items():
            unique = sorted(set(steps))
            where = ", ".join(str(k) for k in unique[:5]) + (f", .. ({len(unique)} steps)" if len(unique) > 5 else "")
            found.append(f"covariance form used at k = {where}: {reason}")
        return tuple(found)


def digits(loss: float) -> int:
    """How many of the 16 decimal digits a relative error of `loss` costs."""
    return int(np.ceil(16 + np.log10(loss)))
