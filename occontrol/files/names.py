"""Names that come out of a file and will be columns, variables or parts of a file's name: one check for all of them."""

from __future__ import annotations

import re
from collections.abc import Iterable

from occontrol.core.errors import Mistake, ProblemError, printable

LONGEST = 64
_NAME = re.compile(rf"[A-Za-z_][A-Za-z0-9_]{{0,{LONGEST - 1}}}")
HINT = f"letters, digits and _, no digit first, at most {LONGEST} characters"
# what the exports write beside the arrays, and the name of a parameter of numpy's writer
TAKEN = frozenset({"file", "schedule", "sensors", "gains", "continuous_gains"})


def is_name(text: object) -> bool:
    """Whether a text is a plain ASCII name, [A-Za-z_][A-Za-z0-9_]*, of at most `LONGEST` characters.

    Parameters
    ----------
    text : anything
    """
    return isinstance(text, str) and _NAME.fullmatch(text) is not None


def check_names(names: Iterable[object], kind: str, place: str, taken: frozenset[str] = frozenset()) -> None:
    """ProblemError for names that are not plain; nothing that a file says ever becomes a path.

    Parameters
    ----------
    names : as they stand in the file
    kind : what each of them names, "an array"
    place : the file
    taken : plain names that mean something else already
    """
    wrong = [name for name in names if not is_name(name) or name in taken]
    if not wrong:
        return
    mistakes = []
    for name in wrong[:20]:
        text = printable(str(name))[:80]
        if is_name(name):
            mistakes.append(Mistake((), f"the name '{text}' of {kind} is taken", "use another name", place=place))
        else:
            mistakes.append(Mistake((), f"'{text}' is no name for {kind}", HINT, place=place))
    if len(wrong) > 20:
        mistakes.append(Mistake((), f"and {len(wrong) - 20} more names that are none", place=place))
    raise ProblemError(mistakes)
