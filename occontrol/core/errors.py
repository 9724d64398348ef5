"""Mistakes in what the user gave, and numerical failures.

A mistake names the place by a path of keys and indices into the problem document, for example
``("sensors", 2, "C")``; the file reader turns such a path into file:line:column.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

Path = tuple[str | int, ...]
LONGEST = 600


@dataclass(frozen=True)
class Mistake:
    """One thing that is wrong: where (a path into the problem), what, and how to mend it.

    `key` points at the key itself rather than at its value (unknown or repeated keys).
    `place` is filled in by the file reader: "problems/x.yaml:14:11". In data of many lines `cause` says which mistakes
    are the same one made again, see `one_per_cause`.
    """

    path: Path
    what: str
    hint: str = ""
    key: bool = False
    place: str = ""
    cause: str = ""

    def under(self, *prefix: str | int) -> Mistake:
        """The same mistake, seen from further up the document."""
        return replace(self, path=(*prefix, *self.path))

    def moved(self, path: Path) -> Mistake:
        """The same mistake at another path."""
        return replace(self, path=path)

    def __str__(self) -> str:
        place = printable(self.place or spell_path(self.path))
        text = f"{place}: {printable(self.what)}" if place else printable(self.what)
        return f"{text}\n  hint: {printable(self.hint)}" if self.hint else text


def printable(text: str) -> str:
    """What a file says may be quoted to a terminal: no control characters, and not without end."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST - 100]} ... {text[-100:]}"
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def one_per_cause(mistakes: Iterable[Mistake]) -> list[Mistake]:
    """The first mistake of every cause (of the same words, where none is given), with the number of the others.

    Parameters
    ----------
    mistakes : in the order of the file
    """
    groups: dict[str, list[Mistake]] = {}
    for m in mistakes:
        groups.setdefault(m.cause or f"{m.path} {m.what}", []).append(m)
    return [
        replace(first, what=f"{first.what}, and {plural(len(others), 'more line')} like it") if others else first
        for first, *others in groups.values()
    ]


def suggest(name: str, known: Iterable[str], listed_as: str = "there are") -> str:
    """A hint for the misspelt `name`: the closest of the `known` names, small letters or capitals, or all of them.

    Parameters
    ----------
    name : as the user wrote it
    known : what could be meant
    listed_as : what stands before the list of all
    """
    known = list(known)
    lower = {word.lower(): word for word in reversed(known)}
    close = difflib.get_close_matches(name.lower(), lower, n=1)
    return f"did you mean '{lower[close[0]]}'?" if close else f"{listed_as}: " + ", ".join(known)


def plural(count: int, thing: str) -> str:
    """The count with the noun in the right number: 1 state, 2 states."""
    return f"{count} {thing}{'s' * (count != 1)}"


def spell_path(path: Sequence[str | int]) -> str:
    """("sensors", 2, "C") as the user would write it: sensors[2].C"""
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else (f".{step}" if text else step)
    return text


class OccontrolError(Exception):
    """Any error that a user can cause; `exit_code` is what the command line returns."""

    exit_code = 6


class ProblemError(OccontrolError):
    """The problem, schedule or measurement data is wrong; carries every mistake that was found."""

    exit_code = 3

    def __init__(self, mistakes: Iterable[Mistake] | Mistake | str, hint: str = ""):
        if isinstance(mistakes, str):
            mistakes = Mistake((), mistakes, hint)
        self.mistakes = [mistakes] if isinstance(mistakes, Mistake) else list(mistakes)
        super().__init__("\n".join(str(m) for m in self.mistakes))


class UsageError(OccontrolError):
    """An unknown method, format or option."""

    exit_code = 2


class InfeasibleError(OccontrolError):
    """No schedule exists, with the reason (for example the time at which no sensor is available)."""

    exit_code = 4


class SolveFailed(OccontrolError):
    """A solver ended with nothing usable; the text names the knob to turn."""

    exit_code = 6


class FileAccessError(OccontrolError):
    """A file cannot be read or written."""

    exit_code = 8


class Collector:
    """Gathers mistakes so that several are reported together.

    >>> with collector.under("plant"):          # doctest: +SKIP
    ...     plant = LinearPlant(...)            # a ProblemError raised here is kept, and its paths are prefixed
    """

    def __init__(self) -> None:
        self.mistakes: list[Mistake] = []

    def add(self, path: Path, what: str, hint: str = "", key: bool = False) -> None:
        self.mistakes.append(Mistake(path, what, hint, key))

    def under(self, *prefix: str | int) -> _Under:
        return _Under(self, prefix)

    def raise_if_any(self) -> None:
        """Raise ProblemError with every mistake collected so far; do nothing where there is none."""
        if self.mistakes:
            raise ProblemError(self.mistakes)


class _Under:
    def __init__(self, collector: Collector, prefix: Path):
        self.collector, self.prefix = collector, prefix

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind, error, trace) -> bool:
        if isinstance(error, ProblemError):
            self.collector.mistakes += [m.under(*self.prefix) for m in error.mistakes]
            return True
        return False
