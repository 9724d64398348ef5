"""The selection problem of Oshman (1994): a discrete-time plant, sensors of which a few are used at a time, epochs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from occontrol.core.calendar import Calendar
from occontrol.core.checks import check_covariance, check_covariance_signal, check_finite
from occontrol.core.errors import Collector, Mistake, plural
from occontrol.core.kinds import Kept, PlainMapping, VectorField, unless_given
from occontrol.core.plant import DiscretePlant
from occontrol.core.problem import BaseProblem
from occontrol.core.sensor import SensorSuite
from occontrol.core.signal import Signal, TableSignal
from occontrol.families.vlambda.methods import METHODS, Optimal, Rule
from occontrol.families.vlambda.sampled_plant import SampledPlant, sample_plant
from occontrol.families.vlambda.sensor import DiscreteSensor, LocatedMatrix

CRITERIA = ("largest-eigenvalue", "trace")
MOST_STEPS = 1_000_000
LOOKED_AT = 200


@dataclass(frozen=True, eq=False)
class Problem(BaseProblem):
    """At k % epoch == 0 choose `select` of M sensors from P(k|k-1), measure at every k, propagate with F(k).

    Parameters
    ----------
    name : str
    plant : DiscretePlant with n states
    sensors : SensorSuite or list of DiscreteSensor
    steps : K; k = 0 .. K-1
    epoch : steps between two choices
    select : sensors used at a time
    criterion : "largest-eigenvalue" or "trace" of P(k|k), summed over k; what `cost` is
    scales : (n,) size of one unit of each state: eigenvalues and traces are those of P_ij / (s_i s_j)
    method : an object of one of METHODS (methods.py), or None for the default
    expect : the known answer, if any
    calendar : what k = 0 is as a date, and what one step takes, or None

    Raises ProblemError naming every mistake by its place in a problem file.
    Oshman (1994), equations (1), (2) and remarks 1, 3, 5.
    """

    name: str
    plant: DiscretePlant
    sensors: Kept[Sequence[DiscreteSensor], SensorSuite[DiscreteSensor]]
    steps: int
    epoch: int = 1
    select: int = 1
    criterion: str = CRITERIA[0]
    scales: VectorField = unless_given(None)
    method: Rule | Optimal | None = None
    expect: PlainMapping | None = None
    calendar: Calendar | None = None
    family: str = field(default="vlambda", init=False)

    def __post_init__(self) -> None:
        found = Collector()
        if not isinstance(self.sensors, SensorSuite):
            with found.under("sensors"):
                object.__setattr__(self, "sensors", SensorSuite(tuple(self.sensors)))
        for key, most in (("steps", MOST_STEPS), ("epoch", None)):
            value = getattr(self, key)
            if isinstance(value, bool) or int(value) != value or value < 1 or (most and value > most):
                hint = f"a whole number from 1{f' to {most}' if most else ' on'}"
                found.add(("horizon", key), f"horizon.{key} is {value:g}", hint)
            else:
                object.__setattr__(self, key, int(value))
        if self.criterion not in CRITERIA:
            found.add(("criterion", "name"), f"unknown criterion '{self.criterion}'", "known: " + ", ".join(CRITERIA))
        n = self.plant.states
        scales = np.ones(n) if self.scales is None else np.atleast_1d(np.asarray(self.scales, dtype=float)).ravel()
        object.__setattr__(self, "scales", scales)
        if len(scales) != n:
            found.add(
                ("scales",),
                f"scales has {_entries(len(scales))}, the plant has {plural(n, 'state')}",
                "one entry per state",
            )
        elif not (np.all(np.isfinite(scales)) and np.all(scales > 0)):
            found.add(("scales",), "a scale is not a finite number above 0")
        named = isinstance(self.sensors, SensorSuite)
        if not named:  # repeated names do not hide what else is wrong
            object.__setattr__(self, "sensors", tuple(self.sensors))
        whole = ("horizon", "steps") not in {m.path for m in found.mistakes}
        found.mistakes += self._shapes(whole)
        found.mistakes += self._method() if named else []
        wrong = {m.path for m in found.mistakes}
        found.mistakes += [m for m in self._values() if m.path not in wrong] if whole else []
        found.raise_if_any()

    def _shapes(self, whole: bool) -> list[Mistake]:
        n, count, found = self.plant.states, len(self.sensors), []
        for j, sensor in enumerate(self.sensors):
            if sensor.H.shape[1] != n:
                rows, columns = sensor.H.shape
                what = f"H of sensor '{sensor.name}' is {rows}x{columns}, but the plant has {plural(n, 'state')}"
                found.append(Mistake(("sensors", j, "H"), what, "a row of H has one entry per state"))
        if isinstance(self.select, bool) or int(self.select) != self.select or not 1 <= self.select <= count:
            what = f"select is {self.select}, there {'is' if count == 1 else 'are'} {plural(count, 'sensor')}"
            found.append(Mistake(("select",), what, f"1 <= select <= {count}"))
        for path, signal in self.signals.items() if whole else ():
            if isinstance(signal, TableSignal) and not signal.covers(0.0, float(self.steps - 1)):
                span = f"[{signal.times[0]:g}, {signal.times[-1]:g}]"
                what = f"the table covers k in {span}, the horizon is k = 0 .. {self.steps - 1}"
                found.append(Mistake(path, what, "tabulate the whole horizon"))
        return found

    def _method(self) -> list[Mistake]:
        if self.method is None:
            return []
        if type(self.method) not in METHODS.values():
            what = f"{type(self.method).__name__} is not a method of family {self.family}"
            return [Mistake(("method",), what, "there are: " + ", ".join(METHODS))]
        return [m.under("method") for m in self.method.check(self)]

    def _values(self) -> list[Mistake]:
        """Definiteness and finiteness at every k."""
        k = np.arange(self.steps, dtype=float)
        plant = self.plant
        found = check_finite("F", plant.F, k, ("plant", "F"), "k")
        if plant.G is not None:
            found += check_finite("G", plant.G, k, ("plant", "G"), "k")
        found += check_covariance_signal("Q", plant.Q, k, ("plant", "Q"), variable="k")
        for j, sensor in enumerate(self.sensors):
            path, of = ("sensors", j), f"of sensor '{sensor.name}'"
            if sensor.movable:
                found += self._movable(sensor, path, of)
                continue
            found += check_finite(f"H {of}", sensor.H, k, (*path, "H"), "k")
            found += check_covariance_signal(f"R {of}", sensor.R, k, (*path, "R"), True, "k")
        return found

    def _movable(self, sensor: DiscreteSensor, path: tuple[str | int, ...], of: str) -> list[Mistake]:
        """H and R of a movable sensor at the corners and the middle of its box, at the first and the last k."""
        from itertools import product

        bounds = sensor.location.bounds  # type: ignore[union-attr]
        places = np.array([*product(*bounds[:8]), bounds[:8].mean(axis=1)])
        if len(bounds) > 8:
            places = np.concatenate([places, np.tile(bounds[8:].mean(axis=1), (len(places), 1))], axis=1)
        for k in sorted({0, self.steps // 2, self.steps - 1}):
            allowed = places[sensor.location.allowed(k, places)]  # type: ignore[union-attr]
            for p in allowed:
                where = f" at k = {k}, p = {', '.join(f'{x:.6g}' for x in p)}"
                H, R = (getattr(sensor, name).sample(np.array([float(k)]), p[None])[0] for name in ("H", "R"))
                if not np.all(np.isfinite(H)):
                    return [Mistake((*path, "H"), f"H {of} is not finite{where}", "it must be finite in the whole box")]
                wrong = check_covariance(f"R {of}", R, (*path, "R"), True, where)
                if wrong:
                    return wrong
        return []

    @property
    def signals(self) -> dict[tuple[str | int, ...], Signal | LocatedMatrix]:
        """Every function of k by its path in a problem file (those of movable sensors are not among them)."""
        named: dict[tuple[str | int, ...], Signal | LocatedMatrix] = {
            ("plant", key): s for key, s in self.plant.signals.items()
        }
        for j, sensor in enumerate(self.sensors):
            if not sensor.movable:
                named |= {("sensors", j, "H"): sensor.H, ("sensors", j, "R"): sensor.R}
        return named

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.plant.states

    @cached_property
    def starts(self) -> np.ndarray:
        """(E+1,) the k of every choice, then K."""
        return np.append(np.arange(0, self.steps, self.epoch), self.steps)

    @property
    def epochs(self) -> int:
        """The number E of choices."""
        return len(self.starts) - 1

    @property
    def movable(self) -> bool:
        """Whether any sensor can be moved."""
        return any(sensor.movable for sensor in self.sensors)

    def require_feasible(self) -> None:
        """Look for a place for every movable sensor where choices begin (at LOOKED_AT of them where there are more).

        Raises InfeasibleError naming the first k at which one has nowhere to be.
        """
        from occontrol.families.vlambda.placement import allowed_points

        looked = np.unique(np.linspace(0, self.epochs - 1, min(self.epochs, LOOKED_AT)).astype(int))
        for k in self.starts[looked]:
            for sensor in self.sensors:
                if sensor.location is not None and sensor.location.constraints:
                    allowed_points(sensor.location, int(k), sensor.name)

    @cached_property
    def sampled(self) -> SampledPlant:
        """Everything as arrays over k, in scaled states."""
        return sample_plant(self.plant, list(self.sensors), self.steps, self.scales)


def _entries(count: int) -> str:
    return f"{count} entr{'y' if count == 1 else 'ies'}"


SelectionProblem = Problem  # its name outside of the family
