"""The robust switching problem: an uncertain plant, sensors, slots, and the size that is to be small at the end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from occontrol.core.calendar import Calendar
from occontrol.core.checks import check_finite
from occontrol.core.errors import Collector, Mistake
from occontrol.core.kinds import Kept, PlainMapping, VectorField
from occontrol.core.method import Method
from occontrol.core.problem import BaseProblem
from occontrol.core.sensor import Sensor, SensorSuite
from occontrol.core.signal import Signal, TableSignal
from occontrol.families.robust.ellipsoid_size import SIZES, Size
from occontrol.families.robust.one_sequence import SwitchingMethod
from occontrol.families.robust.plant import UncertainPlant

if TYPE_CHECKING:
    from occontrol.families.robust.scattering import Flow

MOST_SLOTS = 10_000


@dataclass(frozen=True, eq=False)
class Problem(BaseProblem):
    """Choose one of M sensors in every slot so that the set of possible states is small at the end.

        minimise  sup over y  size( {x: (x - a)' P(T)^-1 (x - a) <= d + rho(y)} )  =  size(P(T), d + x0'Y(0)x0)

    Parameters
    ----------
    name : str
    plant : UncertainPlant with n states
    sensors : SensorSuite or list of Sensor; only their C counts (scale rows to weigh a sensor's uncertainty)
    edges : (N+1,) times between which the sensor may not change
    size : "trace", "volume", "longest-axis", or {name: weight} for a sum
    samples : measurements per slot in simulated data and measurement files
    method : an options object of one of the family's methods, or None for the default
    expect : the known answer, if any
    calendar : what the times are as dates, or None

    Raises ProblemError naming every mistake by its place in a problem file.
    Savkin, Evans & Skafidas, definitions 3.1-3.4.
    """

    name: str
    plant: UncertainPlant
    sensors: Kept[Sequence[Sensor], SensorSuite[Sensor]]
    edges: VectorField
    size: Any = "trace"
    samples: int = 20
    method: Method | None = None
    expect: PlainMapping | None = None
    calendar: Calendar | None = None
    family: str = field(default="robust", init=False)

    def __post_init__(self) -> None:
        found = Collector()
        if not isinstance(self.sensors, SensorSuite):
            object.__setattr__(self, "sensors", tuple(self.sensors))
            with found.under("sensors"):
                object.__setattr__(self, "sensors", SensorSuite(self.sensors))
        known = self._check_edges(found)
        if isinstance(self.samples, bool) or int(self.samples) != self.samples or not 1 <= self.samples <= 100_000:
            found.add(("horizon", "samples"), f"horizon.samples is {self.samples}", "a whole number from 1 to 100000")
        self._check_size(found)
        found.mistakes += self._shapes()
        if known:
            found.mistakes += self._values()
        if isinstance(self.method, SwitchingMethod):  # any other one is refused when it is asked to solve
            found.mistakes += [m.under("method") for m in self.method.check(self)]
        found.raise_if_any()

    def _check_edges(self, found: Collector) -> bool:
        edges = np.empty(0) if self.edges is None else np.asarray(self.edges, dtype=float)
        object.__setattr__(self, "edges", edges)
        before = len(found.mistakes)
        if edges.ndim != 1 or len(edges) < 2:
            found.add(("horizon",), "the horizon has no slots", "slots: at least 1")
        elif not np.all(np.isfinite(edges)) or np.any(np.diff(edges) <= 0):
            found.add(("horizon",), "the switching times do not increase", "end must lie after the start")
        elif len(edges) - 1 > MOST_SLOTS:
            found.add(("horizon", "slots"), f"there are {len(edges) - 1} slots", f"at most {MOST_SLOTS}")
        return len(found.mistakes) == before

    def _check_size(self, found: Collector) -> None:
        terms = {self.size: 1.0} if isinstance(self.size, str) else self.size
        if not isinstance(terms, Mapping) or not terms:
            found.add(("size",), "size is neither a name nor a sum of sizes", "trace, or {volume: 1, longest-axis: 10}")
            return
        before = len(found.mistakes)
        for name, weight in terms.items():
            path = ("size",) if isinstance(self.size, str) else ("size", name)
            if name not in SIZES:
                found.add(path, f"unknown size '{name}'", "known: " + ", ".join(SIZES), key=len(path) > 1)
            elif isinstance(weight, bool) or not isinstance(weight, int | float) or not 0 <= weight < np.inf:
                found.add(path, f"the weight of {name} is {weight}", "a finite number, not negative")
        if len(found.mistakes) == before and not any(terms.values()):
            found.add(("size",), "every weight of the size is zero", "one must be above 0")

    def _shapes(self) -> list[Mistake]:
        n, found = self.plant.states, []
        for j, sensor in enumerate(self.sensors):
            if sensor.C.shape[1] != n:
                rows, columns = sensor.C.shape
                what = f"C of sensor '{sensor.name}' is {rows}x{columns}, but the plant has {n} state{'s' * (n != 1)}"
                found.append(Mistake(("sensors", j, "C"), what, "a row of C has one entry per state"))
        return found

    def _values(self) -> list[Mistake]:
        """Tables that end too soon, formulas that are not finite somewhere."""
        share = np.linspace(0, 1, 9)[:-1]
        times = np.append((self.edges[:-1, None] + np.diff(self.edges)[:, None] * share).ravel(), self.edges[-1])
        found = []
        for path, signal in self.signals.items():
            if isinstance(signal, TableSignal) and not signal.covers(self.edges[0], self.edges[-1]):
                span = f"[{signal.times[0]:g}, {signal.times[-1]:g}]"
                what = f"the table covers {span}, the horizon is [{self.edges[0]:g}, {self.edges[-1]:g}]"
                found.append(Mistake(path, what, "tabulate the whole horizon"))
                continue
            of = f" of sensor '{self.sensors[int(path[1])].name}'" if path[0] == "sensors" else ""
            found += check_finite(f"{path[-1]}{of}", signal, times, path)
        return found

    @property
    def signals(self) -> dict[tuple[str | int, ...], Signal]:
        """Every time function of the problem by its path in a problem file."""
        named: dict[tuple[str | int, ...], Signal] = {("plant", k): s for k, s in self.plant.signals.items()}
        return named | {("sensors", j, "C"): sensor.C for j, sensor in enumerate(self.sensors)}

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.plant.states

    @property
    def slots(self) -> int:
        """The number N of slots."""
        return len(self.edges) - 1

    @property
    def measure(self) -> Size:
        """The size as an object that computes."""
        return Size.of(self.size)

    @cached_property
    def flow(self) -> Flow:
        """The game Riccati flow of the plant with its sensors."""
        from occontrol.families.robust.scattering import Flow

        return Flow(self.plant.A, self.plant.B, self.plant.K, [s.C for s in self.sensors])

    @cached_property
    def plant_flow(self) -> Flow:
        """The flow without its sensors."""
        from occontrol.families.robust.scattering import Flow

        return Flow(self.plant.A, self.plant.B, self.plant.K)


SwitchingProblem = Problem
