"""What a family may be able to do, by name, and the shape of work that is done for it elsewhere."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from numpy.random import SeedSequence

Work: TypeAlias = "Callable[[Sequence[str], Sequence[Sequence[SeedSequence]]], Sequence[tuple[dict, dict]]]"
"""Does batches of seeds for policies, for example in several processes; outcomes and milliseconds of each in order."""


class Ability(enum.StrEnum):
    """What a family may be able to do beside solving; the value is how a sentence about it goes on."""

    CERTIFY = "certify schedules"
    SIMULATE = "simulate measurements"
    FILTER = "filter a measurement file"
    ONLINE = "run on line"
    TRADEOFF = "trade observation cost against prediction error"
    COMPARE = "compare methods"
    SENSITIVITY = "say what a price, a noise or a window is worth"
    CLOSED_LOOP = "be judged in closed loop"
    MONTE_CARLO = "be judged by many simulated runs"
