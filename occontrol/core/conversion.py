"""What a user must say where a problem of one family becomes one of another and the first does not hold it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Asked:
    """Numbers that the other family needs.

    Parameters
    ----------
    step : between two readings of a plant that was sensed all the time, in the unit of time
    level : d, how much energy the unknown inputs have
    slots : how many, in which the sensor may not change
    """

    step: float | None = None
    level: float | None = None
    slots: int | None = None
