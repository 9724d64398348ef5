"""Schedules of readings: which sensors are read at every instant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import Collector, Mistake, ProblemError, plural, suggest
from occontrol.core.schedule import INTEGER, Schedule
from occontrol.core.sensor import IDLE


@dataclass(frozen=True, eq=False)
class ReadingSchedule(Schedule):
    """Which sensors give a reading at the instants edges[0] .. edges[N-1]; the last edge ends the picture.

    Parameters
    ----------
    edges : (N+1,) the instants of the readings and one time after the last
    weights : (N, M) 1 where a sensor is read; fractions belong to the relaxed problem
    names : the M sensor names
    variable : "k" for the steps of discrete time, "t" for sample times
    idle_alone : idle is named only where nothing else is read
    """

    variable: str = "t"
    idle_alone: bool = False

    @property
    def times(self) -> np.ndarray:
        """(N,) the instants."""
        return self.edges[:-1]

    def segments(self) -> list[dict]:
        """[{k or t, sensors: [name, ..]}], one entry for every instant, never merged.

        Fractional entries carry `weights` beside `sensors` (those above 1e-6).
        """
        return [self._entry(k, v) for k, v in enumerate(self.weights)]

    def _entry(self, k: int, v: np.ndarray) -> dict:
        used = [j for j in range(len(v)) if v[j] > INTEGER]
        real = [j for j in used if self.names[j] != IDLE]
        used = real if self.idle_alone and real else used
        at = int(self.edges[k]) if self.variable == "k" else float(self.edges[k])
        entry: dict = {self.variable: at, "sensors": [self.names[j] for j in used]}
        if any(abs(v[j] - np.round(v[j])) > INTEGER for j in used):
            entry["weights"] = [float(v[j]) for j in used]
        return entry


@dataclass(frozen=True)
class Reading:
    """From `start` to `end`, both included, these sensors are read, with these shares (None: wholly).

    Parameters
    ----------
    start, end : times; equal for a single instant
    sensors : names
    weights : shares, one a name, or None
    place : file:line for messages
    """

    start: float
    end: float
    sensors: tuple[str, ...]
    weights: tuple[float, ...] | None
    place: str = ""


def readings_of(
    entries: Sequence[Reading], times: np.ndarray, names: Sequence[str], select: tuple[int, int],
    variable: str = "t", slews: bool = False,
) -> np.ndarray:  # fmt: skip
    """The weights (N, M) of entries that anybody wrote, idle filling what is left.

    Parameters
    ----------
    entries : in any order
    times : (N,) the instants of the problem, in the unit of time
    names : the M sensors of the columns, perhaps idle among them
    select : (least, most) sensors at a time; where idle is among the names it fills up to `most`
    variable : "k" or "t", for words
    slews : whether an instant may be given to a change of sensors: an entry without any sensor

    Raises ProblemError with every mistake: a time that is no instant, an unknown or repeated name, an instant that is
    named twice, too many sensors, too few where idle is not allowed.
    """
    found, places = Collector(), list(names)
    weights = np.zeros((len(times), len(places)))
    taken = np.zeros(len(times), dtype=bool)
    gaps = np.diff(times)
    slack = 1e-6 * (float(np.min(gaps)) if len(gaps) else 1.0)
    idle = places.index(IDLE) if IDLE in places else None

    def wrong(entry: Reading, what: str, hint: str = "") -> None:
        found.mistakes.append(Mistake((), what, hint, place=entry.place))

    for entry in entries:
        inside = np.flatnonzero((times >= entry.start - slack) & (times <= entry.end + slack))
        if not len(inside):
            near = times[np.argsort(np.abs(times - entry.start))[:2]]
            shown = " and ".join(f"{t:.9g}" for t in np.sort(near))
            wrong(entry, f"there is no reading at {variable} = {entry.start:.9g}", f"the nearest are at {shown}")
            continue
        row = np.zeros(len(places))
        shares = entry.weights or (1.0,) * len(entry.sensors)
        for name, share in zip(entry.sensors, shares, strict=True):
            if name not in places and name != IDLE:
                wrong(entry, f"there is no sensor '{name}'", suggest(name, places))
            elif name not in places:
                continue
            elif row[places.index(name)] > 0 and name != IDLE:
                wrong(entry, f"sensor '{name}' is named twice")
            elif not 0 <= share <= (select[1] if name == IDLE else 1) + INTEGER:
                wrong(entry, f"the weight of sensor '{name}' is {share:g}, it must lie between 0 and 1")
            else:
                row[places.index(name)] += share
        if np.any(taken[inside]):
            k = int(inside[np.argmax(taken[inside])])
            wrong(entry, f"{variable} = {times[k]:.9g} is named a second time", "one line for every instant")
            continue
        taken[inside] = True
        weights[inside] = row
    total = np.sum(weights, axis=1)
    lost = taken & (total == 0) & slews
    if idle is not None:
        weights[~lost, idle] += np.maximum(select[1] - total[~lost], 0.0)
        total = np.maximum(total, select[1])
    total[lost] = select[1]
    if not found.mistakes:
        _require_sums(weights, total, taken, times, select[1], variable, found)
    if found.mistakes:
        raise ProblemError(found.mistakes)
    return weights


def _require_sums(
    weights: np.ndarray, total: np.ndarray, taken: np.ndarray, times: np.ndarray, most: int, variable: str,
    found: Collector,
) -> None:  # fmt: skip
    """A mistake at the first instant with too few or too many sensors."""
    bad = np.abs(total - most) > INTEGER * max(1, most)
    if not np.any(bad):
        return
    k = int(np.argmax(bad))
    more = f", and at {plural(int(np.sum(bad)) - 1, 'other instant')}" if np.sum(bad) > 1 else ""
    when = f"at {variable} = {times[k]:.9g}{more}"
    if not taken[k]:
        found.add((), f"nothing is said {when}", f"every instant needs {plural(most, 'sensor')}, or idle")
    else:
        found.add((), f"{total[k]:g} sensors are read {when}, but select is {most}")
