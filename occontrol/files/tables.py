"""CSV files that leave: measurements, truth, estimates. Numbers are written so that they read back identically."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from occontrol.core.calendar import Calendar
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.state_labels import default_names
from occontrol.core.trajectory import Trajectory
from occontrol.files.atomic import replacing_text
from occontrol.files.spreadsheet import Numbers, as_text


def write_table(path: str | Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    """Write a CSV file and return its path; NaN becomes an empty field, names are text to a spreadsheet too.

    Parameters
    ----------
    path : the file
    header : column names
    rows : texts and numbers

    Raises FileAccessError.
    """
    with replacing_text(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([as_text(str(name)) for name in header])
        for row in rows:
            writer.writerow([_field(entry) for entry in row])
    return Path(path)


def dated(
    header: Sequence[str], rows: Iterable[Sequence[object]], calendar: Calendar | None
) -> tuple[list[str], Iterable[Sequence[object]]]:
    """Header and rows with the date of the first column in a second one, utc; as they are without a calendar.

    Parameters
    ----------
    header : column names, that of time first
    rows : texts and numbers
    calendar : of the problem, or None
    """
    if calendar is None:
        return list(header), rows
    return [header[0], "utc", *header[1:]], ([row[0], calendar.utc(_time(row[0])), *row[1:]] for row in rows)


def _time(entry: object) -> float:
    return float(entry)  # type: ignore[arg-type]


def _field(entry: object) -> str:
    if isinstance(entry, float | np.floating):
        return repr(float(entry)) if np.isfinite(entry) else ""
    return str(entry) if isinstance(entry, Numbers) else as_text(str(entry))


def write_measurements(path: str | Path, measurements: Sequence[Measurement], calendar: Calendar | None = None) -> Path:
    """Write a measurement file: t, sensor, z1, z2, ..

    Parameters
    ----------
    path : the file
    measurements : list of Measurement
    calendar : adds the column utc
    """
    width = max((len(m.values) for m in measurements), default=1)
    rows = ([float(m.time), m.sensor, *m.values, *[""] * (width - len(m.values))] for m in measurements)
    return write_table(path, *dated(["t", "sensor", *(f"z{i + 1}" for i in range(width))], rows, calendar))


def write_truth(
    path: str | Path, truth: Trajectory, names: Sequence[str] = (), calendar: Calendar | None = None
) -> Path:
    """Write a true trajectory: t, x1, x2, ..

    Parameters
    ----------
    path : the file
    truth : Trajectory with values (N+1, n)
    names : of the states; x1, x2, .. if left out
    calendar : adds the column utc
    """
    names = names or default_names(truth.values.shape[1])
    rows = ([float(t), *x] for t, x in zip(truth.times, truth.values, strict=True))
    return write_table(path, *dated(["t", *names], rows, calendar))


def write_estimate(
    path: str | Path,
    estimate: Estimate,
    names: Sequence[str] = (),
    nees: np.ndarray | None = None,
    calendar: Calendar | None = None,
) -> Path:
    """Write what a filter found: t, x1.., sd_x1.., w1.., sd_w1.., nis, and where known w1_now.., sd_w1_now.., nees.

    Parameters
    ----------
    path : the file
    estimate : Estimate with K rows
    names : of the states, in place of x1, x2, ..
    nees : (K,) normalised estimation error squared, where the truth is known
    calendar : adds the column utc
    """
    p, names = estimate.predicted.shape[1], names or default_names(estimate.mean.shape[1])
    header = ["t", *names, *(f"sd_{name}" for name in names)]
    header += [*(f"w{i + 1}" for i in range(p)), *(f"sd_w{i + 1}" for i in range(p)), "nis"]
    parts = [estimate.times[:, None], estimate.mean, estimate.standard_deviation]
    parts += [estimate.predicted, estimate.predicted_deviation, estimate.nis[:, None]]
    if estimate.output is not None and estimate.output_deviation is not None:
        header += [*(f"w{i + 1}_now" for i in range(p)), *(f"sd_w{i + 1}_now" for i in range(p))]
        parts += [estimate.output, estimate.output_deviation]
    if nees is not None:
        header, parts = [*header, "nees"], [*parts, nees[:, None]]
    return write_table(path, *dated(header, np.hstack(parts), calendar))
