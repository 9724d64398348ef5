"""How a study stands: what is done, at work, failed and left."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass

from occontrol.core.kinds import PlainDict
from occontrol.files.owner import MARK, alive
from occontrol.studies.folder import MOST_TRIES, RESULTS, Entry, StudyFolder


@dataclass(frozen=True)
class Standing:
    """How many tasks of a study are where.

    Parameters
    ----------
    folder : of the study
    total, done, writing, left : tasks; `writing` are those of the left whose result is being written now
    failures : what the failed ones said last, by identity
    seconds : that the tasks done took on average, None where none is done
    """

    folder: str
    total: int
    done: int
    writing: int
    left: int
    failures: dict[str, str]
    seconds: float | None = None

    @property
    def failed(self) -> int:
        """Tasks that were tried three times."""
        return len(self.failures)

    def as_dict(self) -> PlainDict:
        """The numbers by name."""
        return {
            "folder": self.folder,
            "tasks": self.total,
            "done": self.done,
            "running": self.writing,
            "failed": self.failed,
            "left": self.left,
            "seconds_per_task": self.seconds,
            "failures": self.failures,
        }

    def pairs(self) -> list[tuple[str, str]]:
        """Label and text for a person."""
        text = f"{self.done} of {self.total}"
        pairs = [("done", text if self.seconds is None else f"{text}, {self.seconds:.3g} s each")]
        if self.failed:
            pairs.append(("failed", f"{self.failed}, each tried {MOST_TRIES} times"))
        if self.left:
            time = "" if self.seconds is None else f", about {self.seconds * self.left:.3g} s of one processor"
            pairs.append(("left", f"{self.left}{time}"))
        return [*pairs, ("folder", f"{self.folder}/")]


def standing(folder: StudyFolder, entries: list[Entry]) -> Standing:
    """How the tasks stand.

    Parameters
    ----------
    folder : of the study
    entries : its tasks, or those of one part
    """
    done = [e for e in entries if folder.done(e.identity)]
    failures = {}
    for entry in entries:
        if not folder.done(entry.identity) and len(said := folder.failures(entry.identity)) >= MOST_TRIES:
            failures[entry.identity] = said[-1].splitlines()[0]
    left = len(entries) - len(done) - len(failures)
    return Standing(
        str(folder.path), len(entries), len(done), _being_written(folder), left, failures, _seconds(folder, done)
    )


def _being_written(folder: StudyFolder) -> int:
    with suppress(OSError):
        found = (MARK.search(name) for name in os.listdir(folder.path / RESULTS))
        return sum(m is not None and alive(int(m[1]), m[2]) for m in found)
    return 0


def _seconds(folder: StudyFolder, done: list[Entry]) -> float | None:
    """Mean of what the results say of their solves, over at most fifty of them."""
    from occontrol.core.errors import ProblemError
    from occontrol.files.plain_json import load_json

    found = []
    for entry in done[:: max(1, len(done) // 50)]:
        with suppress(OSError, ProblemError):
            content = load_json(folder.result_folder(entry.identity) / "result.json")
            if isinstance(content, dict) and isinstance(content.get("seconds"), int | float):
                found.append(float(content["seconds"]))
    return sum(found) / len(found) if found else None
