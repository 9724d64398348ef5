"""The JSON Schema of a family's problem files, for editors; scripts/write_schemas.py writes those shipped."""

from __future__ import annotations

import dataclasses
import functools
import json
import operator
import typing
from collections.abc import Mapping, Sequence

from pydantic import BaseModel, TypeAdapter

from occontrol.core.kinds import PlainDict, PlainMapping


def json_schema(title: str, documents: Sequence[type[BaseModel]], methods: Mapping[str, type]) -> PlainDict:
    """The JSON Schema of problem files, with the names and options of the methods that they may name.

    Parameters
    ----------
    title : of the schema
    documents : pydantic models; a file is one of them
    methods : {name: dataclass of options}
    """
    schema = TypeAdapter(functools.reduce(operator.or_, documents)).json_schema()
    forms = [_method(name, options) for name, options in methods.items()]
    for form in [schema, *schema.get("$defs", {}).values()]:
        if methods and "method" in form.get("properties", {}):
            form["properties"]["method"] = {"anyOf": [{"enum": list(methods)}, *forms]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": title}


def _method(name: str, options: type) -> PlainDict:
    hints = typing.get_type_hints(options)
    fields = [f.name for f in dataclasses.fields(options) if f.init and f.name != "name"]
    properties = {"name": {"const": name}, **{field: TypeAdapter(hints[field]).json_schema() for field in fields}}
    return {"type": "object", "properties": properties, "required": ["name"], "additionalProperties": False}


def text(schema: PlainMapping) -> str:
    """The content of a shipped schema.json.

    Parameters
    ----------
    schema : from `json_schema`
    """
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
