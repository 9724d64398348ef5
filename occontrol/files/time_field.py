"""A time in a data file: a number, or a date where the problem has a calendar."""

from __future__ import annotations

import numpy as np

from occontrol.core.calendar import STAMP, UNITS, calendar_of, looks_like_date
from occontrol.core.errors import Collector, Mistake, ProblemError
from occontrol.files.csv_lines import number


class TimeField:
    """Reads the times of a data file.

    Parameters
    ----------
    problem : whose calendar and edges count; None where no problem is known
    found : where mistakes are noted
    """

    def __init__(self, problem: object, found: Collector):
        self.calendar, self.found = calendar_of(problem), found
        edges = np.asarray(getattr(problem, "edges", ()), dtype=float)
        self.edges = edges if self.calendar is not None and edges.ndim == 1 and len(edges) > 1 else np.empty(0)

    def date(self, text: str, name: str, place: str = "", path: tuple = ()) -> float | None:
        """The time of a date; None after its mistake was noted.

        Parameters
        ----------
        text : as it stands in the file
        name : of the column or key
        place, path : where it stands
        """
        if self.calendar is None:
            what, hint = f"{name} is '{text[:40]}', it must be a finite number", "dates need horizon.date"
            self._wrong(what, hint, place, path, f"date {name}")
            return None
        try:
            return self._on_edge(self.calendar.time(text))
        except ProblemError as error:
            mistake = error.mistakes[0]
            kind = mistake.what.rpartition("'")[2]
            self._wrong(f"{name}: {mistake.what}", mistake.hint, place, path, f"date {name}{kind}")
            return None

    def number(self, field: str, name: str, place: str) -> float | None:
        """The time in a field of a CSV file; None after its mistake was noted.

        Parameters
        ----------
        field : as it stands in the file
        name : of the column
        place : file:line
        """
        if looks_like_date(field):
            return self.date(field, name, place)
        return number(field, name, place, self.found)

    def _on_edge(self, time: float) -> float:
        """A date is written to the microsecond: an edge as near as that is what was meant."""
        if not len(self.edges) or self.calendar is None:
            return time
        k = int(np.clip(np.searchsorted(self.edges, time), 1, len(self.edges) - 1))
        k -= int(time - self.edges[k - 1] < self.edges[k] - time)
        gap = float(np.min(np.diff(self.edges[max(k - 1, 0) : k + 2])))
        near = abs(float(self.edges[k]) - time) <= min(STAMP / UNITS[self.calendar.unit], gap / 4)
        return float(self.edges[k]) if near else time

    def _wrong(self, what: str, hint: str, place: str, path: tuple, cause: str) -> None:
        self.found.mistakes.append(Mistake(path, what, hint, place=place, cause=cause))
