"""The page of several results: a table of records, pictures, and panels where there are any.

This is the one function for whatever sets results side by side: methods, a front, simulated runs, a study.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from occontrol.core.kinds import Plain, PlainMapping
from occontrol.files.page.content import Group, Page, Table
from occontrol.files.page.document import write_page
from occontrol.files.page.pictures import pictures_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_records_page(
    path: str | Path,
    title: str,
    kind: str,
    records: Sequence[PlainMapping],
    figures: Mapping[str, Figure],
    *,
    sentences: Sequence[str] = (),
    groups: Sequence[Group] = (),
    facts: Sequence[tuple[str, str]] = (),
    pictures: Path | None = None,
    static: bool = False,
) -> list[Path]:
    """Write every figure as a PNG file beside a page, and the page; nothing else in the folder is touched.

    Parameters
    ----------
    path : of the page, whose folder must exist
    title, kind : what it is about, and what kind of page it is
    records : one row of the table each; a record inside a record becomes columns 'outer inner', lists are left out
    figures : by the names of their files, the most telling first
    sentences : what was found, in words
    groups : panels
    facts : (label, text) lines
    pictures : folder of the pictures, created if missing; that of the page if left out
    static : pictures in the place of panels

    Returns the files written. Raises FileAccessError.
    """
    path = Path(path)
    target = path.parent if pictures is None else pictures
    page = Page(
        title=title,
        kind=kind,
        sentences=sentences,
        facts=facts,
        groups=groups,
        tables=[records_table(kind, records)] if records else [],
        pictures=pictures_of(figures, target),
    )
    return [*(target / f"{name}.png" for name in figures), write_page(path, page, static)]


def records_table(title: str, records: Sequence[PlainMapping]) -> Table:
    """Records as a table, one row each; an entry that a record lacks stays empty.

    Parameters
    ----------
    title : above the table
    records : as in `write_records_page`
    """
    flat = [_flat(record) for record in records]
    keys = list(dict.fromkeys(key for record in flat for key in record))
    return Table(title=title, columns={key.replace("_", " "): [record.get(key) for record in flat] for key in keys})


def _flat(record: PlainMapping) -> dict[str, Plain]:
    found: dict[str, Plain] = {}
    for key, value in record.items():
        if isinstance(value, Mapping):
            found |= {f"{key} {inner}": entry for inner, entry in _flat(value).items()}
        elif not isinstance(value, list | tuple):
            found[key] = value
    return found
