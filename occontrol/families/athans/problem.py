"""The scheduling problem of Athans (1971): plant, sensors, time grid, and what is to be minimised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from occontrol.core.calendar import Calendar
from occontrol.core.checks import check_covariance_signal, check_finite, check_shape, looked_at
from occontrol.core.clock import elapsed, lengths
from occontrol.core.errors import Collector, Mistake
from occontrol.core.kinds import Kept, OptionalSignalField, PlainMapping, SignalField, VectorField, unless_given
from occontrol.core.method import Method
from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import Sensor, SensorSuite
from occontrol.core.signal import Signal, TableSignal, as_signal
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.criteria.statement import CriterionChoice
from occontrol.families.athans.criteria.statement import mistakes_of as wrong_criterion
from occontrol.families.athans.criteria.without_prior import wrong_without_prior
from occontrol.families.athans.integration.edges import fitted_edges, missed_windows
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.rules.statement import Constraints
from occontrol.families.athans.rules.statement import mistakes as rule_mistakes


@dataclass(frozen=True, eq=False)
class SchedulingProblem(AthansProblem):
    """Choose v_j(t), sum_j v_j = select, to minimise

        J = alpha int sum_j q_j v_j dt + int tr(R Sigma) dt + tr(W Sigma(T)),   W = Phi(Tp,T)' D' D Phi(Tp,T)

    Parameters
    ----------
    name : str
    plant : LinearPlant with n states
    sensors : SensorSuite or a list of Sensor; 'idle' (see idle_sensor) may fill any number of the places
    edges : (N+1,) increasing times t0 .. T; the schedule is constant between them
    output : D, (p, n) number, rows, formulas of t, or a Signal; evaluated at `predict_at` for the cost
    predict_at : Tp >= T; T if left out
    cost_weight : alpha >= 0
    running : R(t), (n, n) positive semidefinite, optional
    select : how many sensors are used at a time
    least : how many of these must be sensors, where idle may fill the other places
    method : an options object of the family's METHODS, or None for the default
    expect : {source, cost, tolerance}, the known answer, if any
    integration : accuracy or steps of the integration, and which times become edges
    rules : Constraints that a schedule has to keep, or None
    minimise : "cost", "error" (without the observation cost) or "observation" (that alone, not weighted)
    calendar : what the times are as dates, or None
    criterion : CriterionChoice of the outputs' covariance; None is its trace
    prior : False where nothing is known at the start; the plant's covariance is then not looked at

    Ends of windows and jumps of held tables become edges beside those given, see `added_edges` and Integration.
    Raises ProblemError naming every mistake; `require_feasible` raises InfeasibleError.
    Athans (1971), equations (2.1)-(2.30), (3.12), (4.1)-(4.3); R, select and windows are generalisations.
    """

    name: str
    plant: LinearPlant
    sensors: Kept[Sequence[Sensor], SensorSuite[Sensor]]
    edges: VectorField
    output: SignalField
    predict_at: float | None = None
    cost_weight: float = 1.0
    running: OptionalSignalField = unless_given(None)
    select: int = 1
    least: int = 0
    method: Method | None = None
    expect: PlainMapping | None = None
    integration: Integration = field(default_factory=Integration)
    rules: Constraints | None = None
    minimise: str = "cost"
    calendar: Calendar | None = None
    criterion: CriterionChoice | None = None
    prior: bool = True
    family: str = field(default="athans", init=False)
    added_edges: tuple[tuple[float, str], ...] = field(default=(), init=False, repr=False)
    warnings: tuple[str, ...] = field(default=(), init=False, repr=False)

    def __post_init__(self) -> None:
        found = Collector()
        if not isinstance(self.sensors, SensorSuite):
            with found.under("sensors"):
                object.__setattr__(self, "sensors", SensorSuite(tuple(self.sensors)))
        edges = np.asarray(self.edges, dtype=float)
        object.__setattr__(self, "edges", edges)
        found.mistakes += self._horizon(edges)
        if not (np.isfinite(self.cost_weight) and self.cost_weight >= 0):
            what = f"cost_weight is {self.cost_weight:g}, it must be finite and not negative"
            found.add(("objective", "cost_weight"), what, "cost_weight >= 0")
        converted = len(found.mistakes)
        for name in ("output", "running"):
            if getattr(self, name) is not None:
                with found.under("objective", name):
                    object.__setattr__(self, name, as_signal(getattr(self, name)))
        if len(found.mistakes) > converted:
            found.raise_if_any()
        if not isinstance(self.sensors, SensorSuite):  # repeated names do not hide what else is wrong
            object.__setattr__(self, "sensors", tuple(self.sensors))
        found.mistakes += self.integration.mistakes()
        found.mistakes += wrong_criterion(self) if len(self.edges) else []
        found.mistakes += rule_mistakes(self.rules, self.minimise, self.sensors, self.select)
        found.mistakes += self._shapes()
        if not found.mistakes:
            found.mistakes += wrong_without_prior(self, np.sort(np.concatenate([self.edges, self.midpoints])))
            found.mistakes += self._fit_edges()
        found.mistakes += self._values({m.path for m in found.mistakes})
        found.raise_if_any()

    def _horizon(self, edges: np.ndarray) -> list[Mistake]:
        found = Collector()
        if edges.ndim != 1 or len(edges) < 2:
            found.add(("horizon",), "the horizon has no intervals", "intervals: at least 1")
        elif not np.all(np.isfinite(edges)):
            found.add(("horizon",), "the horizon is not finite")
        elif np.any(np.diff(edges) <= 0):
            found.add(("horizon",), "the edges of the horizon do not increase", "end must lie after start")
        if found.mistakes:
            object.__setattr__(self, "edges", np.empty(0))
        elif self.predict_at is None:
            object.__setattr__(self, "predict_at", float(edges[-1]))
        elif not np.isfinite(self.predict_at):
            found.add(("horizon", "predict_at"), "predict_at is not finite")
        elif self.predict_at < edges[-1]:
            what = f"predict_at = {self.predict_at:g} lies before the end of the horizon, {edges[-1]:g}"
            found.add(("horizon", "predict_at"), what, "predict_at >= end")
        return found.mistakes

    def _fit_edges(self) -> list[Mistake]:
        """Add the edges that windows and tables ask for; mistakes where a sensor can never be used."""
        wrong, warnings = missed_windows(self.sensors, self.edges)
        options, signals = self.integration, {p: s for p, s in self.signals.items() if p != ("objective", "output")}
        how = {"windows": options.windows == "edges", "tables": options.substeps is None}
        edges, added = fitted_edges(self.edges, self.sensors, signals, **how)
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "added_edges", tuple(added))
        object.__setattr__(self, "warnings", tuple(warnings))
        return wrong

    def _shapes(self) -> list[Mistake]:
        n, found = self.plant.states, []
        state_hint = f"the plant has {n} state{'s' * (n != 1)}"
        for j, sensor in enumerate(self.sensors):
            if sensor.C.shape[1] != n:
                rows, columns = sensor.C.shape
                what = f"C of sensor '{sensor.name}' is {rows}x{columns}, but the plant has {n} state{'s' * (n != 1)}"
                found.append(Mistake(("sensors", j, "C"), what, "a row of C has one entry per state"))
        found += check_shape("output", self.output.shape, None, n, ("objective", "output"), state_hint)
        if self.running is not None:
            found += check_shape("running", self.running.shape, n, n, ("objective", "running"), state_hint)
        places = len(self.sensors) + (self.select if any(s.is_idle for s in self.sensors) else 0)
        if isinstance(self.select, bool) or int(self.select) != self.select or not 1 <= self.select <= places:
            what = f"select is {self.select}, there are {len(self.sensors)} sensors"
            found.append(Mistake(("select",), what, f"1 <= select <= {len(self.sensors)}"))
        elif not 0 <= self.least <= self.select:
            what = f"select is {self.least}..{self.select}"
            found.append(Mistake(("select",), what, "a range begins with the smaller number"))
        for path, signal in self.signals.items() if len(self.edges) else ():
            end = self.predict_at if path[0] in ("plant", "objective") else self.edges[-1]
            if isinstance(signal, TableSignal) and not signal.covers(self.edges[0], float(end or 0)):
                table = f"the table covers [{signal.times[0]:g}, {signal.times[-1]:g}]"
                what = f"{table}, the horizon is [{self.edges[0]:g}, {end:g}]"
                found.append(Mistake(path, what, "tabulate the whole horizon, for the plant up to predict_at"))
        return found

    def _values(self, wrong: set) -> list[Mistake]:
        """Definiteness and finiteness on the horizon (for the plant, on to Tp), but for what is known to be wrong."""
        times = later = np.sort(np.concatenate([self.edges, (self.edges[1:] + self.edges[:-1]) / 2]))
        predict_at = [] if len(times) == 0 or ("horizon", "predict_at") in wrong else [float(self.predict_at or 0)]
        if predict_at and predict_at[0] > times[-1]:
            later = np.concatenate([times, np.linspace(times[-1], predict_at[0], 65)[1:]])
        found: list[Mistake] = []
        plant = self.plant
        found += check_finite("A", plant.A, later, ("plant", "A"))
        found += check_covariance_signal("noise of the plant", plant.noise, later, ("plant", "noise"))
        for name in ("B", "input"):
            if getattr(plant, name) is not None:
                found += check_finite(name, getattr(plant, name), later, ("plant", name))
        for j, sensor in enumerate(self.sensors):
            where, of = ("sensors", j), f"of sensor '{sensor.name}'"
            found += check_finite(f"C {of}", sensor.C, times, (*where, "C"))
            found += check_covariance_signal(f"noise {of}", sensor.noise, times, (*where, "noise"), definite=True)
            found += check_finite(f"cost {of}", sensor.cost, times, (*where, "cost")) or self._cost(sensor, j, times)
        found += check_finite("output", self.output, np.array(predict_at), ("objective", "output"))
        if self.running is not None:
            found += check_covariance_signal("running", self.running, times, ("objective", "running"))
        return [m for m in found if m.path not in wrong]

    def _cost(self, sensor: Sensor, j: int, times: np.ndarray) -> list[Mistake]:
        """A cost rate below zero; the earliest time at which it is."""
        if sensor.cost.constant:
            times = np.zeros(1)
        elif len(times):
            times = looked_at(sensor.cost, times)
        rates = sensor.cost.sample(times)[:, 0, 0]
        if not np.any(rates < 0):
            return []
        k = int(np.argmax(rates < 0))
        at = "" if sensor.cost.constant else f" at t = {times[k]:.6g}"
        return [
            Mistake(
                ("sensors", j, "cost"),
                f"cost of sensor '{sensor.name}' is {rates[k]:g}{at}",
                "a cost rate is not negative",
            )
        ]

    @property
    def signals(self) -> dict[tuple[str | int, ...], Signal]:
        """Every time function of the problem by its path in a problem file."""
        named: dict[tuple[str | int, ...], Signal] = {("plant", k): s for k, s in self.plant.signals.items()}
        for j, sensor in enumerate(self.sensors):
            named |= {("sensors", j, k): s for k, s in sensor.signals.items()}
        named[("objective", "output")] = self.output
        if self.running is not None:
            named[("objective", "running")] = self.running
        return named

    @property
    def places(self) -> int:
        """How many sensors, idle among them, are used at a time: `select`."""
        return self.select

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.plant.states

    @property
    def intervals(self) -> int:
        """The number N of intervals."""
        return len(self.edges) - 1

    @cached_property
    def steps(self) -> np.ndarray:
        """(N,) lengths of the intervals; equal to the last bit on an equally spaced grid."""
        return lengths(self.edges)

    @cached_property
    def elapsed(self) -> np.ndarray:
        """(N+1,) times since the start, which keep their digits wherever time is counted from."""
        return elapsed(self.edges)

    @property
    def midpoints(self) -> np.ndarray:
        """(N,) midpoints of the intervals."""
        return (self.edges[1:] + self.edges[:-1]) / 2

    @cached_property
    def upper(self) -> np.ndarray:
        """(N, M) the largest weight of each sensor on each interval: 0 outside windows, 1 inside; idle's fills up."""
        upper = np.zeros((self.intervals, len(self.sensors)))
        for j, sensor in enumerate(self.sensors):
            if sensor.is_idle:
                upper[:, j] = self.select - self.least
            elif sensor.windows is None:
                upper[:, j] = 1.0
            else:
                upper[:, j] = sensor.available_between(self.edges)
        return upper

    def with_edges(self, extra: Sequence[tuple[float, str]]) -> SchedulingProblem:
        """The same problem with further edges, each (time, why); `added_edges` lists them with those known before."""
        edges = np.union1d(self.edges, [t for t, _ in extra])
        found = replace(self, edges=edges)
        object.__setattr__(found, "added_edges", tuple(sorted({*self.added_edges, *extra, *found.added_edges})))
        return found

    def require_feasible(self) -> None:
        """Raise InfeasibleError, with the time, where fewer than `select` places can be filled.

        Raises ProblemError when a solve needs more memory than there is.
        """
        from occontrol.families.athans.need import require_memory
        from occontrol.families.athans.places import require_places

        require_memory(self)
        require_places(self.upper, self.select, self.edges)
        if self.ruled:
            from occontrol.families.athans.rules.diagnosis import require_rules_feasible
            from occontrol.families.athans.rules.setting import frame_of

            require_rules_feasible(frame_of(self))


def uniform_edges(start: float, end: float, intervals: int) -> np.ndarray:
    """(intervals+1,) equally spaced edges."""
    return np.append(start + np.linspace(0.0, end - start, intervals + 1)[:-1], end)
