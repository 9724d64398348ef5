"""Names in CSV files that a spreadsheet would compute: '=cmd|..', '+1', '@SUM(1)' get an apostrophe before them.

A spreadsheet then shows them as text. A name that begins with apostrophes and such a sign gets one more, so that
reading, which takes one away, always gives the name back.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

_COMPUTED = re.compile(r"'*[=+\-@\t\r]")
_QUOTED = re.compile(r"'+[=+\-@\t\r]")


class Numbers(str):
    """A cell of numbers joined by ';', which needs no apostrophe."""


def as_text(cell: str) -> str:
    """The cell as a spreadsheet shows it: text.

    Parameters
    ----------
    cell : what stands in it
    """
    return f"'{cell}" if _COMPUTED.match(cell) else cell


def from_text(cell: str) -> str:
    """The cell that `as_text` made this of.

    Parameters
    ----------
    cell : as it was read
    """
    return cell[1:] if _QUOTED.match(cell) else cell


def any_quoted(paths: Iterable[Path]) -> bool:
    """Whether names in the first lines of CSV files carry an apostrophe of ours.

    Parameters
    ----------
    paths : files; those that do not end in .csv are passed over
    """
    for path in paths:
        if path.suffix.lower() == ".csv":
            with open(path, newline="", encoding="utf-8") as file:
                if any(_QUOTED.match(cell) for row in islice(csv.reader(file), 1000) for cell in row):
                    return True
    return False
