"""Nonlinear measurements, one scalar sensor per entry, from formulas or from a named model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occontrol.core.errors import Collector
from occontrol.core.formulas import Compiled, check_formulas, stack_formulas, unknown_model
from occontrol.core.kinds import Casadi, CasadiFunction


def _sigmoid(x: Casadi, t: Casadi) -> Casadi:
    """y_i = 1/(1 + exp(-x_i)); Das & Bhattacharya (20)."""
    return 1 / (1 + _exp(-x))


def _identity(x: Casadi, t: Casadi) -> Casadi:
    """y_i = x_i."""
    return x


def _exp(x: Casadi) -> Casadi:
    import casadi

    return casadi.exp(x)


MEASUREMENT_MODELS: dict[str, Callable] = {"sigmoid": _sigmoid, "identity": _identity}


@dataclass(frozen=True, eq=False)
class NonlinearMeasurement(Compiled):
    """Noise-free measurements y = h(x), one scalar sensor per entry.

    Parameters
    ----------
    states : the number n of states
    h : formulas of x1 .. xn and t; or give `model`
    model : a name in MEASUREMENT_MODELS (one sensor per state)
    names : one per sensor; y1, y2, .. if left out

    Das & Bhattacharya, equations (2) and (20).
    """

    states: int
    h: Sequence[float | str] | None = None
    model: str | None = None
    names: Sequence[str] | None = None

    def __post_init__(self) -> None:
        found = Collector()
        if (self.h is None) == (self.model is None):
            found.add((), "the measurement needs either h or model", "h: [formulas of x1 .. xn], or model: sigmoid")
        elif self.h is not None:
            object.__setattr__(self, "h", tuple(self.h))
            if not self.h:
                found.add(("h",), "there is no sensor", "give at least one formula")
            found.mistakes += check_formulas(self.h, (*[f"x{i + 1}" for i in range(self.states)], "t"), "h")
        elif self.model not in MEASUREMENT_MODELS:
            found.mistakes.append(unknown_model("measurement", str(self.model), list(MEASUREMENT_MODELS)))
        count = self.sensors
        known = self.h is not None or self.model in MEASUREMENT_MODELS
        names = tuple(f"y{i + 1}" for i in range(count)) if self.names is None else tuple(self.names)
        object.__setattr__(self, "names", names)
        if known and len(names) != count:
            found.add(("names",), f"there are {len(names)} names for {count} sensors", "one name per sensor")
        for name in sorted({name for name in names if names.count(name) > 1}):
            found.add(("names",), f"the name '{name}' is used twice", "sensor names must differ")
        found.raise_if_any()

    @property
    def sensors(self) -> int:
        """The number of scalar sensors."""
        return self.states if self.h is None else len(self.h)

    @cached_property
    def _function(self) -> CasadiFunction:
        import casadi

        x, t = casadi.SX.sym("x", self.states), casadi.SX.sym("t")
        if self.model is not None:
            value = MEASUREMENT_MODELS[self.model](x, t)
        else:
            names = (*[f"x{i + 1}" for i in range(self.states)], "t")
            value = stack_formulas(self.h or (), names, {f"x{i + 1}": x[i] for i in range(self.states)} | {"t": t})
        return casadi.Function("measure", [x, t], [value, casadi.jacobian(value, x)])

    def values(self, states: np.ndarray, time: float) -> np.ndarray:
        """(m, N) measurements of states (n, N), one column per member."""
        return np.array(self._function(np.asarray(states, dtype=float), time)[0])

    def jacobian(self, state: np.ndarray, time: float) -> np.ndarray:
        """(m, n) derivative at one state (n,)."""
        return np.array(self._function(np.asarray(state, dtype=float).reshape(-1, 1), time)[1])
