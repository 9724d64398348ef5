"""YAML -> plain data and places, read as a stream of events.

Tags, deep nesting and further documents are refused before anything is built from them, and nothing is ever constructed
but dicts, lists, words and numbers. What an alias brings in is copied and counted, see anchors.py. Scalars follow the
core schema of YAML 1.2: 1e-3 is a number, 'on' is a word; numbers of more than 15 digits become floats.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, TypeAlias

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.kinds import Plain
from occontrol.files.anchors import MERGE, Anchors, merge
from occontrol.files.number_blocks import DEEPEST, MARK, Block, Shortened, cut
from occontrol.files.positions import MAX_DEPTH, Inside, Place, Text, at, number

MOST_KEYS = 2000
Event: TypeAlias = Any  # of ruamel.yaml's parser; the kinds share nothing but their marks
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"([-+]?)\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_WORDS = {"": None, "~": None, "null": None, "Null": None, "NULL": None}
_WORDS |= {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}


def read_yaml(source: str, file: str) -> Text:
    """Parse YAML; ProblemError with the place of the first thing that is not allowed."""
    shortened = cut(source)
    if shortened.blocks:
        try:
            return _read(shortened, file)
        except ProblemError:
            pass  # what is wrong, and where, is said by the text as it stands
    return _read(Shortened(source), file)


def _read(shortened: Shortened, file: str) -> Text:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError
    from ruamel.yaml.reader import ReaderError

    try:
        return _Builder(file, shortened).run(YAML(typ="safe", pure=True).parse(shortened.text))
    except ProblemError:
        raise
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        hint = "indent with spaces, not with tabs" if "\\t" in str(error.problem) else ""
        raise at(file, line, column, f"this is not YAML: {error.problem or error.context}", hint) from None
    except ReaderError as error:
        before = shortened.text[: error.position]
        line, column = before.count("\n") + 1, error.position - before.rfind("\n")
        raise at(file, line, column, "a character that is not allowed in YAML (binary data?)") from None
    except Exception as error:  # the parser is not ours: whatever it trips over is a mistake in the file
        raise at(file, 1, 1, f"this is not YAML ({type(error).__name__})") from None


class _Builder:
    """Builds data and places from parser events, with an explicit stack."""

    def __init__(self, file: str, shortened: Shortened):
        self.file, self.shortened = file, shortened
        self.cut_out: list[tuple[Place, Block]] = []
        self.data: Plain = None
        self.places = Place(1, 1)
        self.mistakes: list[Mistake] = []
        # one frame for each open collection: (data, places, key waiting for its value and the key's place, own place)
        self.stack: list[list[Plain]] = []
        self.anchors = Anchors(self.fail)
        self.documents = 0

    def fail(self, event: Event, what: str, hint: str = "") -> ProblemError:
        return at(self.file, *self.position(event), what, hint)

    def position(self, event: Event) -> tuple[int, int]:
        line, column = event.start_mark.line, event.start_mark.column
        return line + 1, self.shortened.column(line, column) + 1

    def run(self, events: Iterable[Event]) -> Text:
        from ruamel.yaml import events as kinds

        for event in events:
            if isinstance(event, kinds.AliasEvent):
                value, place = self.anchors.copy(event, len(self.stack))
                self.add(event, value, place.inside)
            elif isinstance(event, kinds.DocumentStartEvent):
                self.documents += 1
                if self.documents > 1:
                    raise self.fail(event, "a second document begins here", "one problem per file: remove '---'")
            elif isinstance(event, kinds.ScalarEvent | kinds.CollectionStartEvent):
                if event.tag is not None:
                    raise self.fail(event, f"the tag '{_short(event.tag)}' is not allowed", "remove the tag")
                if isinstance(event, kinds.ScalarEvent):
                    self.scalar(event)
                else:
                    if len(self.stack) >= MAX_DEPTH:
                        raise self.fail(event, f"nested deeper than {MAX_DEPTH} levels")
                    mapping = isinstance(event, kinds.MappingStartEvent)
                    self.stack.append(self.add(event, {} if mapping else [], {} if mapping else []))
                    self.stack[-1].append(self.anchors.begin(event))
            elif isinstance(event, kinds.CollectionEndEvent):
                value, inside, _, place, anchor = self.stack.pop()
                if isinstance(value, dict) and MERGE in value:
                    self.mistakes += merge(self.file, value, inside)
                self.anchors.keep(anchor, value, place)
        return Text(self.file, self.data, self.all_places, self.mistakes)

    def all_places(self) -> Place:
        for place, block in self.cut_out:
            place.inside = block.places(place.line, place.column)
        return self.places

    def scalar(self, event: Event) -> None:
        top = self.stack[-1] if self.stack else None
        if self.shortened.blocks and MARK in event.value:
            self.block(event, top)
            return
        if top is not None and isinstance(top[0], dict) and top[2] is None:
            if event.anchor is not None:
                raise self.fail(event, f"the anchor '&{event.anchor}' stands before a key", "put it before the value")
            top[2] = (event.value, self.position(event))
            if len(top[0]) >= MOST_KEYS:
                raise self.fail(event, f"more than {MOST_KEYS} keys in one mapping")
            if event.value in top[0]:
                first = top[1][event.value].key[0]
                what, place = f"the key '{event.value}' stands twice", f"{self.file}:{top[2][1][0]}:{top[2][1][1]}"
                self.mistakes.append(Mistake((), what, f"it stands already in line {first}", place=place))
            return
        anchor = self.anchors.begin(event)
        value = _value(event.value) if event.implicit[0] else event.value
        self.anchors.keep(anchor, value, self.add(event, value, None)[3])

    def block(self, event: Event, top: list[Plain] | None) -> None:
        """A mark that stands for a list of numbers, unless it lies in a key or in other words."""
        name = event.value.removeprefix(MARK)
        in_key = top is not None and isinstance(top[0], dict) and top[2] is None
        in_key |= event.anchor is not None  # the slow way knows what to do with it
        if in_key or not event.implicit[0] or not name.isdecimal() or len(self.stack) + DEEPEST > MAX_DEPTH:
            raise self.fail(event, "a list of numbers where none can be")
        block = self.shortened.blocks[int(name)]
        place = self.add(event, block.value, None)[3]
        self.cut_out.append((place, block))

    def add(self, event: Event, value: Plain, inside: Inside) -> list[Plain]:
        place = Place(*self.position(event), None, inside)
        if not self.stack:
            self.data, self.places = value, place
        else:
            top = self.stack[-1]
            if isinstance(top[0], list):
                top[0].append(value)
                top[1].append(place)
            elif top[2] is None:
                raise self.fail(event, "a key must be a word, not a list or a mapping")
            else:
                (name, place.key), top[2] = top[2], None
                top[0].setdefault(name, value)
                top[1].setdefault(name, place)
        return [value, inside, None, place]


def _short(tag: object) -> str:
    return str(tag).replace("tag:yaml.org,2002:", "!!", 1)


def _value(text: str) -> Plain:
    """A plain scalar by the core schema of YAML 1.2."""
    if text in _WORDS:
        return _WORDS[text]
    if _NUMBER.fullmatch(text):
        return number(text)
    if found := _NOT_FINITE.fullmatch(text):
        return float("nan") if found[3] else float(found[1] + "inf")
    if re.fullmatch(r"0o[0-7]{1,17}|0x[0-9a-fA-F]{1,13}", text):
        return int(text, 0)
    return text
