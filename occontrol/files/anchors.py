"""Anchors and aliases of YAML within limits: an alias brings in a copy, and what all copies hold is counted.

    - &radar {name: a, C: [[1, 0]], noise: [[0.1]]}
    - {<<: *radar, name: b}                            # the same but for its name
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import TypeAlias

from occontrol.core.errors import Mistake, ProblemError, suggest
from occontrol.core.kinds import Plain
from occontrol.files.positions import MAX_DEPTH, Inside, Place

MOST_COPIED = 100_000  # keys, words, numbers, lists and mappings that aliases may bring in
MERGE = "<<"
Event: TypeAlias = Plain  # of ruamel.yaml's parser


class Anchors:
    """The anchored values of one document so far.

    Parameters
    ----------
    fail : (event, what, hint) -> the error at the place of an event
    """

    def __init__(self, fail: Callable[[Event, str, str], ProblemError]):
        self.fail = fail
        self.known: dict[str, tuple[Plain, Place, int, int]] = {}
        self.open: list[str] = []
        self.copied = 0

    def begin(self, event: Event) -> str | None:
        """The anchor of an event, if it has one; its value is not complete yet.

        Parameters
        ----------
        event : scalar, or start of a collection

        Raises ProblemError for an anchor that stands twice.
        """
        if event.anchor is None:
            return None
        if event.anchor in self.known or event.anchor in self.open:
            raise self.fail(event, f"the anchor '&{event.anchor}' stands twice", "give each its own name")
        self.open.append(event.anchor)
        return event.anchor

    def keep(self, anchor: str | None, value: Plain, place: Place) -> None:
        """Remember a complete value.

        Parameters
        ----------
        anchor : its anchor; None is none
        value : what it holds
        place : where it stands
        """
        if anchor is not None:
            self.open.remove(anchor)
            self.known[anchor] = (value, place, *_measure(value))

    def copy(self, event: Event, depth: int) -> tuple[Plain, Place]:
        """A copy of what an alias stands for, and the place of the original.

        Parameters
        ----------
        event : the alias
        depth : of the collections around it

        Raises ProblemError for an unknown anchor, one that holds the alias, and where copies become too many or deep.
        """
        name = event.anchor
        if name in self.open:
            raise self.fail(event, f"the alias '*{name}' stands inside of what it refers to", "write the value out")
        if name not in self.known:
            hint = suggest(name, self.known, "anchors") if self.known else "an anchor is &NAME before a value"
            raise self.fail(event, f"there is no anchor '&{name}' before the alias '*{name}'", hint)
        value, place, size, height = self.known[name]
        self.copied += size
        if self.copied > MOST_COPIED:
            raise self.fail(event, f"aliases bring in more than {MOST_COPIED} values", "use a table file")
        if depth + height > MAX_DEPTH:
            raise self.fail(event, f"nested deeper than {MAX_DEPTH} levels", "")
        return copy.deepcopy(value), place


def _measure(value: Plain) -> tuple[int, int]:
    """How many values there are in all, and how deep they are nested."""
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else None
    if items is None:
        return 1, 0
    inner = [_measure(item) for item in items]
    return 1 + sum(size for size, _ in inner), 1 + max((height for _, height in inner), default=0)


def merge(file: str, value: dict, places: Inside) -> list[Mistake]:
    """Put the keys of what stands under '<<' into a mapping; its own keys stay. What is wrong with it is returned.

    Parameters
    ----------
    file : what to call it in a message
    value : the mapping, changed
    places : of its keys, changed
    """
    assert isinstance(places, dict)
    given, place = value.pop(MERGE), places.pop(MERGE)
    sources = given if isinstance(given, list) else [given]
    if not all(isinstance(source, dict) for source in sources):
        where = f"{file}:{place.line}:{place.column}"
        return [Mistake((), "'<<' takes a mapping, or a list of mappings", "<<: *NAME", place=where)]
    of_sources = place.inside if isinstance(given, list) else [place]
    for source, source_place in zip(sources, of_sources or [], strict=True):
        for key, item in source.items():
            if key not in value:
                value[key] = item
                places[key] = source_place.inside[key]
    return []
