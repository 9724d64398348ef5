"""The house's words for what is wrong with a document: pydantic's errors -> mistakes with a path, a name and a hint."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, get_args

from pydantic import BaseModel, ValidationError

from occontrol.core.errors import Mistake, Path
from occontrol.core.errors import suggest as closest
from occontrol.core.kinds import Plain

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

_WANTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping (key: value)",
    "model_type": "a mapping (key: value)",
    "model_attributes_type": "a mapping (key: value)",
    "dataclass_type": "a mapping (key: value)",
}
_COLLECTIONS = {kind for kind, wanted in _WANTED.items() if wanted.startswith("a list") or "mapping" in wanted}
_LIMITS = {
    "greater_than": (">", "gt"),
    "greater_than_equal": (">=", "ge"),
    "less_than": ("<", "lt"),
    "less_than_equal": ("<=", "le"),
}


def shown(value: object) -> str:
    """A value as the user may recognise it: true, the number 3, the text 'abc', a list, a mapping, nothing."""
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return (
            f"{value:g}"
            if math.isfinite(value)
            else {"inf": "infinite", "-inf": "infinite"}.get(str(value), "not a number")
        )
    if isinstance(value, str):
        return f"the text '{value if len(value) <= 40 else value[:37] + '...'}'"
    return "a list" if isinstance(value, list | tuple) else "a mapping" if isinstance(value, dict) else str(value)


def suggest(word: str, known: Iterable[str]) -> str:
    """'did you mean ..?' for the closest known key, or the list of all, as every schema says it."""
    return closest(word, known, "known")


def spell(path: Sequence[str | int], data: object = None) -> str:
    """A path in words: "horizon.end", "C of sensor 'radar'", "windows[1] of sensor 'radar'"."""
    if len(path) >= 2 and isinstance(path[0], str) and isinstance(path[1], int):
        items = data.get(path[0]) if isinstance(data, dict) else None
        item = items[path[1]] if isinstance(items, list) and path[1] < len(items) else None
        name = item.get("name") if isinstance(item, dict) else None
        kind = path[0].removesuffix("s")
        label = f"{kind} '{name}'" if isinstance(name, str) and len(name) < 60 else f"{kind} {path[1] + 1}"
        return f"{_dotted(path[2:])} of {label}" if len(path) > 2 else label
    return _dotted(path)


def _dotted(path: Sequence[str | int]) -> str:
    text = ""
    for step in path:
        text += f"[{step + 1}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def real_path(location: Sequence[str | int], data: object) -> Path:
    """A pydantic location without the tags that unions put into it."""
    path: list[str | int] = []
    for depth, step in enumerate(location):
        if isinstance(data, dict):
            if step not in data and depth < len(location) - 1:
                continue
            path.append(step)
            data = data.get(step)
        elif isinstance(data, list):
            if isinstance(step, int) and step < len(data):
                path.append(step)
                data = data[step]
        elif depth == len(location) - 1 and isinstance(step, int):
            path.append(step)
    return tuple(path)


def value_at(data: Plain, path: Sequence[str | int]) -> Plain:
    """What stands at a path; None if nothing does."""
    for step in path:
        try:
            data = data[step]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def model_at(model: object, path: Sequence[str | int]) -> type[BaseModel] | None:
    """The pydantic model that describes the value at a path."""
    for step in path:
        if isinstance(step, int):
            continue
        found = _model_in(model)
        if found is None or step not in found.model_fields:
            return None
        model = found.model_fields[str(step)].annotation
    return _model_in(model)


def _model_in(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in get_args(annotation):
        found = _model_in(argument)
        if found:
            return found
    return None


MOST_UNKNOWN_KEYS = 20  # unknown keys of one mapping that are listed


def translate(error: ValidationError, model: type[BaseModel], data: object) -> list[Mistake]:
    """Every validation error as a mistake in the house's words; one for each place, of unknown keys the first few."""
    found: dict[Path, Mistake] = {}
    unknown: dict[Path, int] = {}  # how many, by the mapping that they stand in
    further: dict[Path, Path] = {}  # the first one that is only counted
    for e in error.errors(include_url=False):
        path = real_path(e["loc"], data)
        kind, name, context = e["type"], spell(path, data), e.get("ctx", {})
        if kind == "missing":
            owner = spell(path[:-1], data) or "the problem"
            known = model_at(model, path[:-1])
            field = known.model_fields.get(str(path[-1])) if known else None
            hint = (field.description if field else None) or ""
            found.setdefault(path, Mistake(path[:-1], f"{owner} has no '{path[-1]}'", hint, key=True))
            continue
        if kind == "extra_forbidden":
            known = model_at(model, path[:-1])
            where = f" in {spell(path[:-1], data)}" if path[:-1] else ""
            unknown[path[:-1]] = unknown.get(path[:-1], 0) + 1
            if unknown[path[:-1]] > MOST_UNKNOWN_KEYS:
                further.setdefault(path[:-1], path)
                continue
            hint = suggest(str(path[-1]), known.model_fields) if known else ""
            mistake = Mistake(path, f"unknown key '{path[-1]}'{where}", hint, key=True)
        else:
            hint = _hint(kind, e) or (_description(model, path) if kind in _COLLECTIONS else "")
            mistake = Mistake(path, f"{name or 'the document'} {_predicate(kind, context, e)}", hint)
        found.setdefault(path, mistake)
    for inside, path in further.items():
        rest = unknown[inside] - MOST_UNKNOWN_KEYS
        found[path] = Mistake(path, f"and {rest} more unknown key{'s' * (rest > 1)}", key=True)
    return list(found.values())


def _description(model: type[BaseModel], path: Path) -> str:
    """How the nearest key above a path is to be written, if its field says so."""
    for end in range(len(path), 0, -1):
        if isinstance(path[end - 1], str):
            owner = model_at(model, path[: end - 1])
            field = owner.model_fields.get(str(path[end - 1])) if owner else None
            return (field.description if field else None) or ""
    return ""


def _predicate(kind: str, context: dict, error: ErrorDetails) -> str:
    value = error["input"]
    if kind in _WANTED:
        return f"is {shown(value)}, it must be {_WANTED[kind]}"
    if kind in _LIMITS:
        sign, limit = _LIMITS[kind]
        return f"is {shown(value)}, it must be {sign} {context[limit]:g}"
    if kind == "literal_error":
        return f"is {shown(value)}, it must be {context['expected']}"
    if kind == "too_short":
        return f"has {context['actual_length']} entries, it needs at least {context['min_length']}"
    if kind == "too_long":
        return f"has {context['actual_length']} entries, it may have at most {context['max_length']}"
    if kind in ("value_error", "assertion_error"):
        return str(context.get("error", error["msg"]))
    return f"is not valid: {error['msg'][:1].lower()}{error['msg'][1:]}"


def _hint(kind: str, error: ErrorDetails) -> str:
    value = error["input"]
    if isinstance(value, str) and kind in ("float_type", "int_type"):
        try:
            float(value)
            return "write the number without quotes"
        except ValueError:
            return "a formula is not allowed here" if any(c in value for c in "+-*/()") else ""
    if kind == "string_type" and isinstance(value, int | float):
        return "put it into quotes"
    return ""
