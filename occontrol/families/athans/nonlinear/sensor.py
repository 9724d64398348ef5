"""Sensors given by formulas of the states of a FormulaPlant.

z = h(x, t) + noise,   noise of intensity (of one reading: covariance) Theta(x, t);   usable while visible(x, t) > 0
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from occontrol.core.errors import Collector, Mistake, plural
from occontrol.core.formulas import Compiled, check_formulas
from occontrol.core.kinds import CasadiFunction, SignalField, unless_given
from occontrol.core.sensor import check_name
from occontrol.core.signal import as_signal
from occontrol.families.athans.nonlinear.plant import FormulaPlant, Rows


@dataclass(frozen=True, eq=False)
class FormulaSensor(Compiled):
    """One sensor (or a group that reports together) of a nonlinear plant.

    Parameters
    ----------
    name : str, unique within a suite
    h : (m,) formulas of states, parameters and time; [measurement unit]
    noise : (m, m) rows of numbers or formulas of states and time: intensity Theta, [measurement unit]^2 * time, or the
        covariance of one reading where readings are taken at instants
    plant : whose names the formulas use
    cost : cost rate, or price of one reading, a number or a formula of time
    angle : whether the values are angles [rad], whose differences are taken between -pi and pi; or one answer per value
    visible : formula; the sensor can be used while it is above 0 along the path, and a reading is lost otherwise
    windows : list of times (start, end) inside which the sensor may be used; None is always

    Raises ProblemError naming every mistake.
    """

    name: str
    h: Sequence[float | str]
    noise: Rows
    plant: FormulaPlant
    cost: SignalField = unless_given(0.0)
    angle: bool | Sequence[bool] = False
    visible: float | str | None = None
    windows: Sequence[Sequence[float]] | None = None

    def __post_init__(self) -> None:
        found, set_ = Collector(), object.__setattr__
        variables = (*self.plant.names, self.plant.variable)
        check_name(self.name, found)
        set_(self, "h", tuple(self.h))
        m = len(self.h)
        if not m:
            found.add(("h",), f"h of sensor '{self.name}' is empty", "one formula per value; write idle for no sensor")
        found.mistakes += check_formulas(self.h, variables, "h")
        set_(self, "noise", tuple(tuple(row) for row in self.noise))
        if any(len(row) != m for row in self.noise) or len(self.noise) != m:
            rows = f"{len(self.noise)}x{len(self.noise[0]) if self.noise else 0}"
            what = f"noise of sensor '{self.name}' is {rows}, its h has {plural(m, 'value')}"
            found.add(("noise",), what, f"it must be {m}x{m}")
        for i, row in enumerate(self.noise):
            for j, entry in enumerate(row):
                if isinstance(entry, str):
                    found.mistakes += [w.moved(("noise", i, j)) for w in check_formulas([entry], variables, "noise")]
                elif not math.isfinite(entry):
                    found.add(("noise", i, j), f"noise of sensor '{self.name}' is not finite")
        with found.under("cost"):
            set_(self, "cost", as_signal(self.cost, self.plant.variable))
        angles = (self.angle,) * m if isinstance(self.angle, bool) else tuple(self.angle)
        if len(angles) != m or not all(isinstance(a, bool) for a in angles):
            what = f"angle of sensor '{self.name}' has {len(angles)} entries, its h has {plural(m, 'value')}"
            found.add(("angle",), what, "true, false, or one of them per value")
        set_(self, "angle", angles)
        if self.visible is not None:
            wrong = check_formulas([self.visible], variables, "visible")
            found.mistakes += [Mistake(("visible",), w.what, w.hint) for w in wrong]
        found.raise_if_any()

    @property
    def rows(self) -> int:
        """The number m of values that one measurement has."""
        return len(self.h)

    @property
    def angles(self) -> tuple[bool, ...]:
        """(m,) which values are angles."""
        return (self.angle,) * self.rows if isinstance(self.angle, bool) else tuple(self.angle)

    def values(self) -> CasadiFunction:
        """(x, t) -> h (m, 1)."""
        return self._kept("values", lambda: self.plant.function("h", self.h, (self.rows, 1)))

    def slope(self) -> CasadiFunction:
        """(x, t) -> dh/dx (m, n)."""
        import casadi

        def made() -> CasadiFunction:
            x, t = casadi.SX.sym("x", len(self.plant.names)), casadi.SX.sym("t")
            jacobian = casadi.jacobian(self.values()(x, t), x)
            return casadi.Function("slope", [x, t], [casadi.densify(jacobian)])

        return self._kept("slope", made)

    def covariance(self) -> CasadiFunction:
        """(x, t) -> Theta (m, m)."""
        flat = [entry for row in self.noise for entry in row]
        return self._kept("covariance", lambda: self.plant.function("theta", flat, (self.rows, self.rows)))

    def seen(self) -> CasadiFunction | None:
        """(x, t) -> a number above 0 where the sensor can be used; None: everywhere."""
        if self.visible is None:
            return None
        formula = self.visible
        return self._kept("seen", lambda: self.plant.function("seen", [formula], (1, 1)))

    def report(self) -> CasadiFunction:
        """(x, t) -> h (m, 1), dh/dx (m, n), Theta (m, m), and a number above 0 where the sensor can be used."""
        import casadi

        def made() -> CasadiFunction:
            x, t = casadi.SX.sym("x", len(self.plant.names)), casadi.SX.sym("t")
            there = casadi.SX(1) if self.visible is None else self.seen()(x, t)  # type: ignore[misc]
            parts = [self.values()(x, t), self.slope()(x, t), self.covariance()(x, t), there]
            return casadi.Function("report", [x, t], parts)

        return self._kept("report", made)

    def _kept(self, name: str, make) -> CasadiFunction:
        key = f"_function_{name}"
        if key not in self.__dict__:
            self.__dict__[key] = make()
        return self.__dict__[key]
