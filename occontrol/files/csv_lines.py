"""The lines of a CSV file that comes from outside, with their numbers."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path

from occontrol.core.errors import Collector, Mistake, ProblemError
from occontrol.files.problem_file import read_text

MAX_BYTES = 64 * 2**20
UTC_COLUMNS = ("utc", "utc_end")  # for the eye; nothing reads them


def wrong_line(place: str, what: str, hint: str = "") -> ProblemError:
    """A mistake at a place, file:line."""
    return ProblemError(Mistake((), what, hint, place=place))


def csv_rows(path: Path, columns: tuple[str, ...], kind: str) -> Iterator[tuple[int, list[str]]]:
    """The header and the lines of a CSV file that are not empty, with line numbers; short lines are filled up.

    Parameters
    ----------
    path : the file
    columns : that the header must begin with, once the dates for the eye are left out
    kind : what to call the file, for words

    Raises ProblemError with the line, FileAccessError when the file cannot be read.
    """
    text = read_text(path, MAX_BYTES, kind)
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    header: list[str] | None = None
    unread: list[int] = []
    try:
        for row in reader:
            if not any(field.strip() for field in row):
                continue
            if header is None:
                unread = [i for i, field in enumerate(row) if field.strip().lower() in UTC_COLUMNS]
            row = [field for i, field in enumerate(row) if i not in unread] if unread else row
            if header is None:
                header = [field.strip().lower() for field in row]
                if tuple(header[: len(columns)]) != columns:
                    what = f"the first line is '{','.join(row)[:60]}'"
                    more = ", z1, z2, .." if columns[0] == "t" else ""
                    raise wrong_line(
                        f"{path}:{reader.line_num}", what, "it must name the columns: " + ", ".join(columns) + more
                    )
                yield reader.line_num, header
            elif len(row) < len(columns) - (columns[-1] == "sensors"):
                raise wrong_line(
                    f"{path}:{reader.line_num}", f"the line has {len(row)} fields", "columns: " + ", ".join(columns)
                )
            else:
                yield reader.line_num, row + [""] * (len(columns) - len(row))
    except csv.Error as error:
        raise wrong_line(f"{path}:{reader.line_num}", f"this is not CSV: {error}") from None
    if header is None:
        raise wrong_line(f"{path}:1", "the file is empty", "columns: " + ", ".join(columns))


def number(field: str, name: str, place: str, found: Collector, missing: bool = False) -> float | None:
    """A finite number; None after its mistake was noted, and with `missing` for an empty field or NaN.

    Parameters
    ----------
    field : as it stands in the file
    name : of the column
    place : file:line
    found : where mistakes are noted
    missing : whether there may be no number
    """
    field = field.strip()
    if missing and field.lower() in ("", "nan"):
        return None
    try:
        value = float(field)
    except ValueError:
        value = math.nan
    if "_" in field or not field.isascii() or not math.isfinite(value):
        what = f"{name} is '{field[:40]}', it must be a finite number"
        found.mistakes.append(Mistake((), what, place=place, cause=f"number {name}"))
        return None
    return value


def add(found: Collector, place: str, what: str, hint: str = "") -> None:
    """Note a mistake at file:line.

    Parameters
    ----------
    found : where mistakes are noted
    place : file:line
    what, hint : of the mistake
    """
    found.mistakes.append(Mistake((), what, hint, place=place))
