"""The folder of a study is its database: study.json, tasks/ID.json, results/ID/, failures/ID.json.

A task is done when results/ID is there: it is written beside its place and renamed. Nothing else is kept, by no engine;
whoever starts again does exactly what has no result yet.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from occontrol.core.errors import FileAccessError, Mistake, ProblemError
from occontrol.core.kinds import Plain, PlainDict, PlainMapping
from occontrol.core.versions import newer, stamped, versions
from occontrol.files.atomic import flush_folder, write_text
from occontrol.files.owner import left_by_the_dead, mark
from occontrol.files.plain_json import load_json, to_json
from occontrol.studies.study_file import Study
from occontrol.studies.tasks import Task

MOST_TRIES = 3
RECORD, TASKS, RESULTS, FAILURES = "study.json", "tasks", "results", "failures"
PARTS = (TASKS, RESULTS, FAILURES)
_IDENTITY = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class Entry:
    """One task as study.json lists it.

    Parameters
    ----------
    identity : which task it is
    point : {path: value}
    seed : or None
    start : identity of the task whose result it begins at, or None
    """

    identity: str
    point: PlainMapping
    seed: int | None
    start: str | None = None


@dataclass(frozen=True)
class StudyFolder:
    """A study on the disk.

    Parameters
    ----------
    path : of the folder
    """

    path: Path

    # ---- what the study is

    def write(self, study: Study, tasks: list[Task]) -> None:
        """Write study.json and every task; results that are there stay.

        Parameters
        ----------
        study : as it was read
        tasks : from `plan`

        Raises FileAccessError where the folder cannot be written or holds something else.
        """
        if self.path.exists() and not self.path.is_dir():
            raise FileAccessError(f"cannot write to {self.path}: it is not a folder")
        record = self.path / RECORD
        # whoever was killed before the record was there has left our own folders alone
        if self.path.is_dir() and not record.exists() and {p.name for p in self.path.iterdir()} - {*PARTS, ".runs"}:
            raise FileAccessError(f"{self.path} is no study's folder\n  hint: --out names another one")
        for part in PARTS:
            _make(self.path / part)
        for task in tasks:
            file = self.task_file(task.identity)
            if not file.exists():
                write_text(file, to_json(task.document))
        content = {
            "study": study.path.stem,
            "base": study.base.name,
            "version": versions()["occontrol"],
            "vary": {path: list(values) for path, values in study.axes.items()},
            "seeds": list(study.seeds),
            "task_timeout": study.task_timeout,
            "tasks": [_listed(task) for task in tasks],
        }
        write_text(record, to_json(stamped(content)))

    def read(self) -> tuple[PlainDict, list[Entry]]:
        """The content of study.json and its tasks in order.

        Raises FileAccessError where there is none, ProblemError where it is damaged.
        """
        record = self.path / RECORD
        try:
            content = load_json(record)
        except OSError as error:
            hint = "occontrol sweep STUDY.yaml makes it"
            raise FileAccessError(f"cannot read {record}: {error.strerror or error}\n  hint: {hint}") from None
        if isinstance(content, dict) and (later := newer(content)):
            raise ProblemError(replace(later, place=str(record)))
        listed = content.get("tasks") if isinstance(content, dict) else None
        entries = [_entry(item) for item in listed] if isinstance(listed, list) else [None]
        if any(entry is None for entry in entries):
            raise ProblemError(Mistake((), "not the record of a study", "sweep the study again", place=str(record)))
        return content, [entry for entry in entries if entry is not None]

    # ---- its tasks

    def task_file(self, identity: str) -> Path:
        """The problem file of a task.

        Parameters
        ----------
        identity : of the task
        """
        return self.path / TASKS / f"{identity}.json"

    def result_folder(self, identity: str) -> Path:
        """Where the result of a task is once it is complete.

        Parameters
        ----------
        identity : of the task
        """
        return self.path / RESULTS / identity

    def done(self, identity: str) -> bool:
        """Whether a task has its result.

        Parameters
        ----------
        identity : of the task
        """
        return self.result_folder(identity).is_dir()

    @contextmanager
    def staged(self, identity: str) -> Iterator[Path]:
        """A folder to write a result into; it becomes results/ID when the block ends without an error.

        Parameters
        ----------
        identity : of the task

        Where another process was faster its result stays: both are of the same task.
        """
        final = self.result_folder(identity)
        stage = final.with_name(f".{identity}{mark()}")
        os.mkdir(stage)
        try:
            yield stage
            flush_folder(stage)
            try:
                os.rename(stage, final)
            except OSError:
                if not final.is_dir():
                    raise
            flush_folder(final.parent)
        finally:
            shutil.rmtree(stage, ignore_errors=True)

    def sweep_the_dead(self) -> None:
        """Remove what killed processes left half written below results/."""
        with suppress(OSError):
            for entry in os.scandir(self.path / RESULTS):
                if left_by_the_dead(entry.name) and entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path, ignore_errors=True)

    # ---- and their failures

    def failures(self, identity: str) -> list[str]:
        """What was said each time that a task failed; empty where it never did.

        Parameters
        ----------
        identity : of the task
        """
        with suppress(OSError, ProblemError):
            content = load_json(self.path / FAILURES / f"{identity}.json")
            messages = content.get("messages") if isinstance(content, dict) else None
            if isinstance(messages, list):
                return [str(m) for m in messages]
        return []

    def failed(self, identity: str, message: str) -> int:
        """Note that a task failed; how often it has by now.

        Parameters
        ----------
        identity : of the task
        message : why
        """
        messages = [*self.failures(identity), message[:2000]]
        write_text(self.path / FAILURES / f"{identity}.json", to_json({"messages": messages}))
        return len(messages)

    def forget_failures(self, identity: str) -> None:
        """A task that has its result has not failed.

        Parameters
        ----------
        identity : of the task
        """
        with suppress(OSError):
            os.unlink(self.path / FAILURES / f"{identity}.json")

    def missing(self, entries: list[Entry]) -> list[Entry]:
        """The tasks that have no result and may be tried, in order.

        Parameters
        ----------
        entries : of the study
        """
        return [entry for entry in entries if not self.settled(entry.identity)]

    def settled(self, identity: str) -> bool:
        """Whether a task has its result, or has failed for good.

        Parameters
        ----------
        identity : of the task
        """
        return self.done(identity) or len(self.failures(identity)) >= MOST_TRIES


def _entry(item: Plain) -> Entry | None:
    if not isinstance(item, dict) or not _IDENTITY.fullmatch(str(item.get("id"))):
        return None
    point, seed, start = item.get("point"), item.get("seed"), item.get("start")
    if not isinstance(point, dict) or not (seed is None or isinstance(seed, int)):
        return None
    if not (start is None or _IDENTITY.fullmatch(str(start))):
        return None
    return Entry(item["id"], point, seed, start)


def _listed(task: Task) -> PlainDict:
    listed: PlainDict = {"id": task.identity, "point": task.point, "seed": task.seed}
    return listed if task.start is None else {**listed, "start": task.start}


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileAccessError(f"cannot write to {folder}: {error.strerror or error}") from error
    if folder.is_symlink():
        raise FileAccessError(f"{folder} is a link\n  hint: --out names another folder")
