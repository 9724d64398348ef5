"""Plants given by formulas of named states: what is stated and checked, and the CasADi functions of it.

    dx/dt = f(x, t) + noise of intensity Xi(x, t),      or in discrete time   x(k+1) = next(x(k), k) + noise

A parameter is a state that does not move; it stands after the states, with a mean and a standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occontrol.core.checks import check_covariance, check_shape
from occontrol.core.errors import Collector, Mistake, plural
from occontrol.core.expression import parse_expression
from occontrol.core.formulas import Compiled, check_formulas, stack_formulas
from occontrol.core.jumps import require_still
from occontrol.core.kinds import ArrayField, Casadi, CasadiFunction, OptionalSignalField, VectorField, unless_given
from occontrol.core.signal import as_signal
from occontrol.core.state_labels import default_names, wrong_name
from occontrol.numerics.flow import Flow

Rows = Sequence[Sequence[float | str]]
UNKNOWN = "none"  # of a standard deviation


@dataclass(frozen=True, eq=False)
class FormulaPlant(Compiled):
    """A plant given by formulas of its states, its parameters and t (k in discrete time).

    Parameters
    ----------
    noise : (m, m) rows of numbers or formulas, intensity Xi, [state unit]^2/time; in discrete time the covariance of
        one step. It concerns the m states; parameters have none
    covariance : (m, m) of the initial error of the states, [state unit]^2, symmetric positive semidefinite
    mean : (m,) initial mean, in state units; zero if left out
    f : m formulas dx/dt, in state units per time, or
    next : m formulas of the state one step later, in state units
    states : names of the m states; x1, x2, .. if left out
    parameters : {name: {mean, sd}}, states that do not move; sd "none" where nothing is known of them, and all
        else is then known exactly at the start
    nominal : (n, 1) column of numbers or formulas of t, or a table: the path to linearise along, parameters included;
        the path from the initial mean if left out
    units : of states and parameters, n labels, or none

    Raises ProblemError naming every mistake.
    """

    noise: Rows
    covariance: ArrayField
    mean: VectorField = unless_given(None)
    f: Sequence[float | str] | None = None
    next: Sequence[float | str] | None = None
    states: Sequence[str] | None = None
    parameters: Mapping[str, Mapping[str, float | str]] | None = None
    nominal: OptionalSignalField = unless_given(None)
    units: Sequence[str] = ()

    def __post_init__(self) -> None:
        found, set_ = Collector(), object.__setattr__
        if (self.f is None) == (self.next is None):
            hint = "f: [formulas of dx/dt], or next: [formulas of the state one step later]"
            found.add((), "the plant needs either f or next", hint)
            found.raise_if_any()
        key = "f" if self.next is None else "next"
        formulas = tuple(self.f or self.next or ())
        set_(self, key, formulas)
        m = len(formulas)
        stated = tuple(default_names(m)) if self.states is None else tuple(self.states)
        set_(self, "states", stated)
        set_(self, "parameters", {} if self.parameters is None else dict(self.parameters))
        found.mistakes += wrong_names(stated, self.parameters or {})
        if len(stated) != m:
            what = f"{key} has {plural(m, 'entry').replace('entrys', 'entries')} for {plural(len(stated), 'state')}"
            found.add((key,), what, "one formula per state; a parameter needs none")
        found.raise_if_any()
        variables = (*self.names, self.variable)
        found.mistakes += check_formulas(formulas, variables, key)
        hint = f"the plant has {plural(m, 'state')} that move" if self.parameters else f"the plant has {m} states"
        set_(self, "noise", tuple(tuple(row) for row in self.noise))
        rows = {len(row) for row in self.noise}
        found.mistakes += check_shape("noise of the plant", (len(self.noise), max(rows)), m, m, ("noise",), hint)
        found.mistakes += [w for i, row in enumerate(self.noise) for w in _entries(row, variables, i)]
        S = np.atleast_2d(np.asarray(self.covariance, dtype=float))
        set_(self, "covariance", S)
        found.mistakes += check_shape("covariance", S.shape, m, m, ("covariance",), hint) or check_covariance(
            "covariance", S, ("covariance",)
        )
        mean = np.zeros(m) if self.mean is None else np.atleast_1d(np.asarray(self.mean, dtype=float)).ravel()
        set_(self, "mean", mean)
        if len(mean) != m:
            found.add(("mean",), f"mean has {len(mean)} entries, {hint}", "one entry per state")
        elif not np.all(np.isfinite(mean)):
            found.add(("mean",), "mean is not finite")
        if np.any(self.unknown) and np.any(self.whole_covariance):
            one = self.names[int(np.argmax(self.unknown))]
            what = f"nothing is known of '{one}', and something uncertain is known of the rest"
            found.add(("parameters", one, "sd"), what, "sd: 0 and a covariance of zeros, or sd: none, or a large sd")
        if self.nominal is not None:
            with found.under("nominal"):
                set_(self, "nominal", as_signal(self.nominal, self.variable))
                for row in getattr(self.nominal, "entries", ()):
                    for entry in row:
                        require_still(parse_expression(str(entry), (self.variable,)))
            n = len(self.names)
            shape = getattr(self.nominal, "shape", (n, 1))
            found.mistakes += check_shape("nominal", shape, n, 1, ("nominal",), "one column, one entry per state")
        found.raise_if_any()

    @property
    def formulas(self) -> tuple[float | str, ...]:
        """Those of f, or of next."""
        return tuple((self.f if self.next is None else self.next) or ())

    @property
    def discrete(self) -> bool:
        """Whether time is discrete."""
        return self.next is not None

    @property
    def variable(self) -> str:
        """What formulas call time."""
        return "k" if self.discrete else "t"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """States, then parameters."""
        return (*(self.states or ()), *(self.parameters or {}))

    @property
    def whole_mean(self) -> np.ndarray:
        """(n,) initial mean of states and parameters."""
        return np.append(self.mean, [float(p["mean"]) for p in (self.parameters or {}).values()])

    @property
    def whole_covariance(self) -> np.ndarray:
        """(n, n) of the initial error of states and parameters."""
        n, m = len(self.names), len(self.mean)
        S = np.zeros((n, n))
        S[:m, :m] = (self.covariance + self.covariance.T) / 2
        known = [0.0 if p["sd"] == UNKNOWN else float(p["sd"]) for p in (self.parameters or {}).values()]
        S[range(m, n), range(m, n)] = np.square(known)
        return S

    @property
    def unknown(self) -> np.ndarray:
        """(n,) whether nothing is known of a state beforehand."""
        return np.append(
            np.zeros(len(self.mean), dtype=bool), [p["sd"] == UNKNOWN for p in (self.parameters or {}).values()]
        ).astype(bool)

    def function(self, name: str, entries: Sequence[float | str], shape: tuple[int, int]) -> CasadiFunction:
        """(x, t) -> formulas as a matrix of CasADi, filled row by row.

        Parameters
        ----------
        name : of the function
        entries : rows x columns numbers or formulas of the names and of time
        shape : (rows, columns)
        """
        import casadi

        x, t = casadi.SX.sym("x", len(self.names)), casadi.SX.sym("t")
        value = casadi.reshape(self.stacked(entries, x, t), shape[1], shape[0]).T
        return casadi.Function(name, [x, t], [casadi.densify(value)])

    def stacked(self, entries: Sequence[float | str], x: Casadi, t: Casadi) -> Casadi:
        """The column of formulas over CasADi symbols: states and parameters `x` (n,), time `t`."""
        symbols = {name: x[i] for i, name in enumerate(self.names)} | {self.variable: t}
        return stack_formulas(entries, (*self.names, self.variable), symbols)

    @cached_property
    def _function_right(self) -> CasadiFunction:
        still = [name if self.discrete else 0.0 for name in (self.parameters or {})]
        entries = [*self.formulas, *still]
        return self.function("right", entries, (len(entries), 1))

    @cached_property
    def _function_noise(self) -> CasadiFunction:
        n, m = len(self.names), len(self.mean)
        rows = [[*row, *[0.0] * (n - m)] for row in self.noise] + [[0.0] * n] * (n - m)
        return self.function("noise", [entry for row in rows for entry in row], (n, n))

    @cached_property
    def _function_flow(self) -> Flow:
        return Flow(self._function_right, self._function_noise, len(self.names), self.discrete)

    @property
    def flow(self) -> Flow:
        """How it moves."""
        return self._function_flow

    @property
    def right(self) -> CasadiFunction:
        """(x, t) -> dx/dt, or the next state."""
        return self._function_right


def wrong_names(states: Sequence[str], parameters: Mapping[str, Mapping[str, float | str]]) -> list[Mistake]:
    """What is wrong with the names of states and parameters, and with the numbers of parameters.

    Parameters
    ----------
    states : their names
    parameters : {name: {mean, sd}}
    """
    found, names = Collector(), [*states, *parameters]
    for i, name in enumerate(names):
        if mistake := wrong_name(name, i, names):
            found.add(("states", i) if i < len(states) else ("parameters", name), *mistake)
    for name, stated in parameters.items():
        for key in ("mean", "sd"):
            value = stated.get(key) if isinstance(stated, Mapping) else None
            if key == "sd" and value == UNKNOWN:
                continue
            good = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
            if not good or (key == "sd" and float(value or 0.0) < 0):
                hint = f"{name}: {{mean: 0.5, sd: 0.1}}; sd: 0 where it is known"
                found.add(("parameters", name), f"parameter '{name}' has no usable '{key}'", hint)
    return found.mistakes


def _entries(row: Sequence[float | str], variables: tuple[str, ...], i: int) -> list[Mistake]:
    found = []
    for j, entry in enumerate(row):
        if isinstance(entry, str):
            found += [m.moved(("noise", i, j)) for m in check_formulas([entry], variables, "noise")]
        elif not math.isfinite(entry):
            found.append(Mistake(("noise", i, j), "noise of the plant is not finite"))
    return found
