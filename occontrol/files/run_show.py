"""The two records of a run folder, result.json and provenance.json, without its problem and its arrays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from occontrol.core.errors import FileAccessError, Mistake, ProblemError
from occontrol.core.kinds import PlainDict
from occontrol.files.plain_json import parse_json
from occontrol.files.run_read import in_one_piece, open_file
from occontrol.files.run_record import PROVENANCE, RESULT


def shown_run(folder: str | Path) -> tuple[PlainDict, PlainDict | None]:
    """The content of result.json, and that of provenance.json where there is one.

    Parameters
    ----------
    folder : the run folder

    Raises ProblemError when one is damaged, FileAccessError when there is no such folder or it cannot be read.
    """
    folder = Path(folder)

    def read(locate: Callable[[str], Path]) -> tuple[PlainDict, PlainDict | None]:
        result = _record(locate(RESULT), folder / RESULT)
        if any(key not in result for key in ("family", "status", "method")):
            what = "not the result of a run: family, status or method is missing"
            raise ProblemError(Mistake((), what, place=str(folder / RESULT)))
        path = locate(RESULT).with_name(PROVENANCE)
        return result, _record(locate(PROVENANCE), folder / PROVENANCE) if path.exists() else None

    try:
        return in_one_piece(folder, read)
    except OSError as error:
        raise FileAccessError(f"cannot read {folder}: {error.strerror or error}") from error


def _record(path: Path, place: Path) -> PlainDict:
    with open_file(path, place) as file:
        content = parse_json(file.read(), place)
    if not isinstance(content, dict):
        raise ProblemError(Mistake((), "not the result of a run: it holds no mapping", place=str(place)))
    return content
