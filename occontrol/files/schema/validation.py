"""A document against the pydantic model of its family: every mistake at once, with stand-ins for what is absent."""

from __future__ import annotations

import copy
import typing
from typing import Any, get_origin

from pydantic import BaseModel, ValidationError

from occontrol.core.errors import Collector, Path, ProblemError
from occontrol.files.schema.words import model_at, real_path, spell, translate, value_at

Model = typing.TypeVar("Model", bound=BaseModel)


def validate(model: type[Model], data: object, found: Collector, lacking: set[Path]) -> Model:
    """The document as a `model`; all mistakes are reported together.

    What is wrong but could be left out (unknown keys, optional values) is noted in `found` and left out; what is absent
    is noted, gets a stand-in and goes to `lacking`: whatever is said about a stand-in later means nothing. So the rest
    is still checked. Where nothing can stand in, raises ProblemError.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        found.mistakes += translate(error, model, data)
        errors = error.errors(include_url=False)
    data = copy.deepcopy(data)
    for _ in range(5):  # a stand-in may itself lack something
        absent = [real_path(e["loc"], data) for e in errors if e["type"] == "missing"]
        wrong = [real_path(e["loc"], data) for e in errors if e["type"] != "missing"]
        stand_ins = {path for path in absent if _stand_in(model, data, path)}
        lacking |= stand_ins
        data = _without(data, [p for p in wrong if p] + [p[:-1] for p in absent if p not in stand_ins and p[:-1]])
        try:
            return model.model_validate(data)
        except ValidationError as error:
            errors = error.errors(include_url=False)
    raise ProblemError(found.mistakes) from None


def _stand_in(model: type[BaseModel], data: object, path: Path) -> bool:
    """Put something harmless where a value is missing; False when nothing is."""
    owner, inside = model_at(model, path[:-1]), value_at(data, path[:-1])
    field = owner.model_fields.get(str(path[-1])) if owner else None
    if field is None or not isinstance(inside, dict):
        return False
    if model_at(model, path) is not None and get_origin(field.annotation) is not list:
        inside[path[-1]] = {}
    elif field.annotation is str:
        inside[path[-1]] = spell(path[:-1])
    elif field.annotation is Any:
        inside[path[-1]] = None
    else:
        return False
    return True


def _without(data: object, paths: list[Path]) -> object:
    """A copy in which the nearest key above each path is left out."""
    if not isinstance(data, dict):
        return data
    result = {}
    beneath: dict[str | int, list[Path]] = {}
    for p in paths:
        if p:
            beneath.setdefault(p[0], []).append(p[1:])
    for key, value in data.items():
        below = beneath.get(key, [])
        if any(not any(isinstance(step, str) for step in p) for p in below):
            continue
        if isinstance(value, list):
            result[key] = (
                [_without(v, [p[1:] for p in below if p[0] == k]) for k, v in enumerate(value)] if below else value
            )
        else:
            result[key] = _without(value, below) if below else value
    return result
