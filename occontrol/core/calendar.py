"""Times as dates: t = 0 is an instant of the calendar, and t counts seconds, minutes, hours or days from it.

UTC without leap seconds: every day has 86400 seconds. Dates are ISO 8601 with Z or an offset; a date without either
could be anybody's time and is refused. All of it is exact arithmetic, rounded once.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from functools import cached_property

from occontrol.core.errors import ProblemError
from occontrol.core.kinds import PlainDict

UNITS = {"s": 1, "min": 60, "h": 3600, "d": 86400}
STAMP = 1e-6  # seconds: what dates are written to
_DATE = re.compile(
    r"(\d{4}-\d{2}-\d{2})[Tt ](\d{2}:\d{2})(?::(\d{2})(?:[.,](\d{1,18}))?)?(Z|z|[+-]\d{2}:?\d{2})?", re.ASCII
)
_LIKE = re.compile(r"\s*\d{4}-\d{2}-\d{2}", re.ASCII)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def looks_like_date(value: object) -> bool:
    """Whether a value begins as a date does: text with year, month and day."""
    return isinstance(value, str) and _LIKE.match(value) is not None


def instant(text: str) -> Fraction:
    """Seconds since 1970-01-01T00:00:00Z of a date in ISO 8601.

    Parameters
    ----------
    text : with Z or an offset, such as 2026-01-01T12:00:00Z or 2026-01-01T13:00+01:00

    Raises ProblemError where it is none.
    """
    found = _DATE.fullmatch(text.strip())
    if found is None:
        raise ProblemError(f"'{text[:40]}' is not a date", "ISO 8601, such as 2026-01-01T12:00:00Z")
    day, minute, second, fraction, zone = found.groups()
    if zone is None:
        raise ProblemError(f"'{text[:40]}' has neither Z nor an offset", "write 2026-01-01T12:00:00Z for UTC")
    if second == "60":
        raise ProblemError(f"'{text[:40]}' is a leap second", "times are UTC without leap seconds")
    try:
        whole = datetime.fromisoformat(f"{day}T{minute}:{second or '00'}{'+00:00' if zone in 'Zz' else zone}")
        since = whole - _EPOCH
    except (ValueError, OverflowError):
        raise ProblemError(f"'{text[:40]}' is not a date", "there is no such day or time") from None
    seconds = Fraction(since.days * 86400 + since.seconds)
    return seconds + (Fraction(int(fraction), 10 ** len(fraction)) if fraction else 0)


@dataclass(frozen=True)
class Calendar:
    """What t = 0 is, and what t counts.

    Parameters
    ----------
    date : of t = 0, in ISO 8601 with Z or an offset
    unit : s, min, h or d

    Raises ProblemError for another unit, or what is no date.
    """

    date: str
    unit: str = "s"

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise ProblemError(f"the unit of time is '{self.unit}'", f"one of: {', '.join(UNITS)}")
        _ = self.origin

    @cached_property
    def origin(self) -> Fraction:
        """Seconds since 1970 of t = 0."""
        return instant(self.date)

    def time(self, text: str) -> float:
        """t of a date, in the unit of time.

        Parameters
        ----------
        text : in ISO 8601 with Z or an offset

        Raises ProblemError where it is none.
        """
        return float((instant(text) - self.origin) / UNITS[self.unit])

    def utc(self, t: float) -> str:
        """The date of a time, to the microsecond: 2026-01-01T00:18:43.25Z; empty beyond the years 1 to 9999.

        Parameters
        ----------
        t : in the unit of time
        """
        try:
            micro = round((Fraction(t) * UNITS[self.unit] + self.origin) * 10**6)
            text = (_EPOCH + timedelta(microseconds=micro)).isoformat().removesuffix("+00:00")
        except (OverflowError, ValueError):
            return ""
        return (text.rstrip("0").rstrip(".") if "." in text else text) + "Z"

    def document(self) -> PlainDict:
        """The keys of `horizon` that say the same."""
        return {"date": self.date, "unit": self.unit}


def calendar_of(problem: object) -> Calendar | None:
    """The calendar of a problem; None where its times are numbers alone.

    Parameters
    ----------
    problem : of any family
    """
    return getattr(problem, "calendar", None)
