"""The V-Lambda filter: spectral factors and mean of the state, updated step by step.

The information form of the paper is used wherever it keeps its digits. Where F is nearly singular, contracts strongly
against the plant noise, or the covariance is singular, that one step is done in covariance form, and `notes` says so.
Works in the scaled states of a SampledPlant; `mean` and `standard_deviations` are in the user's units.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.families.vlambda.eigenfactor import (
    Eigenfactors,
    eigenfactors_of,
    measurement_update,
    time_update,
    whiten,
)
from occontrol.families.vlambda.eigenfactor_covariance import measurement_update_covariance, time_update_covariance

OVERFLOW = 1e140  # of a deviation; its square must stay finite, with room for the products of the next step
LOSS = 1e-12  # estimated relative error of a time update in information form above which the covariance form is tried


@dataclass
class EigenfactorFilter:
    """State of the filter: eigenfactors of the error covariance and the mean, before or after a measurement.

    Parameters
    ----------
    factors : Eigenfactors of the covariance (n, n)
    mean : (n,)
    step : k of the covariance
    fallbacks : steps that were done in covariance form, with the estimated loss of the information form
    """

    factors: Eigenfactors
    mean: np.ndarray
    step: int = 0
    fallbacks: list[tuple[int, str]] = field(default_factory=list)

    @classmethod
    def start(cls, covariance: np.ndarray, mean: np.ndarray) -> EigenfactorFilter:
        """From the covariance (n, n), which may be singular, and the mean (n,) of x(0)."""
        return cls(eigenfactors_of(covariance), np.asarray(mean, dtype=float))

    def measure(self, rows: np.ndarray, values: np.ndarray | None = None) -> float:
        """Take a whitened measurement in; returns the normalised innovation squared.

        Parameters
        ----------
        rows : (m, n) R^{-1/2} H
        values : (m,) R^{-1/2} y; None updates the covariance alone and returns NaN
        """
        update = measurement_update if self.factors.invertible else measurement_update_covariance
        if not self.factors.invertible:
            self.fallbacks.append((self.step, "the covariance is singular"))
        self.factors, self.mean, innovation = update(self.factors, self.mean, rows, values)
        return innovation

    def observe(self, H: np.ndarray, R: np.ndarray, y: np.ndarray) -> float:
        """`measure` for a measurement y (m,) = H x + v with cov v = R that is not whitened yet."""
        rows, values = whiten(R, H, y)
        return self.measure(rows, values)

    def propagate(self, transition: np.ndarray, noise_root: np.ndarray) -> None:
        """Go from P(k|k) to P(k+1|k).

        Parameters
        ----------
        transition : (n, n) F
        noise_root : (n, p) G Q^{1/2}
        """
        loss = 1.0
        if self.factors.invertible:
            result = time_update(self.factors, transition, noise_root)
            loss = result.loss
        if loss > LOSS or not self.factors.invertible:
            other = time_update_covariance(self.factors, transition, noise_root)
            if not self.factors.invertible or loss == 1.0 or other.loss <= loss:
                if self.factors.invertible:
                    reason = (
                        "F is singular" if loss == 1.0 else f"the information form would lose {digits(loss)} digits"
                    )
                else:
                    reason = "the covariance is singular"
                self.fallbacks.append((self.step, reason))
                result = other
        self.factors, self.mean = result.factors, transition @ self.mean  # type: ignore[assignment]
        self.step += 1
        if not self.factors.deviations[0] < OVERFLOW:
            raise SolveFailed(
                f"the error covariance overflows at k = {self.step}\n"
                "  hint: an unstable direction is not measured; fewer steps, or a sensor that sees it"
            )

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
