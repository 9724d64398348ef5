"""JSON -> plain data by the standard library; places are worked out only when there is a mistake."""

from __future__ import annotations

import json
import re

from occontrol.core.errors import Mistake
from occontrol.core.kinds import Plain
from occontrol.files.positions import MAX_DEPTH, Place, Text, at, number

LOOKED_AT = 8 * 2**20  # characters; in a larger file every mistake is said to be at its beginning


def read_json(source: str, file: str) -> Text:
    """Parse JSON fast; duplicate keys, depth and syntax are mistakes, each a ProblemError with its place."""
    text = Text(file, None, lambda: _places(source, file)[0])
    repeated = False

    def pairs(items: list[tuple[str, Plain]]) -> dict:
        nonlocal repeated
        result = dict(items)
        repeated |= len(result) < len(items)
        return result

    try:
        text.data = json.loads(source, object_pairs_hook=pairs, parse_int=number)
    except json.JSONDecodeError as error:
        raise at(file, error.lineno, error.colno, f"this is not JSON: {error.msg[0].lower()}{error.msg[1:]}") from None
    except RecursionError:
        raise at(file, 1, 1, f"nested deeper than {MAX_DEPTH} levels") from None
    level = [text.data]
    for depth in range(MAX_DEPTH + 2):
        if depth > MAX_DEPTH:
            raise at(file, 1, 1, f"nested deeper than {MAX_DEPTH} levels")
        children = [c for c in level if isinstance(c, dict | list) and c]
        if not children:
            break
        level = [v for c in children for v in (c.values() if isinstance(c, dict) else _branches(c))]
    if repeated:
        text.mistakes = _places(source, file)[1]
    return text


def _branches(items: list) -> list:
    """The collections in a list; a list of numbers, the bulk of every table, is passed over quickly."""
    return [v for v in items if isinstance(v, dict | list)] if not isinstance(items[0], float) else []


_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}:,]|[^\s\[\]{}:,"]+')


def _places(source: str, file: str) -> tuple[Place, list[Mistake]]:
    """Places in a text that is known to be JSON, and the keys that stand twice."""
    if len(source) > LOOKED_AT:
        what = "a key stands twice somewhere in the file"
        return Place(1, 1), [Mistake((), what, "the file is too large to say where", place=f"{file}:1:1")]
    starts = [0] + [m.end() for m in re.finditer("\n", source)]
    line = 0
    root: Place | None = None
    stack: list[tuple[Place, list]] = []  # (collection, [name of the key waiting for its value, its place])
    repeats: list[Mistake] = []
    for token in _TOKEN.finditer(source):
        while line + 1 < len(starts) and starts[line + 1] <= token.start():
            line += 1
        here, text = (line + 1, token.start() - starts[line] + 1), token[0]
        if text in ",:":
            continue
        if text in "]}":
            stack.pop()
            continue
        if stack and isinstance(stack[-1][0].inside, dict) and not stack[-1][1]:
            name = json.loads(text, strict=False)
            if name in stack[-1][0].inside:
                first = stack[-1][0].inside[name].key[0]
                hint = f"it stands already in line {first}"
                repeats.append(Mistake((), f"the key '{name}' stands twice", hint, place=f"{file}:{here[0]}:{here[1]}"))
            stack[-1][1][:] = [name, here]
            continue
        place = Place(*here, None, {} if text == "{" else [] if text == "[" else None)
        if not stack:
            root = place
        elif isinstance(stack[-1][0].inside, list):
            stack[-1][0].inside.append(place)
        else:
            name, place.key = stack[-1][1]
            stack[-1][0].inside[name] = place
            stack[-1][1].clear()
        if place.inside is not None:
            stack.append((place, []))
    return root or Place(1, 1), repeats
