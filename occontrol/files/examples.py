"""The problem files that are shipped: in an installed package below occontrol/examples, in a checkout in problems."""

from __future__ import annotations

import os
import re
from pathlib import Path

from occontrol.core.errors import FileAccessError, UsageError, suggest
from occontrol.files.atomic import replacing, write_text

MODELINE = "# yaml-language-server: $schema="
_TABLE = re.compile(r"\b(?:file|table|passes): *[\"']?([\w.-]+\.(?:npz|mat|csv))\b")


def folder() -> Path | None:
    """Where the shipped problem files are; None where there are none."""
    package = Path(__file__).resolve().parents[1]
    candidates = (package / "examples", package.parent / "problems")
    return next((path for path in candidates if any(path.glob("*.yaml"))), None)


def examples() -> dict[str, Path]:
    """The shipped problem files by name."""
    found = folder()
    return {} if found is None else {path.stem: path for path in sorted(found.glob("*.yaml"))}


def heading(path: Path) -> tuple[str, str]:
    """Family and name of a problem file, as they stand in its text.

    Parameters
    ----------
    path : the file
    """
    head = path.read_text(encoding="utf-8", errors="replace")
    words = (re.search(rf"^{key}:\s*(.+?)\s*(?:#.*)?$", head, re.MULTILINE) for key in ("family", "name"))
    family, name = (word.group(1).strip("'\"") if word else "" for word in words)
    return family, name


def with_modeline(text: str, schema: Path) -> str:
    """A problem file whose first line tells editors which keys there are.

    Parameters
    ----------
    text : of the file; a first line of this kind is replaced
    schema : the JSON Schema
    """
    text = text.partition("\n")[2] if text.startswith(MODELINE) else text
    path = schema.as_uri() if re.search(r"\s", str(schema)) else schema.as_posix()
    return f"{MODELINE}{path}\n{text}"


def write_new(target: Path, text: str) -> None:
    """Write a file where none is.

    Parameters
    ----------
    target : the file
    text : its content

    Raises FileAccessError where something has that name already.
    """
    if os.path.lexists(target):
        raise FileAccessError(f"{target} exists already, it was left as it is\n  hint: name another file")
    write_text(target, text)


def copy_example(name: str, target: Path, schema: Path) -> list[Path]:
    """Copy a shipped problem and the tables that it needs, never over an existing file; the files written.

    Parameters
    ----------
    name : of the example, without suffix
    target : the problem file to write; tables go beside it
    schema : the JSON Schema for its first line

    Raises UsageError for an unknown name, FileAccessError where a file exists already or cannot be written.
    """
    known = examples()
    source = known.get(name.removesuffix(".yaml"))
    if source is None:
        hint = suggest(name, known) if known else "they come with the package: install it, or use a checkout"
        raise UsageError(f"there is no example '{name}'\n  hint: {hint}")
    text = source.read_text(encoding="utf-8")
    tables = [source.with_name(table) for table in dict.fromkeys(_TABLE.findall(text))]
    for table in tables:
        if os.path.lexists(place := target.with_name(table.name)):
            raise FileAccessError(f"{place} exists already, it was left as it is\n  hint: a file in another folder")
    write_new(target, with_modeline(text, schema))
    for table in tables:
        with replacing(target.with_name(table.name)) as file:
            file.write(table.read_bytes())
    return [target, *(target.with_name(table.name) for table in tables)]
