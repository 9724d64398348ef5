"""What rules ask of a problem, whatever its clock: rules as numbers, the times they count in, windows, prices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.scheduling.rules.builder import TooManyStates
from occontrol.scheduling.rules.oracle import Oracle
from occontrol.scheduling.rules.rules import Rules

WORDS = {
    "duty_time": "duty",
    "max_observation": "max_observation_cost",
    "before": "before",
    "after": "after: enforce",
}


def spelt(rule: str, sensor: str | None) -> str:
    """A rule as the user wrote it: "min_on of sensor 'radar'", "max_switches".

    Parameters
    ----------
    rule, sensor : as in Rules; no sensor where it is about all of them
    """
    word = WORDS.get(rule, rule)
    return f"{word} of sensor '{sensor}'" if sensor else word


@dataclass(frozen=True, eq=False)
class Frame:
    """The rules of a problem and what they are about.

    Parameters
    ----------
    rules : Rules
    edges : (N+1,) times in which the rules count
    upper : (N, M) positive where a sensor may be used
    spend : (N, M) observation cost of a sensor on an interval
    interval : how interval k is called
    end : how the end is called
    """

    rules: Rules
    edges: np.ndarray
    upper: np.ndarray
    spend: np.ndarray
    interval: Callable[[int], str]
    end: str

    @property
    def intervals(self) -> int:
        """N"""
        return len(self.upper)

    def oracle(self, rules: Rules | None = None) -> Oracle:
        """The oracle of the rules, or of others in their place.

        Parameters
        ----------
        rules : Rules, or None for the problem's own

        Raises UsageError where the rules need more states than it can hold.
        """
        try:
            return Oracle(rules or self.rules, self.edges, self.upper)
        except TooManyStates:
            what = "these rules on this many sensors and intervals need more states than can be searched"
            raise UsageError(f"{what}\n  hint: fewer intervals, or fewer sensors with times of their own") from None
        except ValueError as error:
            raise UsageError(self._too_many(str(error))) from None

    def _too_many(self, error: str) -> str:
        """Which key asks for more than can be searched, and for which rules that is."""
        rules, stated = self.rules, self.rules.stated()
        kinds = list(dict.fromkeys(spelt(rule, None) for rule, _ in stated)) or ["exact: true"]
        kinds += ["switch_cost"] if rules.costs_changes() else []
        real = int(np.sum(~rules.idle))
        what = f"select: {rules.select} of {real} sensors makes {error}, too many to search with {', '.join(kinds)}"
        hint = f"a smaller select, fewer sensors, or without {' and '.join(kinds)}"
        return f"{what}\n  hint: {hint}"
