"""Jumping-mode plants: a linear plant whose matrices depend on a discrete mode that jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.checks import check_covariance, check_shape
from occontrol.core.errors import Collector, Mistake, ProblemError, plural
from occontrol.core.kinds import (
    ArrayField,
    Kept,
    MatrixLike,
    OptionalSignalField,
    SignalField,
    VectorField,
    unless_given,
)
from occontrol.core.signal import Signal, as_signal
from occontrol.families.hybrid.guard import Guard, Threshold, check_guards
from occontrol.families.hybrid.probabilities import check_distribution, check_vector, normalised


@dataclass(frozen=True, eq=False)
class Mode:
    """What the plant does while it is in one mode.

    x(k) = A x(k-1) + B u(k) + F w(k),   cov w(k) = W

    Parameters
    ----------
    name : str, unique among the modes of a plant
    A : (n, n) number, rows, array, formulas of k, or a Signal
    W : (q, q) covariance of the noise, symmetric positive semidefinite
    F : (n, q) how the noise enters; the identity if left out
    B : (n, r) input matrix, optional
    input : (r,) entries u(k), numbers or formulas of k; needed when B is given

    Raises ProblemError for a wrong shape. Liu & Hwang, equation (1).
    """

    name: str
    A: SignalField
    W: SignalField
    F: Kept[MatrixLike | None, Signal] = unless_given(None)
    B: OptionalSignalField = unless_given(None)
    input: OptionalSignalField = unless_given(None)

    def __post_init__(self) -> None:
        found = Collector()
        for name in ("A", "W", "F", "B", "input"):
            value = getattr(self, name)
            if value is None:
                continue
            with found.under(name):
                if name == "input" and isinstance(value, list | tuple | np.ndarray) and np.ndim(value) == 1:
                    value = [[entry] for entry in value]
                object.__setattr__(self, name, as_signal(value, "k"))
        found.raise_if_any()
        n, of = self.A.shape[0], f"of mode '{self.name}'"
        hint = f"the mode has {plural(n, 'state')}"
        wrong = check_shape(f"A {of}", self.A.shape, n, n, ("A",), "A is square: one row and one column per state")
        if self.F is None:
            object.__setattr__(self, "F", as_signal(np.eye(n), "k"))
            wrong += check_shape(f"W {of}", self.W.shape, n, n, ("W",), f"{hint}; give F if the noise has another size")
        else:
            wrong += check_shape(f"F {of}", self.F.shape, n, None, ("F",), hint)
            q = self.F.shape[1]
            wrong += check_shape(f"W {of}", self.W.shape, q, q, ("W",), f"F has {plural(q, 'column')}")
        if self.B is not None:
            wrong += check_shape(f"B {of}", self.B.shape, n, None, ("B",), hint)
            if self.input is None:
                wrong.append(Mistake(("B",), f"B {of} is given without input", "add input: [..], one entry per column"))
            else:
                r = self.B.shape[1]
                wrong += check_shape(f"input {of}", self.input.shape, r, 1, ("input",), "one entry per column of B")
        elif self.input is not None:
            wrong.append(Mistake(("input",), f"input {of} is given without B", "add B, one column per entry of input"))
        if wrong:
            raise ProblemError(wrong)

    @property
    def signals(self) -> dict[str, Signal]:
        """The matrices of the mode that are given, by name."""
        named = {"A": self.A, "F": self.F, "W": self.W, "B": self.B, "input": self.input}
        return {name: signal for name, signal in named.items() if signal is not None}


@dataclass(frozen=True, eq=False)
class JumpPlant:
    """A stochastic linear hybrid plant: modes, how they follow each other, and what is known at k = 0.

    Pr{q(k+1) = j | q(k) = i} = Gamma_ij (row = from), or a guard on the state leads from i to j

    Parameters
    ----------
    modes : sequence of Mode with the same number of states
    covariance : (n, n) of the state at k = 0, symmetric positive semidefinite
    mean : (n,) zero if left out
    probabilities : (modes,) of the mode at k = 0; equal ones if left out
    transition_matrix : (modes, modes) rows sum to 1; or
    guards : sequence of Guard
    threshold : Threshold, the random part of the guards; none if left out

    Raises ProblemError, with paths as in a problem file, for what does not fit and for modes that can never be reached.
    Liu & Hwang, equations (1)-(4).
    """

    modes: Sequence[Mode]
    covariance: ArrayField
    mean: VectorField = unless_given(None)
    probabilities: VectorField = unless_given(None)
    transition_matrix: Kept[MatrixLike | None, np.ndarray | None] = unless_given(None)
    guards: Sequence[Guard] | None = None
    threshold: Threshold | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "modes", tuple(self.modes))
        if not self.modes:
            raise ProblemError(Mistake(("modes",), "there is no mode", "give at least one"))
        n, count = self.states, len(self.modes)
        wrong, seen = [], set()
        for j, mode in enumerate(self.modes):
            if mode.name in seen:
                what = f"the name '{mode.name}' is used twice"
                wrong.append(Mistake(("modes", j, "name"), what, "mode names must differ"))
            seen.add(mode.name)
            if mode.A.shape[0] != n:
                size = mode.A.shape[0]
                what = f"A of mode '{mode.name}' is {size}x{size}, mode '{self.modes[0].name}' has {n} states"
                wrong.append(Mistake(("modes", j, "A"), what, "all modes share one state"))
        mean = np.zeros(n) if self.mean is None else np.atleast_1d(np.asarray(self.mean, dtype=float)).ravel()
        object.__setattr__(self, "mean", mean)
        wrong += check_vector("mean", mean, n, ("initial", "mean"), f"the modes have {n} states")
        covariance = as_signal(self.covariance, "k").at(0.0)
        object.__setattr__(self, "covariance", covariance)
        path, what = ("initial", "covariance"), "covariance"
        found = check_shape(what, covariance.shape, n, n, path, f"the modes have {n} states")
        wrong += found or check_covariance(what, covariance, path)
        given = np.full(count, 1.0 / count) if self.probabilities is None else self.probabilities
        chances = np.asarray(given, dtype=float).ravel()
        path = ("initial", "probabilities")
        found = check_vector("probabilities", chances, count, path, f"one per mode, there are {count}")
        found = found or check_distribution("probabilities", chances, self.names, path)
        object.__setattr__(self, "probabilities", chances if found else normalised(chances))
        wrong += found + self._transitions()
        wrong = wrong or self._unreachable()
        if wrong:
            raise ProblemError(wrong)

    def _transitions(self) -> list[Mistake]:
        if (self.transition_matrix is None) == (self.guards is None):
            what = "no matrix and no guards" if self.guards is None else "both a matrix and guards"
            return [Mistake(("transition",), f"transition has {what}", "matrix: [[..]] (row = from) or guards: [..]")]
        if self.guards is not None:
            object.__setattr__(self, "guards", tuple(self.guards))
            threshold = Threshold() if self.threshold is None else self.threshold
            object.__setattr__(self, "threshold", threshold)
            return check_guards(self.guards, threshold, self.names, self.states)
        path, count = ("transition", "matrix"), len(self.modes)
        if self.threshold is not None:
            what = "a threshold belongs to guards, there is a matrix"
            return [Mistake(("transition", "threshold"), what, "leave it out")]
        matrix = np.atleast_2d(np.asarray(self.transition_matrix, dtype=float))
        hint = f"one row and column per mode, there are {count}"
        found = check_shape("the transition matrix", matrix.shape, count, count, path, hint)
        if found:
            return found
        for i, row in enumerate(matrix):
            what = f"row {i + 1} of the transition matrix (from '{self.names[i]}')"
            found += check_distribution(what, row, self.names, (*path, i))
        if not found:
            matrix = normalised(matrix)
        object.__setattr__(self, "transition_matrix", matrix)
        return found

    def _unreachable(self) -> list[Mistake]:
        """Modes that no path of possible transitions joins to the modes that are possible at k = 0."""
        if self.guards is None:
            follows = np.asarray(self.transition_matrix) > 0
        else:
            follows = np.zeros((len(self.modes),) * 2, dtype=bool)
            for guard in self.guards:
                follows[self.names.index(guard.source), self.names.index(guard.target)] = True
        reached = np.asarray(self.probabilities) > 0
        for _ in self.modes:
            reached = reached | (reached @ follows)
        hint = "give it a probability at k = 0, or a transition into it; or leave the mode out"
        what = "can never be reached: it has no probability at k = 0 and no way leads to it"
        lost = [int(j) for j in np.flatnonzero(~reached)]
        return [Mistake(("modes", j), f"mode '{self.names[j]}' {what}", hint) for j in lost]

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.modes[0].A.shape[0]

    @property
    def names(self) -> list[str]:
        """The modes' names, in the user's order."""
        return [mode.name for mode in self.modes]
