"""The scheduling problem with readings at instants: in discrete time, or samples of a continuous plant.

S(k|k) = (S(k|k-1)^-1 + sum_j v_kj H_j' R_j^-1 H_j)^-1,     S(k+1|k) = F_k S(k|k) F_k' + Q_k
J = alpha sum_kj q_kj v_kj + sum_k tr(R_k S(k|k)) + tr(W S),    W = D'D on the last covariance that counts
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from occontrol.core.calendar import Calendar
from occontrol.core.checks import check_shape
from occontrol.core.errors import Collector, Mistake, plural
from occontrol.core.kinds import Kept, OptionalSignalField, PlainMapping, SignalField, unless_given
from occontrol.core.method import Method
from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.reading_schedule import ReadingSchedule
from occontrol.core.sensor import IDLE, Sensor, SensorSuite, idle_sensor
from occontrol.core.signal import Signal, TableSignal, as_signal
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.criteria.statement import PEAK, CriterionChoice
from occontrol.families.athans.criteria.statement import mistakes_of as wrong_criterion
from occontrol.families.athans.criteria.without_prior import wrong_without_prior
from occontrol.families.athans.readings.checks import missed_readings, selection, values
from occontrol.families.athans.readings.clock import SampleTimes, Steps
from occontrol.families.athans.readings.feasible import require_budget, require_places
from occontrol.families.athans.readings.known_gaps import KnownGaps
from occontrol.families.athans.readings.statement import wrong_rules
from occontrol.families.athans.rules.statement import Constraints

AT = ("predicted", "posterior")
RUNNING_AT = ("posterior", "prior", "integral")


@dataclass(frozen=True, eq=False)
class ReadingsProblem(AthansProblem):
    """Choose which sensors give a reading at every instant, to minimise J of this file's header.

    Parameters
    ----------
    name : str
    plant : DiscretePlant for `Steps`, LinearPlant for `SampleTimes`; n states
    sensors : SensorSuite or list of Sensor; `noise` is the covariance of one reading, `cost` its price
    clock : Steps or SampleTimes, N readings
    output : D, (p, n) number, rows, formulas or a Signal; at N (last step for `posterior`), or at `predict_at`
    predict_at : Tp >= T of a sampled plant; T if left out
    at : "predicted" S(N|N-1), or "posterior" S(N-1|N-1); discrete time only
    cost_weight : alpha >= 0
    running : R, (n, n) positive semidefinite, optional
    running_at : "posterior", "prior", or "integral" of tr(R S) dt from start to end (sampled plants, their default)
    select : how many sensors give a reading at a time, a number or (least, most)
    budget : {"total": b} or {name: b}: exact numbers of readings; makes `select` an upper limit
    method : an options object of the family's METHODS, or None for the default
    expect : {source, cost, tolerance}, the known answer, if any
    rules : Constraints on whole schedules, counted in steps; of samples those without times
    minimise : "cost", "error" (running and output), or "observation"
    criterion : CriterionChoice of the outputs' covariance; None is its trace
    prior : False where nothing is known before the readings; calendar : what times are as dates, or None

    Raises ProblemError naming every mistake; `require_feasible` raises InfeasibleError.
    """

    name: str
    plant: Any
    sensors: Kept[Sequence[Sensor], SensorSuite[Sensor]]
    clock: Steps | SampleTimes
    output: SignalField
    predict_at: float | None = None
    at: str | None = None
    cost_weight: float = 1.0
    running: OptionalSignalField = unless_given(None)
    running_at: str | None = None
    select: Kept[int | Sequence[int], tuple[int, int]] = unless_given(1)
    budget: Mapping[str, int] | None = None
    method: Method | None = None
    expect: PlainMapping | None = None
    rules: Constraints | None = None
    minimise: str = "cost"
    criterion: CriterionChoice | None = None
    prior: bool = True
    calendar: Calendar | None = None
    family: str = field(default="athans", init=False)
    takes_readings: ClassVar[bool] = True
    warnings: tuple[str, ...] = field(default=(), init=False, repr=False)
    listed: tuple[str, ...] = field(default=(), init=False, repr=False)

    def __post_init__(self) -> None:
        found = Collector()
        set_ = object.__setattr__
        found.mistakes += self._clock()
        found.raise_if_any()
        for name in ("output", "running"):
            if getattr(self, name) is not None:
                with found.under("objective", name):
                    set_(self, name, as_signal(getattr(self, name), self.clock.variable))
        found.mistakes += self._words()
        if not isinstance(self.sensors, SensorSuite):
            with found.under("sensors"):
                set_(self, "sensors", SensorSuite(tuple(self.sensors)))
        found.raise_if_any()
        set_(self, "listed", tuple(self.sensors.names))
        allowed, wrong = selection(self.select, self.budget, self.sensors, self.readings, self.clock.epoch)
        found.mistakes += wrong
        found.raise_if_any()
        set_(self, "select", allowed)
        if (self.select[0] < self.select[1] or self.opens) and not any(s.is_idle for s in self.sensors):
            set_(self, "sensors", SensorSuite((*self.sensors, idle_sensor(self.plant.states))))
        wrong = wrong_rules(self.rules, self.minimise, self.sensors, self.places, self.discrete, self.budget)
        found.mistakes += [*wrong_criterion(self), *wrong_without_prior(self, self.clock.times), *wrong]
        if not (np.isfinite(self.cost_weight) and self.cost_weight >= 0):
            what = f"cost_weight is {self.cost_weight:g}, it must be finite and not negative"
            found.add(("objective", "cost_weight"), what, "cost_weight >= 0")
        found.mistakes += self._shapes()
        missed, warnings = missed_readings(self.sensors, self.clock)
        found.mistakes += missed
        set_(self, "warnings", tuple(warnings))
        wrong = {m.path for m in found.mistakes}
        found.mistakes += [m for m in values(self) if m.path not in wrong]
        found.raise_if_any()

    def _clock(self) -> list[Mistake]:
        set_, found = object.__setattr__, Collector()
        wanted = DiscretePlant if self.discrete else LinearPlant
        if not isinstance(self.plant, wanted):
            what = f"the clock goes with a {wanted.__name__}, not with a {type(self.plant).__name__}"
            found.add(("plant",), what)
        last = self.clock.end
        if self.predict_at is None:
            set_(self, "predict_at", last)
        elif self.discrete and self.predict_at != last:
            found.add(("horizon", "predict_at"), "predict_at is a time; in discrete time the output is that at N", "")
        elif not (np.isfinite(self.predict_at) and self.predict_at >= last):
            what = f"predict_at = {self.predict_at:g} lies before the end of the horizon, {last:g}"
            found.add(("horizon", "predict_at"), what, "predict_at >= end")
        return found.mistakes

    def _words(self) -> list[Mistake]:
        set_, found = object.__setattr__, Collector()
        if self.at not in (None, AT[0]) and not self.discrete:
            hint = "the weight acts on the covariance at the end, after the last reading"
            found.add(("objective", "at"), "at belongs to discrete time, not to samples", hint, True)
        elif self.at is None:
            set_(self, "at", AT[0])
        elif self.at not in AT:
            found.add(("objective", "at"), f"at is '{self.at}'", f"one of: {', '.join(AT)}")
        known = RUNNING_AT[:2] if self.discrete else RUNNING_AT
        if self.running_at is None and self.running is not None:
            set_(self, "running_at", known[0] if self.discrete else "integral")
        elif self.running_at is None:
            pass
        elif self.running is None:
            found.add(("objective", "running_at"), "running_at is given without running", "add running: ..", True)
        elif self.running_at not in known:
            what = f"running_at is '{self.running_at}'"
            found.add(("objective", "running_at"), what, f"one of: {', '.join(known)}")
        return found.mistakes

    def _shapes(self) -> list[Mistake]:
        n, found = self.plant.states, []
        hint = f"the plant has {plural(n, 'state')}"
        letter = "H" if self.discrete else "C"
        for j, sensor in enumerate(self.sensors):
            if sensor.C.shape[1] != n:
                rows, columns = sensor.C.shape
                what = f"{letter} of sensor '{sensor.name}' is {rows}x{columns}, but {hint}"
                found.append(Mistake(("sensors", j, letter), what, f"a row of {letter} has one entry per state"))
        found += check_shape("output", self.output.shape, None, n, ("objective", "output"), hint)
        if self.running is not None:
            found += check_shape("running", self.running.shape, n, n, ("objective", "running"), hint)
        for path, signal in self.signals.items():
            start, end = self.needed(path)
            if isinstance(signal, TableSignal) and not signal.covers(start, end):
                span = f"[{signal.times[0]:g}, {signal.times[-1]:g}]"
                what = f"the table covers {span}, the horizon needs [{start:g}, {end:g}]"
                found.append(Mistake(path, what, "tabulate the whole horizon, for the plant up to predict_at"))
        return found

    def needed(self, path: tuple) -> tuple[float, float]:
        """First and last time at which a signal is looked at."""
        times = self.clock.times
        if path[0] == "sensors":
            return float(times[0]), float(times[-1])
        if path[-1] == "output":
            peak = self.criterion is not None and self.criterion.name == PEAK
            return (float(times[0]), float(times[-1])) if peak else (self.output_at, self.output_at)
        if self.discrete:
            return 0.0, float(times[-1])
        return self.clock.start, self.clock.end if path[-1] == "running" else float(self.predict_at or 0.0)

    @property
    def discrete(self) -> bool:
        """Whether the clock counts steps."""
        return isinstance(self.clock, Steps)

    @property
    def gaps(self) -> KnownGaps | None:
        """The maps between readings where the plant is given by them; None: they follow from A(t)."""
        return getattr(self.plant, "gaps", None)

    @property
    def output_at(self) -> float:
        """The time, or the k, at which D is evaluated."""
        end = self.clock.end if self.at == "predicted" else self.clock.end - 1
        return end if self.discrete else float(self.predict_at or 0.0)

    @property
    def running_times(self) -> np.ndarray:
        """Times at which the running weight counts: those of the readings, or a grid for the integral."""
        grid = np.linspace(self.clock.start, self.clock.end, max(65, 2 * len(self.clock.times)))
        return grid if self.running_at == "integral" else self.clock.times

    @property
    def plant_signals(self) -> dict[tuple[str | int, ...], Signal]:
        """The functions of time of the plant, by their paths in a problem file."""
        return {("plant", key): signal for key, signal in self.plant.signals.items()}

    @property
    def signals(self) -> dict[tuple[str | int, ...], Signal]:
        """Every function of time of the problem by its path in a problem file."""
        named = dict(self.plant_signals)
        letters = {"C": "H", "noise": "R", "cost": "cost"} if self.discrete else {}
        for j, sensor in enumerate(self.sensors):
            named |= {("sensors", j, letters.get(k, k)): s for k, s in sensor.signals.items()}
        named[("objective", "output")] = self.output
        return named if self.running is None else named | {("objective", "running"): self.running}

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.plant.states

    @property
    def edges(self) -> np.ndarray:
        """(N+1,) the instants of the readings and one time after the last: the axis of tables and pictures."""
        return self.clock.nodes

    @property
    def readings(self) -> int:
        """The number N of readings, of steps or of sample times."""
        return len(self.clock.times)

    @cached_property
    def upper(self) -> np.ndarray:
        """(E, M) the largest weight of each sensor in each decision: 0 outside windows, idle's fills what may be left.

        A sensor is available for an epoch when it is inside its windows at every step of it.
        """
        least, most = self.select
        open_ = np.ones((self.readings, len(self.sensors)))
        for j, sensor in enumerate(self.sensors):
            if sensor.is_idle:
                open_[:, j] = most - least
            elif sensor.windows is not None:
                open_[:, j] = [sensor.readable(t) for t in self.clock.times]
        if self.opens:  # where too few sensors see the nominal path, idle fills the places
            idle = next(j for j, s in enumerate(self.sensors) if s.is_idle)
            others = np.sum(np.delete(open_, idle, axis=1), axis=1)
            open_[:, idle] = np.maximum(open_[:, idle], np.maximum(most - others, 0.0))
        return np.minimum.reduceat(open_, self.first_readings, axis=0)

    @property
    def opens(self) -> bool:
        """Whether idle opens where nothing sees the nominal path of a nonlinear plant."""
        origin = getattr(self.plant, "linearised", None)
        return origin is not None and origin.hides

    @cached_property
    def first_readings(self) -> np.ndarray:
        """(E,) the first reading of every decision."""
        return np.flatnonzero(np.diff(self.clock.owner, prepend=-1))

    def make_schedule(self, edges: np.ndarray, weights: np.ndarray) -> ReadingSchedule:
        """A schedule of this problem's sensors from edges (N+1,) and weights (N, M) of every reading."""
        names = tuple(self.sensors.names)
        return ReadingSchedule(edges, weights, names, self.clock.variable, self.ranged)

    @cached_property
    def ranged(self) -> bool:
        """Whether idle is not a sensor of the user's but what a range of `select` leaves out."""
        return IDLE not in self.listed

    @property
    def places(self) -> int:
        """How many sensors, idle among them, fill a decision."""
        return self.select[1]

    def require_feasible(self) -> None:
        """Raise InfeasibleError, with the times, where no schedule has enough sensors, or keeps budget or rules."""
        require_places(self)
        require_budget(self)
        if self.ruled:
            from occontrol.families.athans.readings.rules import frame_of
            from occontrol.families.athans.rules.diagnosis import require_rules_feasible

            require_rules_feasible(frame_of(self))
