"""Runs in the formats of other tools: one module per format, one line here.

A format's module offers write(problem, solution, tables, target) -> list of the files that it wrote.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from occontrol.core.errors import FileAccessError, UsageError, suggest
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.files.run_record import refuse_run_files

# format: the file or folder that it writes inside the run folder when nobody names another
FORMATS = {
    "csv": "csv",
    "json": "export.json",
    "npz": "export.npz",
    "mat": "export.mat",
    "c": "export.h",
    "nc": "export.nc",
    "matlab": "matlab",
}
# what a target compiles instead of reading it, see api/target.py
TARGETS = {"flight": "flight", "fmu": "export.fmu"}

PROOF = "proof_"  # arrays that begin so prove a bound: whoever checks it has the run folder


def check_format(to: str) -> None:
    """Raise UsageError unless `to` is one of FORMATS or TARGETS."""
    if to not in FORMATS and to not in TARGETS:
        raise UsageError(f"there is no format '{to}'\n  hint: {suggest(to, [*FORMATS, *TARGETS])}")


def write_export(
    problem: BaseProblem,
    solution: Solution,
    tables: Mapping[str, np.ndarray],
    to: str,
    run: Path,
    out: str | Path | None,
) -> list[Path]:
    """Write a run for another tool.

    Parameters
    ----------
    problem, solution : of the run
    tables : arrays from which another program runs the filter, by name, of any shape
    to : a name in `FORMATS`
    run : the run folder
    out : file or folder to write, instead of the format's own place inside the run folder

    Returns the files written. Raises UsageError for an unknown format and for the run's own files, FileAccessError
    when they cannot be written.
    """
    check_format(to)
    target = run / FORMATS[to] if out is None else Path(out)
    if target.is_dir() and Path(FORMATS[to]).suffix:
        target = target / FORMATS[to]
    refuse_run_files(run, target)
    others = {name: array for name, array in solution.arrays.items() if not name.startswith(PROOF)}
    solution = replace(solution, arrays=others)
    try:
        return importlib.import_module(f"occontrol.files.export.{to}").write(problem, solution, tables, target)
    except OSError as error:
        raise FileAccessError(f"cannot write {target}: {error.strerror or error}") from error
