"""Robust switching on-line: measurements in, the set of possible states and the next sensor out.

At a switching time t_j the rest of the problem is again a robust switching problem: it starts from P(t_j), and its
level is what the measurements have left, d + rho + x'Y(t_j)x with the center x. For sizes that are homogeneous in the
level this is a mere factor: the plan made before the first measurement stays the best one, whatever is measured. For
sums of sizes of different degree the level moves the balance, so the rest is searched again at every switching time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.clock import tolerance
from occontrol.core.errors import UsageError, suggest
from occontrol.core.measurement import Step
from occontrol.families.robust.game import center_weight
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.search import SearchOptions, SearchOutcome, search
from occontrol.families.robust.set_membership import PossibleStates, initial_states, propagate
from occontrol.families.robust.slots import Slots


@dataclass(frozen=True, eq=False, kw_only=True)
class SetStep(Step):
    """The set of possible states after a step: its centre is `estimate`, its shape times the level `covariance`.

    Parameters
    ----------
    level : d + rho, what the measurements have left of the energy; negative when no admissible uncertainty explains
        them (the covariance is zero then)
    guarantee : the size at the end that no measurement can exceed from here on
    """

    level: float
    guarantee: float


class OnlineSwitching:
    """Keeps the set of possible states and says which sensor comes next.

    Parameters
    ----------
    slots : Slots, the table of the whole problem
    plant : UncertainPlant
    options : SearchOptions of every search
    names : the sensors' names, by which `step` takes measurements; sensor 1, sensor 2, .. if left out

    `states` is the set now, `sensor` the sensor to use until the end of the slot (None after the last), `guarantee` the
    size at the end that no measurement can exceed from here on; it never grows.
    """

    def __init__(
        self,
        slots: Slots,
        plant: UncertainPlant,
        options: SearchOptions | None = None,
        names: Sequence[str] | None = None,
    ):
        self.names = tuple(names or (f"sensor {j + 1}" for j in range(slots.sensors)))
        self.slots, self.options = slots, options
        self.states: PossibleStates = initial_states(float(slots.edges[0]), plant.center, plant.weight, plant.level)
        self.slot = 0
        self.searches = 0
        self.homogeneous = slots.size.homogeneous(slots.flow.n)
        self.plan: list[int] = []
        self.guarantee = np.inf
        self._decide()

    @property
    def sensor(self) -> int | None:
        """Index of the sensor in use until the end of the slot; None after the last slot."""
        return self.plan[self.slot] if self.slot < self.slots.count else None

    @property
    def slot_end(self) -> float:
        """When the sensor may change next."""
        return float(self.slots.edges[min(self.slot + 1, self.slots.count)])

    @property
    def finished(self) -> bool:
        """Whether the horizon is over."""
        return self.slot >= self.slots.count

    @property
    def next_sensors(self) -> tuple[str, ...]:
        """The name of the sensor in use from here on; () after the last slot."""
        return () if self.sensor is None else (self.names[self.sensor],)

    @property
    def times_left(self) -> np.ndarray:
        """The ends of the slots that are left."""
        return self.slots.edges[self.slot + 1 :]

    def step(
        self, measurements: Mapping[str, np.ndarray] | np.ndarray | None = None, until: float | None = None
    ) -> SetStep:
        """Take in what the sensor in use reported, as every on-line object does.

        Parameters
        ----------
        measurements : {sensor name: (m,) value held from the last step until now}, or the value alone; None, an empty
            mapping or a NaN when nothing arrived
        until : time, at most the end of the slot; the end of the slot if left out

        Returns the SetStep at `until`. Raises UsageError for a sensor that is not in use, a wrong number of values and
        outside the slot, SolveFailed when the set becomes unbounded.
        """
        y = self._value(measurements)
        states = self.measure(y, until)
        return SetStep(
            time=states.time,
            estimate=states.center,
            covariance=states.shape * max(states.level, 0.0),
            dimension=0 if y is None else len(y),
            next_sensors=self.next_sensors,
            level=states.level,
            guarantee=self.guarantee,
        )

    def _value(self, measurements: Mapping[str, np.ndarray] | np.ndarray | None) -> np.ndarray | None:
        """The value (m,) of the sensor in use, or None where it is missing."""
        if self.sensor is None or measurements is None:
            return None
        name = self.names[self.sensor]
        if isinstance(measurements, Mapping):
            for other in measurements:
                if other not in self.names:
                    raise UsageError(f"there is no sensor '{other}'\n  hint: {suggest(other, self.names)}")
                if other != name:
                    raise UsageError(f"sensor '{other}' is not in use, in use: {name}")
            if name not in measurements:
                return None
            measurements = measurements[name]
        y, rows = np.atleast_1d(np.asarray(measurements, dtype=float)), self.slots.flow.rows[self.sensor].shape[0]
        if y.shape != (rows,) or np.any(np.isinf(y)):
            raise UsageError(f"a sample of sensor '{name}' is {rows} finite values, not {y}")
        return None if np.any(np.isnan(y)) else y

    def measure(self, y: np.ndarray | None, until: float | None = None) -> PossibleStates:
        """Take in the value y (m,) that the sensor in use held from `states.time` until `until`.

        Parameters
        ----------
        y : (m,) or None when nothing arrived
        until : time, at most the end of the slot; the end of the slot if left out

        Returns the set at `until`. Raises UsageError outside the slot, SolveFailed when the set becomes unbounded.
        """
        end = self.slot_end if until is None else float(until)
        slack = tolerance(self.slot_end - self.states.time, self.slot_end)
        if self.sensor is None:
            raise UsageError("the horizon is over")
        if not self.states.time < end <= self.slot_end + slack:
            raise UsageError(
                f"until = {end:g} is not in ({self.states.time:g}, {self.slot_end:g}], the rest of the slot"
            )
        closes = end >= self.slot_end - slack
        end = self.slot_end if closes else end
        self.states = propagate(self.slots.flow, self.states, end, self.sensor, y)
        if closes:
            self.slot += 1
            self._decide()
        return self.states

    def _decide(self) -> None:
        """Plan the remaining slots for the level that is left."""
        j, states, size = self.slot, self.states, self.slots.size
        X = self.slots.free[j]
        Y = center_weight(X, states.shape)
        level = max(states.level + float(states.center @ Y @ states.center), 0.0)
        if j == self.slots.count:
            self.guarantee = float(size.value(states.shape, max(level, 1e-300)))
            return
        N = np.linalg.inv(states.inverse - X)
        rest = self.slots.tail(j, (N + N.T) / 2, max(level, 1e-300))
        if self.searches == 0 or not self.homogeneous:
            found: SearchOutcome = search(rest, [self.plan[j:]] if self.plan else [], self.options)
            self.plan = self.plan[:j] + found.sequence
            self.searches += 1
        self.guarantee = rest.cost(self.plan[j:])
