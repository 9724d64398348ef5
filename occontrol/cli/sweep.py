"""occontrol sweep and occontrol work: a study of many problems, on this machine or on a cluster."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from occontrol.cli.output import note, print_json, print_pairs

if TYPE_CHECKING:
    from occontrol.studies.engines.local import Progress
    from occontrol.studies.folder import Entry, StudyFolder

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="Study file, or a study's folder.")]
SOME_LEFT, SOME_FAILED = 5, 6
EVERY = 10.0  # seconds between lines of progress away from a terminal


def sweep(
    study: StudyFile,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", min=1, max=1024, help="Processes [default: cores].")
    ] = None,
    cluster: Annotated[str | None, typer.Option("--cluster", help="slurm-array, dask, or tls://HOST:PORT.")] = None,
    tasks_per_job: Annotated[int, typer.Option("--tasks-per-job", min=1, help="Of a SLURM array.")] = 50,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder [default: STUDY's name].")] = None,
    status: Annotated[bool, typer.Option("--status", help="Say what is done, and do nothing.")] = False,
    collect: Annotated[bool, typer.Option("--collect", help="Write table and figures of what is done.")] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Try again what failed three times.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the outcome as JSON.")] = False,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figures.")] = True,
) -> int:
    """Solve every problem of a study; what is done is never done again."""
    from occontrol.cli.watch import announce, exit_code, watched

    announce(f"sweeping {study}")
    from occontrol.studies.engines.dask import check_address, run_on_dask
    from occontrol.studies.engines.local import run_here
    from occontrol.studies.engines.slurm import write_array

    if cluster is not None and cluster != "slurm-array":
        check_address(cluster)
    if status:
        folder, entries = _known(study, out)
        return _report(folder, entries, json, SOME_LEFT)
    if collect:
        folder, entries = _known(study, out)
        _collect(folder, figures)
        return _report(folder, entries, json, SOME_LEFT)
    folder, entries, timeout = _prepared(study, out)
    if cluster == "slurm-array":
        script, parts = write_array(folder, len(entries), tasks_per_job)
        print(f"written  {script}\nnext     sbatch --array=0-{parts - 1} --time=1:00:00 --mem=2G {script}")
        print(f"then     occontrol sweep {study} --status, and --collect")
        return 0
    from occontrol.files.run_lock import locked

    workers = jobs or os.cpu_count() or 1
    with watched() as monitor, locked(folder.path):
        folder.sweep_the_dead()
        for entry in entries if retry else ():
            folder.forget_failures(entry.identity)
        tell = _Teller()
        stopped = lambda: bool(monitor.interrupted)  # noqa: E731
        if cluster is None:
            run_here(folder, entries, workers, timeout, stopped, tell)
        else:
            run_on_dask(folder, entries, cluster, workers, stopped, tell)
        tell.end()
        folder.sweep_the_dead()
        if not monitor.interrupted:
            _collect(folder, figures)
        return exit_code(monitor, _report(folder, entries, json, SOME_LEFT))


def work(
    study: StudyFile,
    part: Annotated[str, typer.Option("--part", metavar="I/N", help="Which part of N, counted from 0.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="The study's folder.")] = None,
) -> int:
    """Do one part of a study that `sweep --cluster slurm-array` has written: the line of a job array."""
    from occontrol.cli.watch import announce, exit_code, watched

    announce(f"working at part {part} of {study}")
    from occontrol.studies.engines.local import run_here
    from occontrol.studies.queue import part_of

    index, parts = _part(part)
    folder, entries = _known(study, out)
    content, _ = folder.read()
    timeout = content.get("task_timeout")
    own = part_of(entries, index, parts)
    folder.sweep_the_dead()
    with watched() as monitor:
        tell = _Teller()
        run_here(folder, own, 1, timeout, lambda: bool(monitor.interrupted), tell)
        tell.end()
        return exit_code(monitor, _report(folder, own, False, SOME_LEFT))


def _part(text: str) -> tuple[int, int]:
    from occontrol.core.errors import UsageError

    try:
        first, last = text.split("/")
        index, parts = int(first), int(last)
        if not 0 <= index < parts <= 1_000_000:
            raise ValueError
    except ValueError:
        raise UsageError(f"--part {text} is not I/N\n  hint: I = 0 .. N-1, for example --part 3/20") from None
    return index, parts


def _prepared(study: Path, out: Path | None) -> tuple[StudyFolder, list[Entry], float | None]:
    """The folder of a study, with every task written into it; a folder stands for what it holds."""
    from occontrol.files.atomic import refuse_same
    from occontrol.studies import read_study
    from occontrol.studies.folder import RECORD, StudyFolder
    from occontrol.studies.tasks import plan

    if study.is_dir():
        folder = StudyFolder(study)
        content, entries = folder.read()
        return folder, entries, content.get("task_timeout")
    read = read_study(study)
    folder = StudyFolder(read.folder if out is None else out)
    refuse_same([folder.path / RECORD], [study, read.base])
    folder.write(read, plan(read))
    return folder, folder.read()[1], read.task_timeout


def _known(study: Path, out: Path | None) -> tuple[StudyFolder, list[Entry]]:
    from occontrol.studies.folder import StudyFolder

    folder = StudyFolder(out if out is not None else study if study.is_dir() else study.with_suffix(""))
    return folder, folder.read()[1]


def _collect(folder: StudyFolder, figures: bool) -> None:
    from occontrol.studies.collect import collect, write_collection

    write_collection(folder, collect(folder), figures)


def _report(folder: StudyFolder, entries: list[Entry], json: bool, left_code: int) -> int:
    """Print how a study stands; the exit code: 0 all done, 5 some left, 6 some failed three times."""
    from occontrol.studies.status import standing

    told = standing(folder, entries)
    if json:
        print_json(told.as_dict())
    else:
        print_pairs(told.pairs())
    for identity, message in told.failures.items():
        note(f"{identity} failed: {message}")
    if told.failed:
        return SOME_FAILED
    return left_code if told.left else 0


class _Teller:
    """One line every ten seconds on standard error; on a terminal one line that changes."""

    def __init__(self) -> None:
        self.began = self.said = time.monotonic()
        self.start: int | None = None
        self.on_terminal = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"

    def __call__(self, progress: Progress) -> None:
        from occontrol.cli.watch import hush

        now = time.monotonic()
        if self.start is None:
            self.start = progress.done
        if now - self.said < (0.5 if self.on_terminal else EVERY):
            return
        hush()
        self.said = now
        fresh, rest = progress.done - self.start, progress.total - progress.done - progress.failed
        text = f"{progress.done} of {progress.total} done"
        if progress.failed:
            text += f", {progress.failed} failed"
        if fresh and rest:
            text += f", about {(now - self.began) / fresh * rest:.0f} s left"
        print(f"\r\x1b[K{text}" if self.on_terminal else text, end="" if self.on_terminal else "\n", file=sys.stderr)
        sys.stderr.flush()

    def end(self) -> None:
        """Leave the line of progress."""
        if self.on_terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
