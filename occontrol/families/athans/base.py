"""What the kinds of problems of this family have in common: continuous sensing, readings at instants, no end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from occontrol.core.kinds import Kept, OptionalVectorLike, PlainMapping
from occontrol.core.method import Method
from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.problem import BaseProblem
from occontrol.core.sensor import Sensor, SensorSuite
from occontrol.families.athans.criteria.statement import TRACE, CriterionChoice
from occontrol.families.athans.rules.statement import Constraints


class AthansProblem(BaseProblem):
    """A problem of the family athans.

    Attributes
    ----------
    infinite : whether the horizon has no end
    takes_readings : whether sensors are read at instants; otherwise sensing is continuous
    of_targets : whether resources look at many targets, instead of sensors at one plant
    discrete : whether time itself is discrete: steps k = 0 .. N
    name : str
    plant, sensors : of the problem
    cost_weight : alpha
    method : an options object of the family's METHODS, or None for the default
    expect : {source, cost, tolerance}, the known answer, if any
    edges : (N+1,) of the intervals, in the unit of time
    rules : Constraints that a schedule has to keep, or None
    minimise : "cost", "error" (running and output), or "observation"
    states, places : n, and how many sensors are used at a time
    intervals, readings : N, of continuous sensing and of readings at instants
    listed : the sensors that the user listed, of readings at instants
    """

    infinite: ClassVar[bool] = False
    takes_readings: ClassVar[bool] = False
    of_targets: ClassVar[bool] = False
    name: str
    plant: LinearPlant | DiscretePlant
    sensors: Kept[Sequence[Sensor], SensorSuite[Sensor]]
    cost_weight: float
    method: Method | None
    expect: PlainMapping | None
    states: int
    places: int
    intervals: int
    readings: int
    listed: tuple[str, ...]
    edges: Kept[OptionalVectorLike, np.ndarray]
    rules: Constraints | None
    minimise: str
    criterion: CriterionChoice | None = None
    prior: bool = True

    @property
    def unknown(self) -> np.ndarray:
        """(n,) of which states nothing is known before the readings: of all, where the plant does not say of which."""
        plant = getattr(getattr(self.plant, "linearised", None), "plant", None)
        return np.ones(self.states, dtype=bool) if plant is None else plant.unknown

    @property
    def measured(self) -> bool:
        """Whether the criterion is another one than the trace."""
        return self.criterion is not None and self.criterion.name != TRACE

    @property
    def capped(self) -> bool:
        """Whether the criterion is a limit that is to be kept, and no part of the cost."""
        return self.criterion is not None and self.criterion.limit is not None

    @property
    def logarithmic(self) -> bool:
        """Whether the cost holds a logarithm: gaps are then differences."""
        return self.criterion is not None and self.criterion.logarithmic

    @property
    def discrete(self) -> bool:
        """Whether the clock counts steps."""
        return False

    @property
    def ruled(self) -> bool:
        """Whether rules or budgets concern a whole schedule."""
        return self.rules is not None or self.minimise != "cost"

    @property
    def slews(self) -> bool:
        """Whether there may be times at which no sensor is used because it is on the way to another."""
        return self.rules is not None and self.rules.slews
