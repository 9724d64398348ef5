"""What the two kinds of problems of this family, continuous sensing and readings at instants, have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar


class AthansProblem:
    """A problem of the family athans.

    Attributes
    ----------
    takes_readings : whether sensors are read at instants; otherwise sensing is continuous
    name : str
    plant, sensors : of the problem
    cost_weight : alpha
    method : an options object of the family's METHODS, or None for the default
    expect : {source, cost, tolerance}, the known answer, if any
    """

    takes_readings: ClassVar[bool] = False
    name: str
    plant: Any
    sensors: Any
    cost_weight: float
    method: Any
    expect: Mapping[str, Any] | None
