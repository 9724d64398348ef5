"""The scheduling problem without an end: which sensors when, for ever, at the least cost a step or a unit of time.

J = limsup (1/T) [ alpha sum of prices + sum or integral of tr(R S) ]   over everything up to T
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import ClassVar, cast

import numpy as np

from occontrol.core.checks import check_covariance_signal, check_finite, check_shape
from occontrol.core.errors import Collector, Mistake, plural
from occontrol.core.kinds import Kept, PlainMapping, SignalField, unless_given
from occontrol.core.method import Method
from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.reading_schedule import Reading, ReadingSchedule
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import IDLE, Sensor, SensorSuite, idle_sensor
from occontrol.core.signal import Signal, as_signal
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.periodic.limits import CycleLimits
from occontrol.families.athans.periodic.rounds import opened, round_mistakes, shut, steps_of
from occontrol.families.athans.readings.checks import selection

SENSING = ("steps", "samples", "rate")
RUNNING_AT = {"steps": ("posterior", "prior"), "samples": ("integral", "posterior", "prior"), "rate": ("integral",)}
MOST_CHOICES = 64


@dataclass(frozen=True, eq=False)
class Tick:
    """The instant that is repeated: `times` (1,), and what formulas call time."""

    times: np.ndarray
    variable: str


@dataclass(frozen=True, eq=False)
class PeriodicProblem(AthansProblem):
    """Choose for ever which sensors are used at every step, to minimise J of this file's header.

    Parameters
    ----------
    name : str
    plant : DiscretePlant for steps, LinearPlant otherwise; n states, nothing depends on time
    sensors : SensorSuite or list of Sensor; `noise` and `cost` of one reading, or intensity and rate for "rate"
    running : R, (n, n) positive semidefinite
    sensing : "steps" of discrete time, "samples" of a continuous plant, or "rate", continuous sensing
    step : time between readings, or the shortest time between changes; 1 in discrete time
    running_at : "posterior" or "prior" of every reading, or "integral" over time; the first that belongs to `sensing`
    cost_weight : alpha >= 0
    select : how many sensors are used at a time, a number or (least, most)
    method : an options object of method periodic, or None for its defaults
    expect : {source, cost, tolerance}, the known answer, if any
    limits : CycleLimits, rules that a cycle has to keep, or None
    repeat : time after which the windows of the sensors, which lie between 0 and it, come again; None without windows

    Raises ProblemError naming every mistake.
    """

    name: str
    plant: LinearPlant | DiscretePlant
    sensors: Kept[Sequence[Sensor], SensorSuite[Sensor]]
    running: SignalField
    sensing: str = "steps"
    step: float = 1.0
    running_at: str | None = None
    cost_weight: float = 1.0
    select: Kept[int | Sequence[int], tuple[int, int]] = unless_given(1)
    method: Method | None = None
    expect: PlainMapping | None = None
    limits: CycleLimits | None = None
    repeat: float | None = None
    family: str = field(default="athans", init=False)
    infinite: ClassVar[bool] = True
    rules: ClassVar[None] = None
    minimise: ClassVar[str] = "cost"
    listed: tuple[str, ...] = field(default=(), init=False, repr=False)

    def __post_init__(self) -> None:
        found, set_ = Collector(), object.__setattr__
        if self.sensing not in SENSING:
            found.add(("sensing",), f"sensing is '{self.sensing}'", f"one of: {', '.join(SENSING)}")
            found.raise_if_any()
        wanted = DiscretePlant if self.discrete else LinearPlant
        if not isinstance(self.plant, wanted):
            what = f"sensing: {self.sensing} goes with a {wanted.__name__}, not with a {type(self.plant).__name__}"
            found.add(("plant",), what)
        if not (np.isfinite(self.step) and self.step > 0):
            found.add(("horizon", "step"), f"step is {self.step:g}, it must be a time above 0")
        known = RUNNING_AT[self.sensing]
        if self.running_at is None:
            set_(self, "running_at", known[0])
        elif self.running_at not in known:
            found.add(("objective", "running_at"), f"running_at is '{self.running_at}'", f"one of: {', '.join(known)}")
        if not (np.isfinite(self.cost_weight) and self.cost_weight >= 0):
            what = f"cost_weight is {self.cost_weight:g}, it must be finite and not negative"
            found.add(("objective", "cost_weight"), what, "cost_weight >= 0")
        with found.under("objective", "running"):
            set_(self, "running", as_signal(self.running, self.variable))
        if not isinstance(self.sensors, SensorSuite):
            with found.under("sensors"):
                set_(self, "sensors", SensorSuite(tuple(self.sensors)))
        found.raise_if_any()
        set_(self, "listed", tuple(self.sensors.names))
        allowed, wrong = selection(self.select, None, self.sensors, 1)
        found.mistakes += wrong
        found.raise_if_any()
        set_(self, "select", allowed)
        least, most = self.select
        if least < most and not any(s.is_idle for s in self.sensors):
            set_(self, "sensors", SensorSuite((*self.sensors, idle_sensor(self.plant.states))))
        found.mistakes += self._constant() + self._shapes()
        found.mistakes += round_mistakes(self.sensors, self.repeat, self.step, self.sensing)
        if self.limits is not None:
            found.mistakes += self.limits.mistakes(self.listed)
        found.raise_if_any()
        found.mistakes += self._values()
        if not found.mistakes and len(self.choices) > MOST_CHOICES:
            what = f"there are {len(self.choices)} choices of sensors at a step"
            found.add(("select",), what, f"method periodic looks at {MOST_CHOICES} at most")
        if not found.mistakes:
            found.mistakes += shut(self)
        found.raise_if_any()

    def _constant(self) -> list[Mistake]:
        """Whatever changes with time: for ever there is one plant."""
        hint = f"for ever the plant is one and the same: numbers, not formulas of {self.variable}"
        return [
            Mistake(path, f"{'.'.join(map(str, path))} changes with {self.variable}", hint)
            for path, signal in self.signals.items()
            if not signal.constant
        ]

    def _shapes(self) -> list[Mistake]:
        n, found = self.plant.states, []
        hint, letter = f"the plant has {plural(n, 'state')}", "H" if self.discrete else "C"
        for j, sensor in enumerate(self.sensors):
            if sensor.C.shape[1] != n:
                rows, columns = sensor.C.shape
                what = f"{letter} of sensor '{sensor.name}' is {rows}x{columns}, but {hint}"
                found.append(Mistake(("sensors", j, letter), what, f"a row of {letter} has one entry per state"))
        return found + check_shape("running", self.running.shape, n, n, ("objective", "running"), hint)

    def _values(self) -> list[Mistake]:
        at, t, found = np.zeros(1), self.variable, []
        for path, signal in self.signals.items():
            key, where = path[-1], path[0]
            if key in ("Q", "noise") and where == "plant":
                found += check_covariance_signal("noise of the plant", signal, at, path, variable=t)
            elif key == "running":
                found += check_covariance_signal("running", signal, at, path, variable=t)
            elif key in ("R", "noise"):
                name = f"{key} of sensor '{self.sensors[int(path[1])].name}'"
                found += check_covariance_signal(name, signal, at, path, True, t)
            else:
                found += check_finite(str(key), signal, at, path, t)
        for j, sensor in enumerate(self.sensors):
            price = float(sensor.cost.at(0.0)[0, 0])
            if price < 0:
                what = f"cost of sensor '{sensor.name}' is {price:g}"
                found.append(Mistake(("sensors", j, "cost"), what, "a price is not negative"))
        return found

    @property
    def signals(self) -> dict[tuple[str | int, ...], Signal]:
        """Every matrix of the problem by its path in a problem file."""
        named: dict[tuple[str | int, ...], Signal] = {("plant", k): s for k, s in self.plant.signals.items()}
        letters = {"C": "H", "noise": "R", "cost": "cost"} if self.discrete else {}
        for j, sensor in enumerate(self.sensors):
            named |= {("sensors", j, letters.get(k, k)): s for k, s in sensor.signals.items()}
        return named | {("objective", "running"): self.running}

    @property
    def stepped(self) -> DiscretePlant:
        """The plant of discrete time."""
        return cast(DiscretePlant, self.plant)

    @property
    def flowing(self) -> LinearPlant:
        """The plant of continuous time."""
        return cast(LinearPlant, self.plant)

    @property
    def discrete(self) -> bool:
        """Whether the clock counts steps."""
        return self.sensing == "steps"

    @property
    def clock(self) -> Tick:
        """The step that is repeated, as readers of schedules ask for it."""
        return Tick(np.zeros(1), self.variable)

    @property
    def variable(self) -> str:
        """What formulas call time."""
        return "k" if self.discrete else "t"

    @property
    def per(self) -> str:
        """What the cost is per."""
        return "step" if self.discrete else "unit of time"

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.plant.states

    @property
    def places(self) -> int:
        """How many sensors, idle among them, are used at a time."""
        return self.select[1]

    @property
    def edges(self) -> np.ndarray:
        """(2,) the edges of one step: a schedule of one cycle has its own."""
        return np.array([0.0, self.step])

    @property
    def intervals(self) -> int:
        """1: of the step that is repeated."""
        return 1

    @property
    def readings(self) -> int:
        """1: of the step that is repeated."""
        return 1

    @cached_property
    def choices(self) -> tuple[tuple[str, ...], ...]:
        """The sets of sensors that can be used at a step, in the order of the sensors: the letters of words."""
        least, most = self.select
        real = [s.name for s in self.sensors if not s.is_idle]
        found = [c for size in range(max(least, 1), most + 1) for c in combinations(real, size)]
        return tuple(found if least else [*found, ()])

    @property
    def phases(self) -> int:
        """The number P of steps after which windows come again; 1 without windows."""
        return steps_of(self.repeat, self.step)

    @cached_property
    def opened(self) -> np.ndarray:
        """(P, choices) which choices there are at every step of a round."""
        return opened(self)

    @property
    def letters(self) -> tuple[str, ...]:
        """The choices in words: sensors joined by +, or idle."""
        return tuple("+".join(choice) or IDLE for choice in self.choices)

    def weights_of(self, word: Sequence[int]) -> np.ndarray:
        """(p, M) which sensors a cycle of letters uses, idle in the places that are left."""
        weights = np.zeros((len(word), len(self.sensors)))
        for k, a in enumerate(word):
            for j, sensor in enumerate(self.sensors):
                if sensor.is_idle:
                    weights[k, j] = self.places - len(self.choices[a])
                else:
                    weights[k, j] = sensor.name in self.choices[a]
        return weights

    @property
    def takes_readings(self) -> bool:  # type: ignore[override]
        """Whether sensors are read at instants."""
        return self.sensing != "rate"

    def cycle_from(self, entries: Sequence[Reading]) -> Schedule:
        """One cycle from `entries` that anybody wrote; ProblemError where they are none."""
        from occontrol.families.athans.periodic.words import cycle_from

        return cycle_from(self, entries)

    def make_schedule(self, edges: np.ndarray, weights: np.ndarray) -> Schedule:
        """One cycle as a schedule: edges (p+1,) of its steps, weights (p, M)."""
        names = tuple(self.sensors.names)
        if self.sensing == "rate":
            return Schedule(edges, weights, names)
        return ReadingSchedule(edges, weights, names, self.variable, IDLE not in self.listed)
