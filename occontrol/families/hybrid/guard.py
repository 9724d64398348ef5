"""Guards: regions of the state that lead a plant from one mode to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.checks import check_covariance
from occontrol.core.errors import Mistake, ProblemError, plural, suggest
from occontrol.core.kinds import ArrayField, VectorField, unless_given
from occontrol.core.signal import as_signal

MOST_ROWS = 26  # rows of one guard; as many as the lattice rule of the normal probabilities has generators for


@dataclass(frozen=True, eq=False)
class Guard:
    """From one mode to another where a stochastic linear inequality holds.

    q(k+1) = target  if  q(k) = source  and  L [x(k); theta(k)] + b <= 0 in every row

    Parameters
    ----------
    source, target : names of modes; the same one twice says where the plant stays
    L : (v, n + l), n states and l entries of the threshold
    b : (v,)

    Raises ProblemError when L and b do not fit each other. Liu & Hwang, equation (4).
    """

    source: str
    target: str
    L: ArrayField
    b: VectorField

    def __post_init__(self) -> None:
        matrix = as_signal(self.L, "k")
        if not matrix.constant:
            what = f"L of the guard from '{self.source}' to '{self.target}' depends on k"
            raise ProblemError(Mistake(("L",), what, "guards are constant"))
        object.__setattr__(self, "L", matrix.at(0.0))
        object.__setattr__(self, "b", np.atleast_1d(np.asarray(self.b, dtype=float)).ravel())
        rows, name = self.L.shape[0], f"of the guard from '{self.source}' to '{self.target}'"
        if len(self.b) != rows:
            what = f"b {name} has length {len(self.b)}, L has {plural(rows, 'row')}"
            raise ProblemError(Mistake(("b",), what, "one entry of b per row of L"))
        if not np.all(np.isfinite(self.b)):
            raise ProblemError(Mistake(("b",), f"b {name} is not finite"))
        if rows > MOST_ROWS:
            raise ProblemError(Mistake(("L",), f"L {name} has {rows} rows, at most {MOST_ROWS} are possible"))


@dataclass(frozen=True, eq=False)
class Threshold:
    """The random part theta(k) of the guards, drawn anew at every step.

    theta ~ N(mean, covariance)

    Parameters
    ----------
    mean : (l,); empty if left out, then nothing in the guards is random
    covariance : (l, l) symmetric positive semidefinite

    Raises ProblemError when they do not fit each other. Liu & Hwang, below equation (4).
    """

    mean: VectorField = unless_given(())
    covariance: ArrayField = unless_given(None)

    def __post_init__(self) -> None:
        mean = np.atleast_1d(np.asarray(self.mean, dtype=float)).ravel()
        size = len(mean)
        object.__setattr__(self, "mean", mean)
        covariance = np.zeros((size, size)) if self.covariance is None else as_signal(self.covariance, "k").at(0.0)
        object.__setattr__(self, "covariance", covariance)
        if not np.all(np.isfinite(mean)):
            raise ProblemError(Mistake(("mean",), "mean of the threshold is not finite"))
        if covariance.shape != (size, size):
            rows, columns = covariance.shape
            what = f"covariance of the threshold is {rows}x{columns}, its mean has length {size}"
            raise ProblemError(Mistake(("covariance",), what, f"it must be {size}x{size}"))
        wrong = check_covariance("covariance of the threshold", covariance, ("covariance",))
        if wrong:
            raise ProblemError(wrong)

    @property
    def size(self) -> int:
        """The number l of entries."""
        return len(self.mean)


def check_guards(guards: Sequence[Guard], threshold: Threshold, modes: Sequence[str], states: int) -> list[Mistake]:
    """Whether the guards name existing modes, and have a column for every state and every entry of the threshold."""
    found = []
    for g, guard in enumerate(guards):
        path = ("transition", "guards", g)
        for key, name in (("from", guard.source), ("to", guard.target)):
            if name not in modes:
                what = f"'{key}' of guard {g + 1} names the unknown mode '{name}'"
                found.append(Mistake((*path, key), what, suggest(str(name), modes)))
        columns, wanted = guard.L.shape[1], states + threshold.size
        if columns != wanted:
            name = f"L of the guard from '{guard.source}' to '{guard.target}'"
            what = f"{name} has {plural(columns, 'column')}, it must have {wanted}"
            parts = f"one per state ({states}), then one per entry of the threshold's mean ({threshold.size})"
            found.append(Mistake((*path, "L"), what, parts))
    return found
