"""An uncertain plant: what is known of it, and how much energy the rest may have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.checks import check_covariance, check_shape
from occontrol.core.errors import Collector, Mistake, ProblemError
from occontrol.core.kinds import ArrayField, SignalField, VectorField, unless_given
from occontrol.core.signal import Signal, as_signal
from occontrol.core.state_labels import wrong_labels


@dataclass(frozen=True, eq=False)
class UncertainPlant:
    """A linear plant with unknown, energy-bounded inputs.

    dx/dt = A(t) x + B(t) w,   z = K(t) x,   y = C x + v,
    (x(0) - x0)' X0 (x(0) - x0) + int_0^s |w|^2 + |v|^2 dt  <=  d + int_0^s |z|^2 dt

    Any w = Delta1 z, v = Delta2 z with a norm of at most one belongs to it, and so do many dynamic uncertainties.

    Parameters
    ----------
    A : (n, n) 1/time; number, rows, array, formulas of t, or a Signal
    B : (n, p) how the unknown input enters
    K : (q, n) uncertainty output; a zero K leaves a plant without model uncertainty
    weight : (n, n) X0, symmetric positive definite: the inverse of the initial shape
    center : (n,) x0, zero if left out
    level : d > 0
    names, units : of the states, labels only; x1, x2, .. and none if left out

    Raises ProblemError naming every matrix of the wrong shape or definiteness.
    Savkin, Evans & Skafidas, equations (1), (2), (12), (15).
    """

    A: SignalField
    B: SignalField
    K: SignalField
    weight: ArrayField
    center: VectorField = unless_given(None)
    level: float = 1.0
    names: Sequence[str] = ()
    units: Sequence[str] = ()

    def __post_init__(self) -> None:
        found = Collector()
        for name in ("A", "B", "K"):
            with found.under(name):
                object.__setattr__(self, name, as_signal(getattr(self, name)))
        with found.under("weight"):
            object.__setattr__(self, "weight", as_signal(self.weight).at(0.0))
        found.raise_if_any()
        n = self.A.shape[0]
        center = np.zeros(n) if self.center is None else np.atleast_1d(np.asarray(self.center, dtype=float)).ravel()
        object.__setattr__(self, "center", center)
        plural = f"{n} state{'s' * (n != 1)}"
        hint = f"the plant has {plural}"
        mistakes = check_shape("A", self.A.shape, n, n, ("A",), "A is square: one row and one column per state")
        mistakes += check_shape("B", self.B.shape, n, None, ("B",), hint)
        mistakes += check_shape("K", self.K.shape, None, n, ("K",), hint)
        wrong = check_shape("weight", self.weight.shape, n, n, ("weight",), hint)
        mistakes += wrong or check_covariance("weight", self.weight, ("weight",), definite=True)
        if len(center) != n:
            what = f"center has {len(center)} entr{'y' if len(center) == 1 else 'ies'}, the plant has {plural}"
            mistakes.append(Mistake(("center",), what, "one entry per state"))
        elif not np.all(np.isfinite(center)):
            mistakes.append(Mistake(("center",), "center is not finite"))
        if not (np.isfinite(self.level) and self.level > 0):
            mistakes.append(Mistake(("level",), f"level is {self.level:g}", "level > 0: the energy that is available"))
        mistakes += wrong_labels(self.names, self.units, n)
        if mistakes:
            raise ProblemError(mistakes)
        object.__setattr__(self, "weight", (self.weight + self.weight.T) / 2)

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.A.shape[0]

    @property
    def signals(self) -> dict[str, Signal]:
        """The time functions of the plant, by name."""
        return {"A": self.A, "B": self.B, "K": self.K}
