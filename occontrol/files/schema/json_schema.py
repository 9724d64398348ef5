"""The JSON Schema of a family's problem files, for editors; scripts/write_schemas.py writes those shipped."""

from __future__ import annotations

import dataclasses
import functools
import json
import operator
import typing
from collections.abc import Mapping, Sequence

from pydantic import BaseModel, TypeAdapter

from occontrol.core.kinds import Plain, PlainDict, PlainMapping
from occontrol.files.schema.matrix_forms import MATRIX_SCHEMA, PART

EDITION = "0.2"  # of the problem files


def json_schema(family: str, documents: Sequence[type[BaseModel]], methods: Mapping[str, type]) -> PlainDict:
    """The JSON Schema of problem files, with the names and options of the methods that they may name.

    Parameters
    ----------
    family : whose files they are
    documents : pydantic models; a file is one of them
    methods : {name: dataclass of options}
    """
    schema = TypeAdapter(functools.reduce(operator.or_, documents)).json_schema()
    definitions = schema.setdefault("$defs", {})
    for form in [schema, *definitions.values()]:
        if methods and "method" in form.get("properties", {}):
            form["properties"]["method"] = {"$ref": "#/$defs/Method"}
    if methods:
        forms = [_method(name, options) for name, options in methods.items()]
        definitions["Method"] = {"anyOf": [{"enum": list(methods)}, *forms]}
    schema = _with_one_matrix(schema)
    schema["$defs"]["Matrix"] = {key: _with_one_matrix(value) for key, value in MATRIX_SCHEMA.items()}
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"urn:occontrol:{EDITION}:{family}"}
    return {**head, **schema, "title": f"occontrol problem: {family}"}


def union_schema(schemas: Mapping[str, PlainMapping]) -> PlainDict:
    """One JSON Schema for the problem files of all families: `family` says which.

    Parameters
    ----------
    schemas : of every family, from `json_schema`, by name
    """
    definitions: PlainDict = {}
    choices = []
    for family, schema in schemas.items():
        own = _renamed({key: value for key, value in schema.items() if key not in ("$schema", "$id")}, family)
        definitions |= {f"{family}.{name}": form for name, form in own.pop("$defs").items()}
        definitions[family] = own
        said = {"properties": {"family": {"const": family}}, "required": ["family"]}
        choices.append({"if": said, "then": {"$ref": f"#/$defs/{family}"}})
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:occontrol:{EDITION}:problem",
        "title": "occontrol problem",
        "type": "object",
        "properties": {"family": {"enum": list(schemas)}},
        "required": ["family"],
        "allOf": choices,
        "$defs": definitions,
    }


def _with_one_matrix(node: Plain) -> Plain:
    """The forms of a matrix are written once, wherever one may stand."""
    if isinstance(node, list):
        return [_with_one_matrix(each) for each in node]
    if not isinstance(node, dict):
        return node
    if node == PART:
        return {"$ref": "#/$defs/Matrix"}
    if node.get("anyOf") == MATRIX_SCHEMA["anyOf"]:
        said = {key: value for key, value in node.items() if key not in ("anyOf", "description")}
        described = node.get("description")
        said |= {} if described in (None, MATRIX_SCHEMA["description"]) else {"description": described}
        return {"$ref": "#/$defs/Matrix", **said}
    return {key: _with_one_matrix(value) for key, value in node.items()}


def _renamed(node: Plain, family: str) -> Plain:
    """The same with references to definitions of this family."""
    if isinstance(node, list):
        return [_renamed(each, family) for each in node]
    if not isinstance(node, dict):
        return node
    return {
        key: value.replace("#/$defs/", f"#/$defs/{family}.")
        if key == "$ref" and isinstance(value, str)
        else _renamed(value, family)
        for key, value in node.items()
    }


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
