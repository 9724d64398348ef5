"""Problem files of tests: a text, with a few words in it replaced, read from a folder."""

from __future__ import annotations

from pathlib import Path

import occontrol as oc


def written(tmp_path: Path, text: str, *changes: tuple[str, str], more: str = "") -> object:
    """The problem of a text with every (old, new) of `changes`, which must stand there once, and `more` added."""
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path / "x.yaml"
    path.write_text(text + more)
    return oc.read_problem(path)
