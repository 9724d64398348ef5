"""Plants: what moves, what drives it, and what is known at the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.checks import check_covariance, check_shape
from occontrol.core.errors import Collector, Mistake, ProblemError
from occontrol.core.kinds import ArrayField, OptionalSignalField, SignalField, VectorField, unless_given
from occontrol.core.signal import Signal, as_signal
from occontrol.core.state_labels import wrong_labels


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """A linear plant driven by white noise and a known input.

    dx/dt = A(t) x + B(t) u(t) + xi,   cov xi = Xi(t) delta,   E x(t0) = mean,   cov x(t0) = covariance

    Parameters
    ----------
    A : (n, n) 1/time; number, rows, array, formulas of t, or a Signal
    noise : (n, n) intensity Xi, [state unit]^2/time, symmetric positive semidefinite
    covariance : (n, n) initial error covariance, [state unit]^2, symmetric positive semidefinite (may be singular)
    mean : (n,) initial mean, in state units; zero if left out
    B : (n, r) input matrix, [state unit]/([input unit] time), optional
    input : (r,) entries u(t), in input units, numbers or formulas of t; needed when B is given
    names, units : what the states are called and their units, n each, for formulas and labels; x1, x2, .. if left out

    Raises ProblemError naming every matrix of the wrong shape or definiteness.
    Athans (1971), equations (2.1)-(2.8).
    """

    A: SignalField
    noise: SignalField
    covariance: ArrayField
    mean: VectorField = unless_given(None)
    B: OptionalSignalField = unless_given(None)
    input: OptionalSignalField = unless_given(None)
    names: Sequence[str] = ()
    units: Sequence[str] = ()

    def __post_init__(self) -> None:
        found = Collector()
        for name in ("A", "noise", "B", "input"):
            value = getattr(self, name)
            if value is None:
                continue
            with found.under(name):
                if name == "input" and isinstance(value, list | tuple | np.ndarray) and np.ndim(value) == 1:
                    value = [[entry] for entry in value]
                object.__setattr__(self, name, as_signal(value))
        with found.under("covariance"):
            object.__setattr__(self, "covariance", as_signal(self.covariance).at(0.0))
        found.raise_if_any()
        n = self.A.shape[0]
        mean = np.zeros(n) if self.mean is None else np.atleast_1d(np.asarray(self.mean, dtype=float)).ravel()
        object.__setattr__(self, "mean", mean)
        if self.A.shape[1] != n:  # then the number of states is not known
            what = f"A is {n}x{self.A.shape[1]}, it must be square"
            raise ProblemError(Mistake(("A",), what, "one row and one column per state"))
        hint = f"the plant has {n} state{'s' * (n != 1)}"
        mistakes = check_shape("noise of the plant", self.noise.shape, n, n, ("noise",), hint)
        wrong = check_shape("covariance", self.covariance.shape, n, n, ("covariance",), hint)
        mistakes += wrong or check_covariance("covariance", self.covariance, ("covariance",))
        if len(mean) != n:
            entries = f"{len(mean)} entr{'y' if len(mean) == 1 else 'ies'}"
            mistakes.append(Mistake(("mean",), f"mean has {entries}, {hint}", "one entry per state"))
        elif not np.all(np.isfinite(mean)):
            mistakes.append(Mistake(("mean",), "mean is not finite"))
        if self.B is not None:
            mistakes += check_shape("B", self.B.shape, n, None, ("B",), hint)
            if self.input is None:
                hint = "add input: [..], one entry per column of B"
                mistakes.append(Mistake(("B",), "B is given without input", hint))
            else:
                shape, hint = self.input.shape, "one entry per column of B"
                mistakes += check_shape("input", shape, self.B.shape[1], 1, ("input",), hint)
        elif self.input is not None:
            mistakes.append(Mistake(("input",), "input is given without B", "add B, one column per entry of input"))
        mistakes += wrong_labels(self.names, self.units, n)
        if mistakes:
            raise ProblemError(mistakes)

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.A.shape[0]

    @property
    def signals(self) -> dict[str, Signal]:
        """The time functions of the plant, by name."""
        named = {"A": self.A, "noise": self.noise, "B": self.B, "input": self.input}
        return {name: signal for name, signal in named.items() if signal is not None}


@dataclass(frozen=True, eq=False)
class DiscretePlant:
    """A linear plant in discrete time, driven by white noise; every matrix may depend on the step k.

    x(k+1) = F(k) x(k) + G(k) w(k),   cov w(k) = Q(k),   E x(0) = mean,   cov x(0) = covariance

    Parameters
    ----------
    F : (n, n) [state unit]/[state unit] a step; number, rows, array, formulas of k, or a Signal
    Q : (p, p) covariance of w(k), [unit of w]^2, symmetric positive semidefinite; a covariance, not an intensity
    covariance : (n, n) initial error covariance P(0|-1), [state unit]^2, symmetric positive semidefinite (may be
        singular)
    mean : (n,) initial mean, in state units; zero if left out
    G : (n, p) noise input matrix, [state unit]/[unit of w]; the identity if left out
    names, units : what the states are called and their units, n each, for formulas and labels; x1, x2, .. if left out

    Raises ProblemError naming every matrix of the wrong shape or definiteness.
    Oshman (1994), equation (1).
    """

    F: SignalField
    Q: SignalField
    covariance: ArrayField
    mean: VectorField = unless_given(None)
    G: OptionalSignalField = unless_given(None)
    names: Sequence[str] = ()
    units: Sequence[str] = ()

    def __post_init__(self) -> None:
        found = Collector()
        for name in ("F", "G", "Q"):
            if getattr(self, name) is not None:
                with found.under(name):
                    object.__setattr__(self, name, as_signal(getattr(self, name), "k"))
        with found.under("covariance"):
            object.__setattr__(self, "covariance", as_signal(self.covariance, "k").at(0.0))
        found.raise_if_any()
        n = self.F.shape[0]
        mean = np.zeros(n) if self.mean is None else np.atleast_1d(np.asarray(self.mean, dtype=float)).ravel()
        object.__setattr__(self, "mean", mean)
        mistakes = check_shape("F", self.F.shape, n, n, ("F",), "F is square: one row and one column per state")
        hint = f"the plant has {n} state{'s' * (n != 1)}"
        inputs, driven = n, hint
        if self.G is not None:
            mistakes += check_shape("G", self.G.shape, n, None, ("G",), hint)
            inputs = self.G.shape[1]
            driven = f"G has {inputs} column{'s' * (inputs != 1)}"
        mistakes += check_shape("Q", self.Q.shape, inputs, inputs, ("Q",), driven)
        wrong = check_shape("covariance", self.covariance.shape, n, n, ("covariance",), hint)
        mistakes += wrong or check_covariance("covariance", self.covariance, ("covariance",))
        if len(mean) != n:
            entries = f"{len(mean)} entr{'y' if len(mean) == 1 else 'ies'}"
            mistakes.append(Mistake(("mean",), f"mean has {entries}, {hint}", "one entry per state"))
        elif not np.all(np.isfinite(mean)):
            mistakes.append(Mistake(("mean",), "mean is not finite"))
        mistakes += wrong_labels(self.names, self.units, n)
        if mistakes:
            raise ProblemError(mistakes)

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.F.shape[0]

    @property
    def signals(self) -> dict[str, Signal]:
        """The functions of k, by name."""
        named = {"F": self.F, "G": self.G, "Q": self.Q}
        return {name: signal for name, signal in named.items() if signal is not None}
