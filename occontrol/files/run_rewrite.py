"""The pictures and the page of a run written again: the same numbers, switched at once like a new result."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

from occontrol.core.errors import FileAccessError
from occontrol.core.kinds import PlainDict
from occontrol.files.plain_json import load_json, to_json
from occontrol.files.run_lock import locked
from occontrol.files.run_record import ARRAYS, PROBLEM, PROVENANCE, REPORT, RESULT
from occontrol.files.run_store import current_run, staged


def rewritten(folder: str | Path, content: PlainDict, draw: Callable[[Path, PlainDict], None]) -> Path:
    """Let `draw` write pictures and page beside a copy of the files of a run, and show that copy.

    Parameters
    ----------
    folder : the run folder
    content : of its result.json as it was read; nothing is written where another result has taken its place
    draw : called with the folder under construction and `content`

    Returns the path of the page. Raises FileAccessError when the folder cannot be written, or has changed meanwhile.
    """
    folder = Path(folder)
    with locked(folder):
        source = current_run(folder) or folder
        if load_json(source / RESULT) != content:
            raise FileAccessError(f"cannot write to {folder}: it holds another result by now\n  hint: once more")
        with staged(folder) as stage:
            origin = load_json(source / PROVENANCE) if (source / PROVENANCE).exists() else {}
            for name in (PROBLEM, ARRAYS, RESULT):
                shutil.copyfile(source / name, stage / name)
            draw(stage, content)
            others = sorted(p for p in stage.rglob("*") if p.is_file() and p.name not in (ARRAYS, PROBLEM, RESULT))
            record = {p.relative_to(stage).as_posix(): _digest(p) for p in others}
            if isinstance(origin, dict):
                (stage / PROVENANCE).write_text(to_json({**origin, "files": record}), encoding="utf-8")
    return folder / REPORT


def _digest(path: Path) -> str:
    return "sha256:" + hashlib.sha256(path.read_bytes()).hexdigest()
