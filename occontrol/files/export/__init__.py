"""Runs in the formats of other tools: one module per format, one line here.

A format's module offers write(problem, solution, target) -> list of the files that it wrote.
"""

from __future__ import annotations

import importlib
from pathlib import Path

from occontrol.core.errors import FileAccessError, UsageError

# format: the file or folder that it writes inside the run folder when nobody names another
FORMATS = {
    "csv": "csv",
    "json": "export.json",
    "npz": "export.npz",
    "mat": "export.mat",
    "c": "export.h",
}


def export_run(run: str | Path, to: str, out: str | Path | None = None) -> list[Path]:
    """Write a run for another tool; the run folder alone is enough.

    Parameters
    ----------
    run : the run folder
    to : a name in `FORMATS`
    out : file or folder to write, instead of the format's own place inside the run folder

    Returns the files written. Raises UsageError for an unknown format, ProblemError for a damaged run folder,
    FileAccessError when the files cannot be written.
    """
    if to not in FORMATS:
        raise UsageError(f"there is no format '{to}'\n  hint: there are: {', '.join(FORMATS)}")
    from occontrol.files.problem_file import read_problem
    from occontrol.files.run_folder import read_run
    from occontrol.files.run_record import refuse_run_files

    target = Path(run) / FORMATS[to] if out is None else Path(out)
    if target.is_dir() and Path(FORMATS[to]).suffix:
        target = target / FORMATS[to]
    refuse_run_files(Path(run), target)
    problem, solution = read_run(run, read_problem)
    try:
        return importlib.import_module(f"occontrol.files.export.{to}").write(problem, solution, target)
    except OSError as error:
        raise FileAccessError(f"cannot write {target}: {error.strerror or error}") from error
