"""Dates in a problem file become times before anything else looks at them: `horizon: {date: .., unit: ..}`."""

from __future__ import annotations

from occontrol.core.calendar import Calendar, looks_like_date
from occontrol.core.errors import Collector, Mistake, Path, ProblemError
from occontrol.core.kinds import Plain
from occontrol.files.schema.words import shown

TIMES = ("windows", "times")  # keys below which a text that begins as a date is one
_OWN = ("date", "unit")


def with_times(data: Plain, found: Collector) -> tuple[Plain, Calendar | None]:
    """The document with a number for every date, and its calendar; mistakes are noted.

    Parameters
    ----------
    data : the plain document
    found : where mistakes are noted
    """
    horizon = data.get("horizon") if isinstance(data, dict) else None
    if not isinstance(horizon, dict):
        return data, None
    calendar = _calendar(horizon, found)
    reader = _Reader(calendar, found, "date" in horizon)
    changed = {key: reader.read(value, (key,), False) for key, value in data.items() if key != "horizon"}
    own = {k: v if k in _OWN else reader.read(v, ("horizon", k), True) for k, v in horizon.items()}
    return {key: own if key == "horizon" else changed[key] for key in data}, calendar


def _calendar(horizon: dict, found: Collector) -> Calendar | None:
    date, unit = horizon.get("date"), horizon.get("unit", "s")
    if date is None and "unit" in horizon:
        found.add(("horizon", "unit"), "horizon has a 'unit' without a 'date'", "date: 2026-01-01T00:00:00Z", True)
    if not isinstance(date, str) or not isinstance(unit, str):
        if date is not None:
            key, value = ("unit", unit) if isinstance(date, str) else ("date", date)
            found.add(("horizon", key), f"horizon.{key} is {shown(value)}", "date: 2026-01-01T00:00:00Z, unit: s")
        return None
    try:
        return Calendar(date, unit)
    except ProblemError as error:
        for m in error.mistakes:
            key = "unit" if "unit" in m.what else "date"
            found.add(("horizon", key), f"horizon.{key}: {m.what}", m.hint)
        return None


def _numbers(value: list) -> bool:
    """Whether a list begins as a matrix or a table does, which may be long."""
    while value and isinstance(value[0], list):
        value = value[0]
    return not value or isinstance(value[0], int | float)


class _Reader:
    """Looks for dates and notes those that cannot be read."""

    def __init__(self, calendar: Calendar | None, found: Collector, stated: bool):
        self.calendar, self.found, self.stated = calendar, found, stated

    def read(self, value: Plain, path: Path, inside: bool) -> Plain:
        """The value with times for dates; what has none is handed back as it is."""
        if isinstance(value, dict):
            return {k: self.read(v, (*path, k), inside or k in TIMES) for k, v in value.items()}
        if isinstance(value, list):
            if not inside and _numbers(value):
                return value
            return [self.read(item, (*path, i), inside) for i, item in enumerate(value)]
        if not inside or not looks_like_date(value):
            return value
        if self.calendar is None:
            if not self.stated:
                what = f"a date stands here, '{value[:40]}', and horizon has no 'date'"
                hint = "horizon: {date: 2026-01-01T00:00:00Z, unit: s} says what t = 0 is"
                self.found.mistakes.append(Mistake(path, what, hint, cause="no date"))
            return 0.0
        try:
            return self.calendar.time(value)
        except ProblemError as error:
            for m in error.mistakes:
                self.found.add(path, m.what, m.hint)
            return 0.0
