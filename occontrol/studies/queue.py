"""The order in which tasks are done: one that starts from another's result waits for it.

A task whose `start` failed for good begins cold, as the first of its row does. So what a task computes depends on the
study alone, not on who does what when.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

from occontrol.studies.folder import Entry, StudyFolder


class TaskQueue:
    """Tasks that are still to be done, those first that need wait for nothing.

    What has failed before is tried last: whatever ends workers early would else meet the same task at every start.

    Parameters
    ----------
    folder : of the study
    entries : its tasks without a result that may be tried, in order
    """

    def __init__(self, folder: StudyFolder, entries: Iterable[Entry]) -> None:
        self._folder = folder
        self._waiting = deque(sorted(entries, key=lambda entry: len(folder.failures(entry.identity))))

    def __len__(self) -> int:
        return len(self._waiting)

    def take(self) -> Entry | None:
        """The next task that can begin, which leaves the queue; None where each waits for one that is being done."""
        for place, entry in enumerate(self._waiting):
            if entry.start is None or self._folder.settled(entry.start):
                del self._waiting[place]
                return entry
        return None

    def again(self, entry: Entry, first: bool = False) -> None:
        """Put a task back.

        Parameters
        ----------
        entry : that was taken
        first : before all others, else behind them
        """
        (self._waiting.appendleft if first else self._waiting.append)(entry)


def part_of(entries: Sequence[Entry], index: int, parts: int) -> list[Entry]:
    """The tasks of one part of a study, whole rows of tasks that start from each other.

    Parameters
    ----------
    entries : of the study, each behind the one that it starts from
    index, parts : which part of how many, from 0
    """
    rows: dict[str, int] = {}
    for entry in entries:
        rows[entry.identity] = rows[entry.start] if entry.start in rows else len(set(rows.values()))
    return [entry for entry in entries if rows[entry.identity] % parts == index]
