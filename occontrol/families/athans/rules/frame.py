"""What rules ask of a problem, whatever its clock: rules as numbers, the times they count in, windows, prices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.scheduling.rules.builder import TooManyStates
from occontrol.scheduling.rules.oracle import Oracle
from occontrol.scheduling.rules.rules import Rules


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
            raise UsageError(f"{error}, rules cannot be searched\n  hint: fewer sensors, or a smaller select") from None
