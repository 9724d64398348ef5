"""Where every key and value of a problem file stands, so that a mistake can name file:line:column."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

from occontrol.core.errors import Mistake, Path, ProblemError
from occontrol.core.kinds import Plain

MAX_DEPTH = 40
Inside: TypeAlias = "dict[str | int, Place] | list[Place] | None"
MOST_MISTAKES = 50  # mistakes reported at once


@dataclass(slots=True)
class Place:
    """Where a value stands (line and column from 1), where its key stands, and the same for what it contains."""

    line: int
    column: int
    key: tuple[int, int] | None = None
    inside: Any = None  # dict of Place, list of Place, or None


@dataclass
class Text:
    """A problem file: plain data and a way to find places in it."""

    file: str
    data: Plain
    find_places: Callable[[], Place]
    mistakes: list[Mistake] = field(default_factory=list)

    @cached_property
    def places(self) -> Place:
        """The place of the whole document, with all others inside; worked out when first asked for."""
        return self.find_places()

    def locate(self, path: Path, key: bool = False) -> tuple[int, int]:
        """Line and column of the value at `path` (or of its key); of the nearest enclosing one if there is none."""
        place = self.places
        for depth, step in enumerate(path):
            inside = place.inside
            if isinstance(inside, dict) and step in inside:
                place = inside[step]
            elif isinstance(inside, list) and isinstance(step, int) and step < len(inside):
                place = inside[step]
            else:
                key = depth > 0  # the thing itself is absent: point at the key of what should hold it
                break
        # a block below its key is better known by the key
        if place.key and (key or (place.inside is not None and place.line > place.key[0])):
            return place.key
        return place.line, place.column

    def placed(self, mistakes: list[Mistake]) -> ProblemError:
        """The mistakes with file:line:column, in the order of the file, each once."""
        placed = []
        for m in mistakes:
            line, column = map(int, m.place.rsplit(":", 2)[1:]) if m.place else self.locate(m.path, m.key)
            placed.append(replace(m, place=f"{self.file}:{line}:{column}"))
        return in_order(placed)


def in_order(mistakes: list[Mistake]) -> ProblemError:
    """Placed mistakes in the order of the file, each once, the first `MOST_MISTAKES` of them."""

    def position(m: Mistake) -> list[int]:
        return [int(part) for part in m.place.split(":")[-2:] if part.isdigit()]

    single = list({(m.place, m.what): m for m in mistakes}.values())
    single.sort(key=position)
    if len(single) > MOST_MISTAKES:
        rest = len(single) - MOST_MISTAKES
        more = f"and {rest} more mistake{'s' * (rest > 1)}"
        single = [*single[:MOST_MISTAKES], Mistake((), more, place=single[MOST_MISTAKES].place)]
    return ProblemError(single)


def at(file: str, line: int, column: int, what: str, hint: str = "") -> ProblemError:
    """One mistake at a known place."""
    return ProblemError(Mistake((), what, hint, place=f"{file}:{line}:{column}"))


def number(text: str) -> int | float:
    """Digits -> int, anything longer or with a point -> float; never a huge integer."""
    return int(text) if len(text) <= 15 and text.lstrip("+-").isdigit() else float(text)
