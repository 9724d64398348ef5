"""What the shell offers where a family, a method, a format, an example or a run is to be named.

A completer that fails must not disturb the line that is being typed: it offers nothing.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path

import typer


def _quiet(offer: Callable[[typer.Context], Iterable[str]]) -> Callable[[typer.Context, str], list[str]]:
    @wraps(offer)
    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        try:
            return [word for word in offer(ctx) if word.startswith(incomplete)]
        except Exception:
            return []

    del complete.__wrapped__  # its signature is what is asked for
    return complete


@_quiet
def complete_family(ctx: typer.Context) -> Iterable[str]:
    """The families."""
    from occontrol.families import names

    return names()


@_quiet
def complete_example(ctx: typer.Context) -> Iterable[str]:
    """The shipped problems."""
    from occontrol.files.examples import examples

    return examples()


@_quiet
def complete_format(ctx: typer.Context) -> Iterable[str]:
    """The formats of `export`."""
    from occontrol.files.export import FORMATS, TARGETS

    return [*FORMATS, *TARGETS]


@_quiet
def complete_method(ctx: typer.Context) -> Iterable[str]:
    """The methods of the family of FILE; of all families as long as it is not known."""
    from occontrol.families import find_family, names

    words = (os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or "").split()
    known = next((found for word in words if (found := _family_in(word)) in names()), None)
    return dict.fromkeys(m for name in ([known] if known else names()) for m in find_family(name).methods)


@_quiet
def complete_run(ctx: typer.Context) -> Iterable[str]:
    """The run folders here and in runs."""
    found = [path.parent for pattern in ("*/result.json", "runs/*/result.json") for path in Path().glob(pattern)]
    return [str(path) for path in sorted(found)]


def _family_in(word: str) -> str | None:
    """The family of a problem file, if the word names one."""
    path = Path(word)
    if path.suffix.lower() not in (".yaml", ".yml", ".json") or not path.is_file():
        return None
    found = re.search(r"^\W*family\W+(\w+)", path.read_text(encoding="utf-8", errors="replace"), re.MULTILINE)
    return found[1] if found else None
