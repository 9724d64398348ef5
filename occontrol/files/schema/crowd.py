"""A YAML file with a crowd of keys at its top level: judged by its lines, because parsing it would take seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence

from occontrol.core.errors import Mistake, ProblemError
from occontrol.files.schema.words import MOST_UNKNOWN_KEYS, suggest

CROWD = 500  # keys; no family knows more than a few dozen
_KEY = re.compile(r"^([A-Za-z_][\w-]*)[ \t]*:(?=\s|$)", re.MULTILINE)


def refuse_crowd(source: str, file: str, known: Sequence[str]) -> None:
    """ProblemError with the first unknown keys and a count when there are more than `CROWD` keys at the top level.

    Parameters
    ----------
    source : the text
    file : what to call it in a message
    known : keys of the family
    """
    keys = list(_KEY.finditer(source))
    unknown = [key for key in keys if key[1] not in known] if len(keys) > CROWD else []
    if not unknown:
        return
    mistakes, line, at = [], 1, 0
    for key in unknown[: MOST_UNKNOWN_KEYS + 1]:
        line, at = line + source.count("\n", at, key.start()), key.start()
        rest = len(unknown) - MOST_UNKNOWN_KEYS
        first = len(mistakes) < MOST_UNKNOWN_KEYS
        what = f"unknown key '{key[1]}'" if first else f"and {rest} more unknown key{'s' * (rest > 1)}"
        mistakes.append(Mistake((), what, suggest(key[1], known) if first else "", place=f"{file}:{line}:1"))
    raise ProblemError(mistakes)


def family_in(source: str) -> str | None:
    """The family that a line at the top level names; None where there is none.

    Parameters
    ----------
    source : the text
    """
    found = re.search(r"^family[ \t]*:[ \t]*[\"']?([A-Za-z_]+)", source, re.MULTILINE)
    return None if found is None else found[1]
