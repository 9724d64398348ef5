"""Tables of targets: columns from a CSV file, from an .npz file, or from the problem file itself."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path as FilePath

import numpy as np

from occontrol.core.errors import Path, ProblemError
from occontrol.core.expression import CONSTANTS, FUNCTIONS
from occontrol.files.problem_file import read_text
from occontrol.files.schema.common import Context
from occontrol.files.schema.words import shown, suggest
from occontrol.files.spreadsheet import from_text

MAX_CSV = 64 * 2**20
TEXT = ("name", "target", "resource")  # columns that hold words

Columns = dict[str, np.ndarray]


def read_table(value: object, path: Path, context: Context) -> Columns | None:
    """Columns by name, (rows,) each, numbers but for those in TEXT; None after a mistake.

    Parameters
    ----------
    value : the name of a .csv or .npz file, or {name: list}
    path : of the value in the document
    context : where mistakes are noted
    """
    found = context.found
    if isinstance(value, dict):
        columns = _listed(value, path, context)
    elif isinstance(value, str) and value.lower().endswith(".npz"):
        columns = _npz(value, path, context)
    elif isinstance(value, str) and value.lower().endswith(".csv"):
        columns = _csv(value, path, context)
    else:
        found.add(path, f"the table is {shown(value)}", "the name of a .csv or .npz file, or {column: [..]}")
        return None
    if columns is None:
        return None
    sizes = {name: len(column) for name, column in columns.items()}
    if not sizes or min(sizes.values()) == 0:
        found.add(path, "the table has no rows")
        return None
    if len(set(sizes.values())) > 1:
        short = min(sizes, key=sizes.__getitem__)
        found.add(path, f"the column '{short}' has {sizes[short]} rows, others have {max(sizes.values())}")
        return None
    for name in columns:
        if name in FUNCTIONS or name in CONSTANTS or name == "t" or not name.isidentifier():
            hint = "letters, digits and _, not t, pi, e or the name of a function"
            found.add(path, f"the column '{name[:60]}' cannot be used in formulas", hint)
            return None
    return columns


def _listed(value: dict, path: Path, context: Context) -> Columns | None:
    columns: Columns = {}
    for name, items in value.items():
        kind = str if name in TEXT else (int, float)
        good = isinstance(items, list) and all(isinstance(e, kind) and not isinstance(e, bool) for e in items)
        if not good or (name not in TEXT and not all(math.isfinite(e) for e in items)):
            wanted = "a list of words" if name in TEXT else "a list of finite numbers"
            context.found.add((*path, name), f"the column '{name}' is not {wanted}")
            return None
        columns[str(name)] = np.array(items, dtype=object if name in TEXT else float)
    return columns


def _npz(file: str, path: Path, context: Context) -> Columns | None:
    from occontrol.files.received_arrays import read_arrays

    target = context.tables._inside(file, path)  # pyright: ignore[reportPrivateUsage]
    if target is None:
        return None
    try:
        with target.open("rb") as opened:
            arrays = read_arrays(opened, file)
    except ProblemError as error:
        for m in error.mistakes:
            context.found.add(path, f"{file}: {m.what}", m.hint)
        return None
    columns: Columns = {}
    for name, array in arrays.items():
        words = array.dtype.kind == "U"
        if array.ndim != 1 or (name in TEXT) != words or (not words and array.dtype.kind not in "fiu"):
            context.found.add(path, f"the array '{name}' of {file} is no column", "one entry for every target")
            return None
        columns[name] = array.astype(object if words else float)
        if not words and not np.all(np.isfinite(columns[name])):
            context.found.add(path, f"the column '{name}' of {file} is not finite")
            return None
    return columns


def _csv(file: str, path: Path, context: Context) -> Columns | None:
    target = context.tables._inside(file, path)  # pyright: ignore[reportPrivateUsage]
    if target is None:
        return None
    return parse_csv(target, file, path, context)


def parse_csv(target: FilePath, file: str, path: Path, context: Context) -> Columns | None:
    """The columns of a CSV file with a header; None after a mistake, which names file and line.

    Parameters
    ----------
    target : the file
    file : what the user calls it
    path : of its name in the document
    context : where mistakes are noted
    """
    found = context.found
    try:
        reader = csv.reader(io.StringIO(read_text(target, MAX_CSV, "table"), newline=""), strict=True)
        lines = [(reader.line_num, row) for row in reader if any(field.strip() for field in row)]
    except (csv.Error, ProblemError) as error:
        text = "; ".join(m.what for m in error.mistakes) if isinstance(error, ProblemError) else str(error)
        found.add(path, f"{file} is not a CSV table: {text}")
        return None
    header = [field.strip() for field in lines[0][1]]
    if len(set(header)) < len(header):
        twice = next(name for name in header if header.count(name) > 1)
        found.add(path, f"{file}:1: the column '{twice}' is there twice")
        return None
    values: dict[str, list] = {name: [] for name in header}
    for number, row in lines[1:]:
        if len(row) != len(header):
            found.add(path, f"{file}:{number}: the line has {len(row)} fields, the header names {len(header)}")
            return None
        for name, field in zip(header, row, strict=True):
            if name in TEXT:
                values[name].append(from_text(field.strip()))
                continue
            try:
                entry = float(field)
            except ValueError:
                entry = math.nan
            if not math.isfinite(entry) or "_" in field:
                found.add(path, f"{file}:{number}: {name} is '{field.strip()[:40]}', it must be a finite number")
                return None
            values[name].append(entry)
    return {name: np.array(items, dtype=object if name in TEXT else float) for name, items in values.items()}


def plain_columns(columns: Columns) -> dict[str, list]:
    """Columns as lists, for a problem document."""
    return {name: [str(e) if name in TEXT else float(e) for e in column] for name, column in columns.items()}


def column_numbers(values: np.ndarray, known: list[str], what: str, path: Path, context: Context) -> np.ndarray | None:
    """The (rows,) numbers of names in a list of known ones; None after the mistake of an unknown name.

    Parameters
    ----------
    values : (rows,) names
    known : all names
    what : kind of name, for words
    path : of the table
    context : where mistakes are noted
    """
    number = {name: i for i, name in enumerate(known)}
    found = [number.get(str(name), -1) for name in values]
    if -1 in found:
        name = str(values[found.index(-1)])
        hint = suggest(name, known) if len(known) < 200 else ""
        context.found.add(path, f"the table names an unknown {what} '{name[:60]}'", hint)
        return None
    return np.array(found, dtype=np.int64)
