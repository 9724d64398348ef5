"""Sensors of jumping-mode plants."""

from __future__ import annotations

from dataclasses import dataclass

from occontrol.core.errors import Collector, Mistake, ProblemError, plural
from occontrol.core.kinds import SignalField
from occontrol.core.signal import Signal, as_signal


@dataclass(frozen=True, eq=False)
class JumpSensor:
    """One sensor of a discrete-time plant.

    z(k) = C x(k) + v(k),   cov v(k) = R

    Parameters
    ----------
    name : str, unique among the sensors of a problem
    C : (p, n) number, rows, array, formulas of k, or a Signal
    R : (p, p) covariance, symmetric positive definite

    Raises ProblemError for a wrong shape. Liu & Hwang, equation (5).
    """

    name: str
    C: SignalField
    R: SignalField

    def __post_init__(self) -> None:
        found = Collector()
        for name in ("C", "R"):
            with found.under(name):
                object.__setattr__(self, name, as_signal(getattr(self, name), "k"))
        found.raise_if_any()
        p = self.rows
        if p == 0 or self.C.shape[1] == 0:
            raise ProblemError(Mistake(("C",), f"C of sensor '{self.name}' has no entries"))
        if self.R.shape != (p, p):
            rows, columns = self.R.shape
            what = f"R of sensor '{self.name}' is {rows}x{columns}, its C has {plural(p, 'row')}"
            raise ProblemError(Mistake(("R",), what, f"it must be {p}x{p}"))

    @property
    def rows(self) -> int:
        """The number p of values that one measurement has."""
        return self.C.shape[0]

    @property
    def signals(self) -> dict[str, Signal]:
        """The matrices of the sensor, by name."""
        return {"C": self.C, "R": self.R}
