"""The choosers of the hybrid family as values: each a frozen dataclass of its own options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class Scheduled:
    """The rule of Liu & Hwang: least bound on a wrong mode, plus position_weight times the position variance.

    Parameters
    ----------
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "scheduled"
    time_limit: float | None = None


@dataclass(frozen=True)
class ExpectedCovariance:
    """Least expected position variance after the measurement, one step ahead; looks at the state and not at the modes.

    Parameters
    ----------
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "expected-covariance"
    time_limit: float | None = None


@dataclass(frozen=True)
class Alternate:
    """The groups in turn, in the problem's order.

    Parameters
    ----------
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "alternate"
    time_limit: float | None = None


@dataclass(frozen=True)
class Random:
    """Any group with equal probability at every step.

    Parameters
    ----------
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "random"
    time_limit: float | None = None


@dataclass(frozen=True)
class Fixed:
    """One sensor or group all the time.

    Parameters
    ----------
    sensor : its name, a group as names joined by '+' or as a list; if left out every group is tried, and the best in
        RMS stands
    time_limit : seconds for each, None is no limit
    """

    name: ClassVar[str] = "fixed"
    sensor: str | list[str] | None = None
    time_limit: float | None = None
