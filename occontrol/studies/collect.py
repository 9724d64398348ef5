"""The results of a study as one table, its files and its figures; nothing in them depends on who did which task."""

from __future__ import annotations

import csv
import io
import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from occontrol.core.errors import ProblemError
from occontrol.core.kinds import Plain, PlainDict
from occontrol.core.versions import stamped
from occontrol.files.atomic import write_text
from occontrol.files.plain_json import load_json, to_json
from occontrol.files.spreadsheet import as_text
from occontrol.studies.folder import MOST_TRIES, Entry, StudyFolder

TABLE, FIGURES, PAGE = "table", "figures", "study.html"
FIRST = ("status", "method", "cost", "lower_bound", "relative_gap")
_OWN = ("iterations", "seconds")  # change from run to run, or say nothing of the problem


@dataclass(frozen=True)
class Table:
    """One row a task, in the order of the study.

    Parameters
    ----------
    name : of the study
    axes : the paths that vary, in order
    columns : keys of the rows, in order
    rows : {column: value}; what a task has no value for is left out
    """

    name: str
    axes: tuple[str, ...]
    columns: tuple[str, ...]
    rows: tuple[PlainDict, ...]


def collect(folder: StudyFolder) -> Table:
    """The table of a study; tasks without a result say so in `status`: missing or failed.

    Parameters
    ----------
    folder : of the study

    Cost, bound and gap are the pair at the top of a result; what else a result says in numbers follows.
    """
    content, entries = folder.read()
    axes = tuple(content.get("vary", {}))
    seeded = any(e.seed is not None for e in entries)
    rows = [_row(folder, e) for e in entries]
    columns = ["task", *axes, *(["seed"] if seeded else []), *FIRST]
    for row in rows:
        columns += [key for key in row if key not in columns and key != "message"]
    if any("message" in row for row in rows):
        columns.append("message")
    return Table(str(content.get("study", folder.path.name)), axes, tuple(columns), tuple(rows))


def _row(folder: StudyFolder, entry: Entry) -> PlainDict:
    row: PlainDict = {"task": entry.identity, **entry.point}
    if entry.seed is not None:
        row["seed"] = entry.seed
    result = _result(folder, entry)
    if result is None:
        said = folder.failures(entry.identity)
        row["status"] = "failed" if len(said) >= MOST_TRIES else "missing"
        return {**row, "message": said[-1]} if said else row
    top = result.get("top")
    pair = top if isinstance(top, dict) else result
    row |= {key: result[key] for key in ("status", "method") if key in result}
    row |= {key: pair[key] for key in FIRST[2:] if _is_number(pair.get(key))}
    taken = {*row, *_OWN}
    row |= {key: value for key, value in result.items() if _is_number(value) and key not in taken}
    if result.get("status") == "infeasible":
        row["message"] = str(result.get("message", ""))
    return row


def _result(folder: StudyFolder, entry: Entry) -> PlainDict | None:
    with suppress(OSError, ProblemError):
        content = load_json(folder.result_folder(entry.identity) / "result.json")
        if isinstance(content, dict):
            return content
    return None


def _is_number(value: Plain) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def write_collection(folder: StudyFolder, table: Table, figures: bool = True) -> list[Path]:
    """Write table.csv, table.json, the figures and study.html; the files written.

    Parameters
    ----------
    folder : of the study
    table : from `collect`
    figures : whether to draw

    Raises FileAccessError where they cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([as_text(column) for column in table.columns])
    for row in table.rows:
        writer.writerow([_cell(row.get(column)) for column in table.columns])
    written = [
        write_text(folder.path / f"{TABLE}.csv", text.getvalue()),
        write_text(
            folder.path / f"{TABLE}.json",
            to_json(stamped({"study": table.name, "axes": table.axes, "columns": table.columns, "rows": table.rows})),
        ),
    ]
    if figures:
        from occontrol.files.page.records import write_records_page
        from occontrol.studies.figures import draw

        (folder.path / FIGURES).mkdir(exist_ok=True)
        page, counted = folder.path / PAGE, f"{len(table.rows)} tasks over {', '.join(table.axes) or 'seeds'}"
        written += write_records_page(
            page, table.name, "study", table.rows, draw(table), sentences=[counted], pictures=folder.path / FIGURES
        )
    return written


def _cell(value: Plain) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return as_text(value)
    return repr(value) if _is_number(value) else json.dumps(value)
