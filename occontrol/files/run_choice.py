"""Which of two results stays: an interrupted or limited one never replaces a better one of the same problem.

Better is the smaller relative gap of the same digest. What may not stand in DIR goes to DIR/interrupted.
"""

from __future__ import annotations

import enum
import hashlib
import json
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from occontrol.core.errors import FileAccessError, ProblemError
from occontrol.core.kinds import Plain, PlainDict, PlainMapping
from occontrol.core.solution import Status
from occontrol.files.plain_json import parse_json, plain
from occontrol.files.run_read import in_one_piece, open_file
from occontrol.files.run_record import RESULT

UNFINISHED = (Status.INTERRUPTED, Status.LIMIT)
_NOT_ASKED = ("schema_version", "name", "method", "expect")
_EDGES = ("edges", "switch_times")  # what the families call the times at which sensors may change


class Place(enum.Enum):
    """Where a new result goes."""

    HERE = "here"
    INTERRUPTED = "interrupted"
    NOWHERE = "nowhere"


def problem_digest(document: PlainMapping) -> str:
    """The digest of what a problem asks; how it is named and solved does not matter.

    Parameters
    ----------
    document : of the problem, with all tables embedded
    """
    asked = {key: value for key, value in document.items() if key not in _NOT_ASKED}
    text = json.dumps(plain(asked), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return "sha256:" + hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def same_problem(posed: PlainMapping, solved: PlainMapping, digest: str | None = None) -> bool:
    """Whether a run that solved the one problem answers the other; how they are named and solved does not matter.

    A solver may add edges to the horizon. Then the run records the digest of the problem as it was posed. The record
    alone is not believed: apart from the added edges both problems must be equal.

    Parameters
    ----------
    posed : document of the problem that is asked about
    solved : document of the run's own problem
    digest : that the run records, None where it records none
    """
    wanted = problem_digest(posed)
    if problem_digest(solved) == wanted:
        return True
    if digest != wanted or not set(_edges(posed)) <= set(_edges(solved)):
        return False
    return problem_digest(_without_edges(posed)) == problem_digest(_without_edges(solved))


def _edges(document: PlainMapping) -> list[float]:
    horizon = document.get("horizon", {})
    return next((horizon[key] for key in _EDGES if key in horizon), [])


def _without_edges(document: PlainMapping) -> PlainDict:
    horizon = {key: value for key, value in document.get("horizon", {}).items() if key not in _EDGES}
    return {**document, "horizon": horizon}


def place_for(folder: Path, content: PlainMapping) -> tuple[Place, str]:
    """Where a result goes, and in words why it does not go to `folder` itself.

    Parameters
    ----------
    folder : the run folder
    content : of the new result.json
    """
    there = recorded_result(folder)
    if there is None or not unfinished(content):
        return Place.HERE, ""
    if there.get("digest") != content["digest"]:
        if unfinished(there):
            return Place.HERE, ""
        why = f"{folder} keeps the complete result of another problem"
    elif _gap(content) < _gap(there):
        return Place.HERE, ""
    else:
        why = f"{folder} keeps its {there['status']} result{_words(_gap(there))}"
    aside = recorded_result(folder / Place.INTERRUPTED.value)
    if aside is not None and aside.get("digest") == content["digest"] and _gap(aside) <= _gap(content):
        kept = f"{folder / Place.INTERRUPTED.value} keeps its{_words(_gap(aside)) or ' result'}"
        return Place.NOWHERE, f"{why}, {kept}"
    return Place.INTERRUPTED, why


def ends_interruption(folder: Path, content: PlainMapping) -> bool:
    """Whether a result that goes to `folder` makes the one in DIR/interrupted useless.

    Parameters
    ----------
    folder : the run folder
    content : of the new result.json
    """
    aside = recorded_result(folder / Place.INTERRUPTED.value)
    if aside is None or aside.get("digest") != content["digest"]:
        return False
    return not unfinished(content) or _gap(content) <= _gap(aside)


def unfinished(content: PlainMapping) -> bool:
    """Whether the solve ended before its time.

    Parameters
    ----------
    content : of a result.json
    """
    return content.get("status") in UNFINISHED


def recorded_result(folder: Path) -> PlainDict | None:
    """The content of a folder's result.json; None where there is none that can be read.

    Parameters
    ----------
    folder : a run folder, or not
    """

    def read(locate: Callable[[str], Path]) -> Plain:
        with open_file(locate(RESULT), folder / RESULT) as file:
            return parse_json(file.read(), folder / RESULT)

    if folder.is_symlink() and folder.name == Place.INTERRUPTED.value:
        return None
    content = None
    with suppress(OSError, ProblemError, FileAccessError):
        content = in_one_piece(folder, read)
    return content if isinstance(content, dict) and content.get("status") in list(Status) else None


def _gap(content: PlainMapping) -> float:
    """The relative gap at the top; infinite where nothing is proven."""
    top = content.get("top")
    found = top.get("relative_gap") if isinstance(top, Mapping) else content.get("relative_gap")
    proven = isinstance(found, int | float) and not isinstance(found, bool) and math.isfinite(found)
    return float(found) if proven else math.inf  # type: ignore[arg-type]


def _words(gap: float) -> str:
    return f" with a gap of {100 * gap:.3g} %" if math.isfinite(gap) else ""
