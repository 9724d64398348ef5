"""Signals whose rows and columns are multiplied by constants: the same function of time in other units.

Every kind of signal stays of its kind, so that whatever looks at its breaks, its formulas or its table still does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import singledispatch

import numpy as np

from occontrol.core.kinds import Plain
from occontrol.core.signal import ConstantSignal, ExpressionSignal, Signal, TableSignal


@dataclass(frozen=True, eq=False)
class ScaledSignal(Signal):
    """factor_ij times entry ij of another signal.

    Parameters
    ----------
    inner : Signal
    factor : (rows, columns), scaled units over those of the signal
    """

    inner: Signal
    factor: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        return self.inner.shape

    @property
    def constant(self) -> bool:  # type: ignore[override]
        return self.inner.constant

    def breaks(self, start: float, end: float) -> np.ndarray:
        """Jumps and bends (K,), at least those between `start` and `end`, all in the unit of time."""
        return self.inner.breaks(start, end)

    def at(self, t: float) -> np.ndarray:
        return self.inner.at(t) * self.factor

    def sample(self, times: np.ndarray) -> np.ndarray:
        """The scaled (K, rows, columns) matrices at `times` (K,), in the unit of time."""
        return self.inner.sample(times) * self.factor

    def document(self) -> Plain:
        raise NotImplementedError("a signal in scaled units stands in no problem file")


@dataclass(frozen=True, eq=False)
class ScaledExpression(ExpressionSignal):
    """Formulas, each multiplied by a constant.

    Parameters
    ----------
    factor : (rows, columns), scaled units over those of the signal
    """

    factor: float | np.ndarray = 1.0

    def sample(self, times: np.ndarray) -> np.ndarray:
        """The scaled (K, rows, columns) matrices at `times` (K,), in the unit of time."""
        return super().sample(times) * self.factor

    def __getstate__(self) -> dict:
        return {**super().__getstate__(), "factor": self.factor}

    def document(self) -> Plain:
        raise NotImplementedError("a signal in scaled units stands in no problem file")


@singledispatch
def scaled(signal: Signal, left: np.ndarray, right: np.ndarray) -> Signal:
    """diag(left) S(t) diag(right).

    Parameters
    ----------
    signal : Signal, (rows, columns)
    left, right : (rows,) and (columns,), scaled units over those of the signal; with powers of two nothing is rounded
    """
    return ScaledSignal(signal, np.outer(left, right))


@scaled.register
def _(signal: ConstantSignal, left: np.ndarray, right: np.ndarray) -> Signal:
    return ConstantSignal(signal.value * np.outer(left, right))


@scaled.register
def _(signal: TableSignal, left: np.ndarray, right: np.ndarray) -> Signal:
    return replace(signal, values=signal.values * np.outer(left, right))


@scaled.register
def _(signal: ExpressionSignal, left: np.ndarray, right: np.ndarray) -> Signal:
    return ScaledExpression(signal.entries, signal.variable, np.outer(left, right))


@scaled.register
def _(signal: ScaledExpression, left: np.ndarray, right: np.ndarray) -> Signal:
    return replace(signal, factor=signal.factor * np.outer(left, right))
