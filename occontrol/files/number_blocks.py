"""Long lists of numbers in a YAML text, read at once instead of event by event: a hundred times as fast.

Each list [[1, 2], [3, 4]] of nothing but numbers is cut out and a mark is left in its place; line breaks stay, and
`Shortened.column` says which column of the whole text one of the shortened text was. Whatever is not surely such a
list stays as it is, and a mark that turns up anywhere but as a value of its own says: read the text the slow way.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field

from occontrol.files.positions import Place, number

MARK = "\ue000"
WORTHWHILE = 20_000  # characters of a text
SHORTEST = 24  # characters of a list
DEEPEST = 8

_RUN = re.compile(r"[-+0-9.eE, \r\n\[\]]+")
_BRACKET = re.compile(r"[\[\]]")
_ITEM = re.compile(r"[\[\]]|[^ \r\n\[\],]+")
_OTHER = re.compile(f"[{MARK}\x85\u2028\u2029]")  # other ends of lines
_LINE = re.compile(r"\r\n|\r|\n")
_BARE = ((re.compile(r"(?<![0-9])\.(?=[0-9])"), "0."), (re.compile(r"(?<=[0-9])\.(?![0-9])"), ".0"))


@dataclass(frozen=True)
class Block:
    """A list of numbers that was cut out: its text, and what it holds."""

    text: str
    value: list

    def places(self, line: int, column: int) -> list[Place]:
        """The places of its items; line and column (from 1) are those of its first bracket."""
        breaks = [(0, -column + 1)] + [(m.start(), m.end()) for m in _LINE.finditer(self.text)]
        found: list[Place] = []
        open_: list[list[Place]] = []
        at = 0
        for item in _ITEM.finditer(self.text):
            while at + 1 < len(breaks) and breaks[at + 1][0] < item.start():
                at += 1
            if item[0] == "]":
                open_.pop()
                continue
            place = Place(line + at, item.start() - breaks[at][1] + 1, None, [] if item[0] == "[" else None)
            if open_:
                open_[-1].append(place)
            if item[0] == "[":
                inside: list[Place] = place.inside
                if not open_:
                    found = inside
                open_.append(inside)
        return found


@dataclass
class Shortened:
    """A YAML text whose lists of numbers were cut out; mark number k stands for block k.

    Parameters
    ----------
    text : what is left
    blocks : what was cut out
    shifts : line (from 0) -> [(column in `text` from which on, how many characters are missing before it), ..]
    """

    text: str
    blocks: list[Block] = field(default_factory=list)
    shifts: dict[int, list[tuple[int, int]]] = field(default_factory=dict)

    def column(self, line: int, column: int) -> int:
        """The column in the whole text, all from 0."""
        missing = [lost for since, lost in self.shifts.get(line, ()) if column >= since]
        return column + (missing[-1] if missing else 0)


def cut(source: str) -> Shortened:
    """The text without its longest lists of numbers; as it is when there is no worthwhile one.

    Parameters
    ----------
    source : a YAML text
    """
    if len(source) < WORTHWHILE or _OTHER.search(source):
        return Shortened(source)
    result = Shortened(source)
    pieces: list[str] = []
    position = kept = line = run = 0  # of the whole text
    began = begun = 0  # where the present line begins, in the whole text and in the shortened one
    length = 0  # of the shortened text so far
    while (start := source.find("[", position)) >= 0:
        position = start + 1
        if start >= run:  # a run of such characters is looked for once, however many lists it holds
            run = _RUN.match(source, start).end()  # type: ignore[union-attr]
        end = _closed(source, start, run)
        if end - start < SHORTEST or (value := _numbers(source[start:end])) is None:
            continue
        before, text = source[kept:start], source[start:end]
        for last in _LINE.finditer(before):
            line, began, begun = line + 1, kept + last.end(), length + last.end()
        breaks = list(_LINE.finditer(text))
        # a blank keeps what follows apart
        mark = "".join([f"{MARK}{len(result.blocks)}", *(m[0] for m in breaks), " "])
        length += len(before) + len(mark)
        if breaks:
            line, began, begun = line + len(breaks), start + breaks[-1].end(), length - 1
        result.shifts.setdefault(line, []).append((length - begun, (end - began) - (length - begun)))
        result.blocks.append(Block(text, value))
        pieces += [before, mark]
        position = kept = end
    result.text = "".join([*pieces, source[kept:]])
    return result


def _closed(source: str, start: int, end: int) -> int:
    """Where the bracket at `start` is closed, if before `end` and without nesting too deeply; else 0."""
    depth = 0
    for bracket in _BRACKET.finditer(source, start, end):
        depth += 1 if bracket[0] == "[" else -1
        if depth == 0:
            return bracket.end()
        if depth > DEEPEST:
            break
    return 0


def _numbers(text: str) -> list | None:
    """The nested lists of a text, or None where something in it is not a plain number."""
    if not any(c.isdigit() for c in text):
        return None
    for form in (lambda: text, lambda: _spelt(text)):
        try:
            return json.loads(form(), parse_int=number)
        except (ValueError, RecursionError):
            continue
    return None


def _spelt(text: str) -> str:
    """.5 and 1. as JSON writes them."""
    for pattern, full in _BARE:
        text = pattern.sub(full, text)
    return text
