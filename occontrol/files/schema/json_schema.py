"""The JSON Schema of a family's problem files, for editors; `python -m occontrol.files.schema` writes those shipped."""

from __future__ import annotations

import dataclasses
import json
import typing
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from occontrol.families import family_module
from occontrol.files.schema import SCHEMAS, schema_for


def json_schema(family: str) -> dict[str, Any]:
    """The JSON Schema of the family's document, with the names and options of its methods."""
    schema = schema_for(family).Document.model_json_schema()
    methods = getattr(family_module(family), "METHODS", {})
    if methods and "method" in schema["properties"]:
        forms = [_method(name, options) for name, options in methods.items()]
        schema["properties"]["method"] = {"anyOf": [{"enum": list(methods)}, *forms]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": f"occontrol problem: {family}",
    }


def _method(name: str, options: type) -> dict[str, Any]:
    hints = typing.get_type_hints(options)
    fields = [f.name for f in dataclasses.fields(options) if f.init and f.name != "name"]
    properties = {"name": {"const": name}, **{field: TypeAdapter(hints[field]).json_schema() for field in fields}}
    return {"type": "object", "properties": properties, "required": ["name"], "additionalProperties": False}


def shipped(family: str) -> Path:
    """Where the family's JSON Schema lies in the package."""
    return Path(__file__).parents[2] / "families" / family / "schema.json"


def text(family: str) -> str:
    """The content of the shipped file."""
    return json.dumps(json_schema(family), indent=1, ensure_ascii=False) + "\n"


def families() -> list[str]:
    """The families that have a schema."""
    return [family for family, module in SCHEMAS.items() if find_spec(module)]


def write_all() -> None:
    """Write the schema of every family into the package."""
    for family in families():
        shipped(family).write_text(text(family), encoding="utf-8")
        print(shipped(family))
