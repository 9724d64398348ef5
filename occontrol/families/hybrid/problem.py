"""The problem of Liu & Hwang: a jumping-mode plant, groups of sensors, one group at a time, judged by many runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from occontrol.core.calendar import Calendar
from occontrol.core.checks import check_covariance, check_covariance_signal, check_finite, check_shape
from occontrol.core.errors import Collector, Mistake, ProblemError, plural, suggest
from occontrol.core.kinds import ArrayField, Kept, PlainMapping, VectorField, unless_given
from occontrol.core.problem import BaseProblem
from occontrol.core.sensor import SensorSuite
from occontrol.core.signal import TableSignal, as_signal
from occontrol.families.hybrid.methods import METHODS, GroupMethod
from occontrol.families.hybrid.plant import JumpPlant
from occontrol.families.hybrid.probabilities import check_vector
from occontrol.families.hybrid.sensor import JumpSensor

MOST_STEPS = 1_000_000
MOST_WORK = 50_000_000


@dataclass(frozen=True, eq=False)
class Problem(BaseProblem):
    """At every step choose one group of sensors, read it, and estimate mode and state.

    r(k) = sqrt(mean over runs |position error at k|^2),   k = 1 .. steps

    Parameters
    ----------
    name : str
    plant : JumpPlant with n states
    sensors : SensorSuite or list of JumpSensor
    steps : number of steps
    groups : lists of sensor names, one of which is used at a time; every sensor for itself if left out
    position_weight : lambda >= 0 of the criterion bound + lambda tr(position covariance)
    position : components of the state that count as position; all if left out
    runs, seed : of the simulation
    truth_mean, truth_covariance, truth_mode : of the true state at k = 0, and the name of its mode; those of the plant,
        and a mode drawn from its probabilities, if left out
    method : an object of one of METHODS (methods.py), or None for the default
    expect : known values and their source, if any
    calendar : what k = 0 is as a date, and what one step takes, or None

    Raises ProblemError naming every mistake by its place in a problem file. Liu & Hwang, sections II and IV.
    """

    name: str
    plant: JumpPlant
    sensors: Kept[Sequence[JumpSensor], SensorSuite[JumpSensor]]
    steps: int
    groups: Sequence[Sequence[str]] | None = None
    position_weight: float = 0.0
    position: Sequence[int] | None = None
    runs: int = 100
    seed: int = 1
    truth_mean: VectorField = unless_given(None)
    truth_covariance: ArrayField = unless_given(None)
    truth_mode: str | None = None
    method: GroupMethod | None = None
    expect: PlainMapping | None = None
    calendar: Calendar | None = None
    family: str = field(default="hybrid", init=False)

    def __post_init__(self) -> None:
        found = Collector()
        if not isinstance(self.sensors, SensorSuite):
            with found.under("sensors"):
                object.__setattr__(self, "sensors", SensorSuite(tuple(self.sensors)))
        for path, value, least, most in (
            (("horizon", "steps"), self.steps, 1, MOST_STEPS),
            (("simulation", "runs"), self.runs, 1, MOST_WORK),
            (("simulation", "seed"), self.seed, 0, 2**63),
        ):
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
                found.add(path, f"{path[1]} is {value}", f"a whole number from {least} to {most}")
        found.raise_if_any()
        if self.steps * self.runs > MOST_WORK:
            what = f"{self.runs} runs of {self.steps} steps are more than {MOST_WORK} steps"
            found.add(("simulation", "runs"), what, "fewer runs or steps")
        n = self.plant.states
        if self.position is None:
            object.__setattr__(self, "position", tuple(range(n)))
        found.mistakes += self._position() + self._groups() + self._truth() + self._sensors() + self._values()
        if not (np.isfinite(self.position_weight) and self.position_weight >= 0):
            found.add(("criterion", "position_weight"), f"position_weight is {self.position_weight:g}", "at least 0")
        if not found.mistakes:
            found.mistakes += self._method()
        found.raise_if_any()

    def _method(self) -> list[Mistake]:
        if self.method is None:
            return []
        if type(self.method) not in METHODS.values():
            what = f"{type(self.method).__name__} is not a method of family {self.family}"
            return [Mistake(("method",), what, "there are: " + ", ".join(METHODS))]
        return [m.under("method") for m in self.method.check(self)]

    def _position(self) -> list[Mistake]:
        n, entries = self.plant.states, list(self.position or ())
        path = ("criterion", "position")
        if not entries:
            return [Mistake(path, "position is empty", "components of the state, counted from 0")]
        wrong = []
        for i, entry in enumerate(entries):
            if isinstance(entry, bool) or not isinstance(entry, int | np.integer) or not 0 <= entry < n:
                what = f"position names component {entry} of the state, it has {n}"
                wrong.append(Mistake((*path, i), what, f"components are counted from 0 to {n - 1}"))
            elif entry in entries[:i]:
                wrong.append(Mistake((*path, i), f"position names component {entry} twice"))
        object.__setattr__(self, "position", tuple(entries))
        return wrong

    def _groups(self) -> list[Mistake]:
        names = self.sensors.names
        if self.groups is None:
            object.__setattr__(self, "groups", tuple((name,) for name in names))
            return []
        object.__setattr__(self, "groups", tuple(tuple(group) for group in self.groups))
        if not self.groups:
            return [Mistake(("groups",), "groups is empty", "leave it out to use every sensor for itself")]
        wrong, seen = [], {}
        for g, group in enumerate(self.groups):
            if not group:
                wrong.append(Mistake(("groups", g), f"group {g + 1} is empty", "name at least one sensor"))
            for i, name in enumerate(group):
                if name not in names:
                    hint = suggest(str(name), names)
                    wrong.append(Mistake(("groups", g, i), f"group {g + 1} names the unknown sensor '{name}'", hint))
                elif name in group[:i]:
                    wrong.append(Mistake(("groups", g, i), f"group {g + 1} names the sensor '{name}' twice"))
            same = seen.setdefault(frozenset(group), g)
            if same != g:
                wrong.append(Mistake(("groups", g), f"group {g + 1} is the same as group {same + 1}", "leave it out"))
        return wrong

    def _truth(self) -> list[Mistake]:
        n, path, wrong = self.plant.states, ("simulation", "truth"), []
        mean = self.plant.mean if self.truth_mean is None else np.asarray(self.truth_mean, dtype=float).ravel()
        wrong += check_vector("mean of the truth", mean, n, (*path, "mean"), f"the modes have {n} states")
        covariance = self.plant.covariance
        if self.truth_covariance is not None:
            covariance = as_signal(self.truth_covariance, "k").at(0.0)
            what, place = "covariance of the truth", (*path, "covariance")
            bad = check_shape(what, covariance.shape, n, n, place, f"the modes have {n} states")
            wrong += bad or check_covariance(what, covariance, place)
        object.__setattr__(self, "truth_mean", mean)
        object.__setattr__(self, "truth_covariance", covariance)
        modes = self.plant.names
        if self.truth_mode is not None and self.truth_mode not in modes:
            what = f"the truth begins in the unknown mode '{self.truth_mode}'"
            wrong.append(Mistake((*path, "mode"), what, suggest(str(self.truth_mode), modes)))
        return wrong

    def _sensors(self) -> list[Mistake]:
        n, wrong = self.plant.states, []
        for j, sensor in enumerate(self.sensors):
            rows, columns = sensor.C.shape
            if columns != n:
                what = f"C of sensor '{sensor.name}' is {rows}x{columns}, but the modes have {plural(n, 'state')}"
                wrong.append(Mistake(("sensors", j, "C"), what, "a row of C has one entry per state"))
        return wrong

    def _values(self) -> list[Mistake]:
        """Everything at k = 1 .. steps: finite, covariances semidefinite, R definite, tables long enough."""
        times = np.arange(1.0, self.steps + 1.0)
        wrong: list[Mistake] = []
        for kind, parts in (("modes", self.plant.modes), ("sensors", self.sensors)):
            for j, part in enumerate(parts):
                for name, signal in part.signals.items():
                    path, what = (kind, j, name), f"{name} of {kind[:-1]} '{part.name}'"
                    if isinstance(signal, TableSignal) and not signal.covers(times[0], times[-1]):
                        where = f"the table covers [{signal.times[0]:g}, {signal.times[-1]:g}]"
                        hint = "tabulate the whole horizon"
                        wrong.append(Mistake(path, f"{what}: {where}, the steps are 1 to {self.steps}", hint))
                    elif name in ("W", "R"):
                        wrong += check_covariance_signal(what, signal, times, path, definite=name == "R", variable="k")
                    else:
                        wrong += check_finite(what, signal, times, path, "k")
        return wrong

    def group_named(self, name: str | Sequence[str]) -> tuple[str, ...]:
        """The group that a name stands for: a sensor's name alone, names joined by '+' in any order, or a list.

        Raises ProblemError at ("sensor",) when there is none.
        """
        by_name = {"+".join(group): tuple(group) for group in self.groups or ()}
        if isinstance(name, str) and name in by_name:
            return by_name[name]
        if isinstance(name, str) and name in self.sensors.names:
            return (name,)
        parts = name.split("+") if isinstance(name, str) else list(name)
        if len(parts) == 1 and parts[0] in self.sensors.names:
            return (parts[0],)
        same = [group for group in by_name.values() if set(group) == set(parts)]
        if same:
            return same[0]
        known = [*self.sensors.names, *(label for label in by_name if label not in self.sensors.names)]
        word = "+".join(parts)
        raise ProblemError(Mistake(("sensor",), f"there is no sensor or group '{word}'", suggest(word, known)))

    def positions_of(self, groups: Sequence[Sequence[str]]) -> list[list[int]]:
        """Groups of sensor names as positions among the sensors."""
        return [[self.sensors.index(name) for name in group] for group in groups]


JumpProblem = Problem  # its name outside of the family
