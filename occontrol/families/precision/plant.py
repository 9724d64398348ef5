"""Nonlinear plants in discrete time, from formulas or from a named model.

The right side is built once as a CasADi function of one state and evaluated for whole ensembles, a column per member.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from occontrol.core.checks import check_covariance, check_shape
from occontrol.core.errors import Collector
from occontrol.core.formulas import Compiled, check_formulas, stack_formulas, unknown_model
from occontrol.core.kinds import ArrayField, Casadi, CasadiFunction, VectorField, unless_given
from occontrol.numerics.flow import runge_kutta

LARGEST_SIZE = 2000


def _lorenz96(x: Casadi, t: Casadi, forcing: float) -> Casadi:
    """dx_i/dt = (x_{i+1} - x_{i-2}) x_{i-1} - x_i + F with cyclic indices; Das & Bhattacharya (19)."""
    import casadi

    n = x.shape[0]

    def shifted(by: int) -> Casadi:
        return casadi.vertcat(*[x[(i + by) % n] for i in range(n)])

    return (shifted(1) - shifted(-2)) * shifted(-1) - x + forcing


# name: (right side, {parameter: default}, fewest states)
PLANT_MODELS: dict[str, tuple[Callable, dict[str, float], int]] = {"lorenz96": (_lorenz96, {"forcing": 8.0}, 4)}


@dataclass(frozen=True, eq=False)
class NonlinearPlant(Compiled):
    """A plant that moves by x_{k+1} = f(x_k) + w_k, cov w_k = noise; E x_0 = mean, cov x_0 = covariance.

    Parameters
    ----------
    covariance : (n, n) of the initial error, symmetric positive semidefinite
    mean : (n,) initial mean; zero if left out
    f : n formulas of x1 .. xn and t (numbers are allowed); or give `model`
    model : a name in PLANT_MODELS, with `parameters`
    step : for dx/dt = f: length of one Runge-Kutta step of order four; None: f itself is the next state, t = k
    substeps : Runge-Kutta steps from k to k+1
    noise : (n, n) covariance added at every k, [state unit]^2; zero if left out

    Raises ProblemError naming every mistake. Das & Bhattacharya, equations (1) and (19).
    """

    covariance: ArrayField
    mean: VectorField = unless_given(None)
    f: Sequence[float | str] | None = None
    model: str | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    step: float | None = None
    substeps: int = 1
    noise: ArrayField = unless_given(None)

    def __post_init__(self) -> None:
        found = Collector()
        covariance = np.atleast_2d(np.asarray(self.covariance, dtype=float))
        object.__setattr__(self, "covariance", covariance)
        n = covariance.shape[0]
        hint = f"the plant has {n} state{'s' * (n != 1)}"
        found.mistakes += check_covariance("covariance", covariance, ("covariance",))
        mean = np.zeros(n) if self.mean is None else np.asarray(self.mean, dtype=float).ravel()
        object.__setattr__(self, "mean", mean)
        if len(mean) != n:
            found.add(("mean",), f"mean has {len(mean)} entries, the covariance is {n}x{n}", "one entry per state")
        elif not np.all(np.isfinite(mean)):
            found.add(("mean",), "mean is not finite")
        noise = np.zeros((n, n)) if self.noise is None else np.atleast_2d(np.asarray(self.noise, dtype=float))
        object.__setattr__(self, "noise", noise)
        found.mistakes += check_shape("noise", noise.shape, n, n, ("noise",), hint) or check_covariance(
            "noise", noise, ("noise",)
        )
        if (self.f is None) == (self.model is None):
            found.add((), "the plant needs either f or model", "f: [formulas of x1 .. xn, t], or model: lorenz96")
        elif self.f is not None:
            object.__setattr__(self, "f", tuple(self.f))
            if len(self.f) != n:
                found.add(("f",), f"f has {len(self.f)} entries, {hint}", "one formula per state")
            found.mistakes += check_formulas(self.f, self._names, "f")
        elif self.model not in PLANT_MODELS:
            found.mistakes.append(unknown_model("plant", str(self.model), list(PLANT_MODELS)))
        else:
            _, defaults, fewest = PLANT_MODELS[self.model]
            if n < fewest:
                found.add(("size",), f"{self.model} has {n} states, it needs at least {fewest}")
            if self.step is None:
                found.add(("step",), f"{self.model} needs a step", "the length of one Runge-Kutta step, e.g. 0.05")
            for key in set(self.parameters) - set(defaults):
                found.add(
                    (key,), f"{self.model} has no parameter '{key}'", "parameters: " + ", ".join(defaults), key=True
                )
        if self.step is not None and not (np.isfinite(self.step) and self.step > 0):
            found.add(("step",), f"step is {self.step:g}", "step > 0")
        if isinstance(self.substeps, bool) or int(self.substeps) != self.substeps or not 1 <= self.substeps <= 100_000:
            found.add(("substeps",), f"substeps is {self.substeps}", "a whole number, at least 1")
        if n > LARGEST_SIZE:
            found.add(("size",), f"the plant has {n} states, the limit is {LARGEST_SIZE}")
        found.raise_if_any()

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.covariance.shape[0]

    @property
    def interval(self) -> float:
        """Time from k to k+1."""
        return 1.0 if self.step is None else self.step * self.substeps

    @property
    def _names(self) -> tuple[str, ...]:
        return (*[f"x{i + 1}" for i in range(self.states)], "t")

    @cached_property
    def _function(self) -> CasadiFunction:
        """One substep (or the map itself): (x, t) -> x."""
        import casadi

        x, t = casadi.SX.sym("x", self.states), casadi.SX.sym("t")

        def right(state: Casadi, time: Casadi) -> Casadi:
            if self.model is not None:
                function, defaults, _ = PLANT_MODELS[self.model]
                return function(state, time, **{**defaults, **self.parameters})
            symbols = {f"x{i + 1}": state[i] for i in range(self.states)}
            return stack_formulas(self.f or (), self._names, symbols | {"t": time})

        if self.step is None:
            return casadi.Function("map", [x, t], [right(x, t)])
        return casadi.Function("substep", [x, t], [runge_kutta(right, x, t, self.step)])

    @cached_property
    def _function_jacobian(self) -> CasadiFunction:
        import casadi

        x, t = casadi.SX.sym("x", self.states), casadi.SX.sym("t")
        return casadi.Function("jacobian", [x, t], [casadi.jacobian(self._function(x, t), x)])

    def advance(self, states: np.ndarray, time: float) -> np.ndarray:
        """The noise-free states one step later, (n, N) -> (n, N), one column per member; `time` is that of k."""
        states = np.asarray(states, dtype=float)
        count = 1 if self.step is None else self.substeps
        for i in range(count):
            states = np.array(self._function(states, time + i * (self.step or 0.0)))
        return states

    def jacobian(self, state: np.ndarray, time: float) -> np.ndarray:
        """(n, n) derivative of `advance` at one state (n,)."""
        matrix, x = np.eye(self.states), np.asarray(state, dtype=float).reshape(-1, 1)
        for i in range(1 if self.step is None else self.substeps):
            t = time + i * (self.step or 0.0)
            matrix = np.array(self._function_jacobian(x, t)) @ matrix
            x = np.array(self._function(x, t))
        return matrix
