"""What the schemas of all families share: the strict base model, matrices, method options, and the way back."""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError, WithJsonSchema

from occontrol.core.calendar import Calendar, calendar_of
from occontrol.core.errors import Collector, Path
from occontrol.core.kinds import Plain, PlainDict
from occontrol.core.signal import Signal
from occontrol.core.state_labels import default_names
from occontrol.core.versions import SCHEMA_VERSION
from occontrol.files.plain_json import plain as plain  # for the schemas of the families
from occontrol.files.schema.constants import Constants as ConstantValues
from occontrol.files.schema.matrices import MatrixReader
from occontrol.files.schema.matrix_forms import ENTRY, MATRIX_SCHEMA
from occontrol.files.schema.tables import TableFiles
from occontrol.files.schema.words import shown, spell, suggest, translate, value_at


class Strict(BaseModel):
    """Unknown keys, infinities and silent conversions are mistakes."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


def _whole(value: object) -> object:
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 1e15 else value


Whole = Annotated[int, BeforeValidator(_whole), WithJsonSchema({"type": "integer"})]
"""A whole number; 4e2 and 400.0 are 400."""

Matrix = Annotated[Any, WithJsonSchema(MATRIX_SCHEMA)]
"""A matrix in any of its forms; `Context.signal` or `Context.constant` reads it."""

Vector = Annotated[Any, WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}}]})]
"""A list of numbers; `Context.vector` reads it."""

Entries = Annotated[Any, WithJsonSchema({"anyOf": [ENTRY, {"type": "array", "items": ENTRY}]})]
"""A list of numbers and formulas; `Context.entries` reads it."""

Method = Annotated[
    Any,
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string"},
                {"type": "object", "properties": {"name": {"type": "string"}}, "required": ["name"]},
            ]
        }
    ),
]
"""A method's name, or {name: .., its options}; `Context.method` reads it."""

Constants = Annotated[
    Plain,
    Field(description="constants: {q: 0.3, drag: 2*q}, numbers for every formula"),
    WithJsonSchema({"type": "object", "additionalProperties": {"type": ["number", "string"]}}),
]
"""Numbers with names; `Context` works them out and puts them into every formula."""

Labels = Annotated[list[str] | None, Field(description="a list of words, one per state")]
"""Names, or units, of the states."""

Expect = Annotated[Any, WithJsonSchema({"type": "object"})]
"""The known answer and its source; `Context.expect` reads it."""


class ProblemDocument(Strict):
    """What the problem files of all families begin with."""

    family: str
    schema_version: Whole = Field(SCHEMA_VERSION, ge=1, le=SCHEMA_VERSION, description="edition of the keys")
    name: str | None = None
    constants: Constants = None


class DatedHorizon(Strict):
    """A horizon whose times may be dates."""

    date: str | None = Field(None, description="date: what t = 0 is, such as 2026-01-01T00:00:00Z")
    unit: Literal["s", "min", "h", "d"] | None = Field(None, description="unit: what t counts: s, min, h or d")


def dates_document(problem: object) -> PlainDict:
    """The keys of `horizon` that say what times are as dates; none where they are numbers alone.

    Parameters
    ----------
    problem : of any family
    """
    calendar = calendar_of(problem)
    return {} if calendar is None else calendar.document()


class Context:
    """Reads the parts of a document and gathers the mistakes.

    Every reader takes the value and its path in the document, and returns None after it has noted a mistake, so that
    a `build` reads everything first and calls `found.raise_if_any()` before it relies on any of it.

    Parameters
    ----------
    data : the plain document, for the user's own names
    folder : where table files may lie; None is nowhere
    stem : the problem's name when the document has none
    calendar : what its times are as dates, if it says so
    """

    def __init__(
        self, data: object, folder: FilePath | None = None, stem: str = "problem", calendar: Calendar | None = None
    ):
        self.data, self.stem, self.found, self.calendar = data, stem, Collector(), calendar
        self.tables = TableFiles(folder, self.found)
        names = states_in(data)
        constants = ConstantValues(value_at(data, ("constants",)), self.found, names)
        self.reader = MatrixReader(self.found, self.tables.load, self.name, constants, names)

    def name(self, path: Path) -> str:
        """What the user calls the thing at a path: "C of sensor 'radar'"."""
        words = spell(path, self.data)
        if path[:2] == ("plant", "noise"):
            return "noise" + words.removeprefix("plant.noise") + " of the plant"
        for prefix in ("plant.initial.", "plant."):
            words = words.removeprefix(prefix)
        return words

    def signal(self, value: object, *path: str | int, variable: str = "t") -> Signal | None:
        """A matrix that may depend on `variable` (see core.signal); `rows` for formulas of several variables."""
        return self.reader.signal(value, path, (variable,))

    def rows(self, value: object, *path: str | int, variables: tuple[str, ...]) -> list[list[float | str]] | None:
        """Rows of numbers and formulas of any of `variables`."""
        return self.reader.rows(value, path, variables)

    def constant(self, value: object, *path: str | int) -> np.ndarray | None:
        """A constant matrix (rows, columns)."""
        return self.reader.constant(value, path)

    def vector(self, value: object, *path: str | int) -> np.ndarray | None:
        """A list of numbers."""
        return self.reader.vector(value, path)

    def entries(self, value: object, *path: str | int, variables: tuple[str, ...] = ("t",)) -> list[float | str] | None:
        """A list of numbers and formulas."""
        return self.reader.entries(value, path, variables)

    def attempt(self, build: Callable[..., Any], *prefix: str | int, **arguments: object) -> Any:
        """build(**arguments), or None after its ProblemError was noted under `prefix`."""
        with self.found.under(*prefix):
            return build(**arguments)
        return None

    def title(self, name: str | None) -> str:
        """The problem's name; the file's when it has none."""
        if name is None:
            return self.stem
        if not name.strip() or len(name) > 200 or not name.isprintable():
            self.found.add(("name",), f"name is {shown(name)}", "1 to 200 printable characters")
        return name

    def method(self, value: object, methods: typing.Mapping[str, type]) -> Method | None:
        """An options object of the `methods` table from `name` or {name: .., option: ..}; None if nothing is given.

        What the method itself refuses when it is made is noted at its option.
        """
        if value is None:
            return None
        if isinstance(value, str):
            value, place = {"name": value}, ("method",)
        else:
            place = ("method", "name")
        if not isinstance(value, dict):
            self.found.add(
                ("method",), f"method is {shown(value)}, it must be a name or a mapping", "method: {name: ..}"
            )
            return None
        name = value.get("name")
        if not isinstance(name, str):
            self.found.add(
                place, "method has no 'name'" if name is None else f"method.name is {shown(name)}", _known(methods)
            )
            return None
        if name not in methods:
            self.found.add(place, f"unknown method '{name}'", suggest(name, methods))
            return None
        options = {f.name: f for f in dataclasses.fields(methods[name]) if f.init and f.name != "name"}
        hints = typing.get_type_hints(methods[name])
        given, before = {}, len(self.found.mistakes)
        for key, item in value.items():
            if key == "name":
                continue
            if key not in options:
                hint = suggest(str(key), options) if options else f"{name} has no options"
                self.found.add(("method", key), f"unknown option '{key}' of method '{name}'", hint, key=True)
                continue
            try:
                kind = TypeAdapter(hints[key], config=ConfigDict(strict=True, allow_inf_nan=False))
                given[key] = kind.validate_python(_whole(item) if hints[key] in (int, int | None) else item)
            except ValidationError as error:
                e = error.errors(include_url=False)[0]
                if e["type"] == "tuple_type" and isinstance(item, list):
                    given[key] = tuple(item)
                    continue
                m = translate(error, Strict, item)[0]
                self.found.add(("method", key), f"method.{key}{m.what.removeprefix('the document')}", m.hint)
        wrong = {m.path[1] for m in self.found.mistakes[before:] if len(m.path) > 1}
        try:
            method = self.attempt(methods[name], "method", **{k: v for k, v in given.items() if k not in wrong})
        except (TypeError, ValueError) as error:
            self.found.add(("method",), f"method: {error}")
            return None
        return method if len(self.found.mistakes) == before else None

    def expect(self, value: object) -> PlainDict | None:
        """The known answer: words, finite numbers, and lists of them."""
        if value is None:
            return None
        if not isinstance(value, dict):
            self.found.add(
                ("expect",), f"expect is {shown(value)}, it must be a mapping", "{source: .., cost: .., tolerance: ..}"
            )
            return None
        for key, item in value.items():
            items = item if isinstance(item, list) else [item]
            if any(isinstance(e, float) and not math.isfinite(e) for e in items):
                self.found.add(("expect", key), f"expect.{key} is not finite")
            if key in ("cost", "tolerance") and (isinstance(item, bool) or not isinstance(item, int | float)):
                self.found.add(("expect", key), f"expect.{key} is {shown(item)}, it must be a number")
        return value


def states_in(data: object) -> tuple[str, ...]:
    """The names that a document gives its states; none where they are no list of words.

    Parameters
    ----------
    data : the plain document
    """
    given = value_at(data, ("plant", "states"))
    words = isinstance(given, list) and all(isinstance(name, str) for name in given)
    formulas = value_at(data, ("plant", "f")) or value_at(data, ("plant", "next"))  # of a nonlinear plant
    if not isinstance(formulas, list):
        return tuple(given) if words else ()
    parameters = value_at(data, ("plant", "parameters"))  # states that do not move
    named = tuple(given) if words else tuple(default_names(len(formulas)))
    return (*named, *parameters) if isinstance(parameters, dict) else named


def _known(methods: typing.Mapping[str, type]) -> str:
    return "known: " + ", ".join(methods)


def options_document(method: Any) -> PlainDict | None:
    """{name: .., options} of a method object; None for None."""
    if method is None:
        return None
    options = {f.name: getattr(method, f.name) for f in dataclasses.fields(method) if f.init and f.name != "name"}
    plain = {k: list(v) if isinstance(v, tuple) else v for k, v in options.items() if v is not None}
    return {"name": method.name, **plain}


def prune(document: PlainDict) -> PlainDict:
    """Without the keys whose value is None."""
    return {key: value for key, value in document.items() if value is not None}
