"""The true states beside simulated measurements: t, x1, x2, .. (`occontrol simulate` writes them)."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from occontrol.core.clock import tolerance
from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.trajectory import Trajectory
from occontrol.files.csv_lines import MAX_BYTES, UTC_COLUMNS
from occontrol.files.problem_file import read_text


def read_truth(path: str | Path, times: np.ndarray, states: int) -> Trajectory:
    """True states at the times of an estimate.

    Parameters
    ----------
    path : CSV with the columns t, x1, x2, ..
    times : (K,) at which they are wanted; the file must have each of them
    states : n

    Raises ProblemError as file:line, FileAccessError when the file cannot be read.
    """
    rows = list(csv.reader(io.StringIO(read_text(Path(path), MAX_BYTES, "file of true states"), newline="")))
    unread = {i for i, field in enumerate(rows[0]) if field.strip().lower() in UTC_COLUMNS} if rows else set()
    rows = [[field for i, field in enumerate(row) if i not in unread] for row in rows] if unread else rows
    values = np.empty((max(len(rows) - 1, 0), states + 1))
    for i, row in enumerate(rows[1:]):
        try:
            values[i] = [float(field) for field in row]
        except ValueError:
            what = f"this is not a line of t and {states} finite states"
            raise ProblemError(Mistake((), what, "columns: t, x1, x2, ..", place=f"{path}:{i + 2}")) from None
    slack = tolerance(float(np.min(np.diff(times), initial=np.inf)) if len(times) > 1 else 0.0, times)
    at = np.searchsorted(values[:, 0], times - slack)
    if not len(values) or np.any(at >= len(values)) or np.any(np.abs(values[at, 0] - times) > slack):
        what = "the file does not have the times of the estimates"
        raise ProblemError(Mistake((), what, "it belongs to the same run and the same grid", place=str(path)))
    return Trajectory(times, values[at, 1:])
