"""A path such as sensors.range.noise in a problem document: found, and given another value."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable, Sequence

from occontrol.core.errors import Mistake, Path, suggest
from occontrol.core.kinds import Plain, PlainDict

_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
NAME = ("method", "name")


class NoSuchPath(Exception):
    """A path that the problem does not have; `hint` says what is near."""

    def __init__(self, what: str, hint: str = ""):
        super().__init__(what)
        self.what, self.hint = what, hint


def split(text: str) -> list[str | int]:
    """The steps of a path: 'sensors.range.noise[0][0]' is ['sensors', 'range', 'noise', 0, 0].

    Raises NoSuchPath for what is no path.
    """
    steps: list[str | int] = []
    rest = text
    while rest:
        found = _STEP.match(rest)
        if found is None:
            raise NoSuchPath(f"'{text}' is not a path", "for example sensors.range.noise or plant.A[1][0]")
        steps.append(int(found[2]) if found[2] else found[1])
        rest = rest[found.end() :]
        if rest.startswith("."):
            rest = rest[1:]
            if not rest or rest.startswith(("[", ".")):
                raise NoSuchPath(f"'{text}' is not a path", "for example sensors.range.noise or plant.A[1][0]")
    if not steps:
        raise NoSuchPath("an empty path", "for example objective.cost_weight")
    return steps


def resolve(document: Plain, text: str, known: Iterable[str] = ()) -> Path:
    """The keys and indices that a path means in a document; things of a list are known by their `name` or number.

    Parameters
    ----------
    document : plain data of a problem file
    text : such as sensors.range.noise; numbers count from 0
    known : keys that the problem could have at its top

    The last key may be absent: a value that the problem leaves out can vary too. Raises NoSuchPath.
    """
    path: list[str | int] = []
    steps = split(text)
    for depth, step in enumerate(steps):
        last = depth == len(steps) - 1
        if isinstance(document, dict):
            if step not in document and not (last and isinstance(step, str)):
                if not isinstance(step, str) or (depth == 0 and step not in known):
                    hint = suggest(str(step), [*map(str, document), *(k for k in known if k not in document)])
                    raise NoSuchPath(f"the base problem has no '{step}'", hint)
                document = {}  # a mapping that the problem leaves out altogether
                path.append(step)
                continue
            path.append(step)
            document = document.get(step)
        elif isinstance(document, list):
            index = _index(document, step, ".".join(str(s) for s in steps[:depth]))
            path.append(index)
            document = document[index]
        elif path == ["method"] and isinstance(document, str):
            document = {"name": document}
            path.append(step)
            document = document.get(str(step))
        elif depth == 1 and document is None:
            path.append(step)
            document = {} if not last else None
        else:
            above = ".".join(str(s) for s in steps[:depth])
            raise NoSuchPath(f"'{above}' of the base problem holds nothing below it")
    return tuple(path)


def _index(items: list[Plain], step: str | int, above: str) -> int:
    if isinstance(step, str) and not step.isdigit():
        names = [item.get("name") if isinstance(item, dict) else item for item in items]
        if step in names:
            return names.index(step)
        known = [name for name in names if isinstance(name, str)]
        hint = suggest(step, known) if known else f"they are numbered from 0 to {len(items) - 1}"
        raise NoSuchPath(f"{above} of the base problem has nothing called '{step}'", hint)
    index = int(step)
    if index >= len(items):
        raise NoSuchPath(f"{above} of the base problem has {len(items)} entries, there is no [{index}]")
    return index


def with_values(document: PlainDict, values: Sequence[tuple[Path, Plain]]) -> PlainDict:
    """A copy of a document with other values at some paths.

    Parameters
    ----------
    document : plain data
    values : (path from `resolve`, value)
    """
    document = copy.deepcopy(document)
    for path, value in values:
        inside: Plain = document
        for depth, step in enumerate(path[:-1]):
            if isinstance(inside, dict):
                held = inside.get(step)
                if step == "method" and depth == 0 and isinstance(held, str):
                    held = {"name": held}
                if held is None:
                    held = {}
                inside[step] = held
            inside = inside[step]
        inside[path[-1]] = copy.deepcopy(value)
    return document


def moved(mistake: Mistake, varied: Sequence[tuple[Path, str]]) -> str | None:
    """The varied path, as the study writes it, below which a mistake in the problem lies; None where it lies elsewhere.

    Parameters
    ----------
    mistake : with a path into the problem document
    varied : (path in the document, as the study writes it)
    """
    for path, text in varied:
        if mistake.path[: len(path)] == path or path[: len(mistake.path)] == mistake.path != ():
            return text
    return None
