"""The forms in which a problem file gives a matrix: their keys, and their JSON Schema."""

from __future__ import annotations

from occontrol.core.kinds import PlainDict
from occontrol.files.schema.tables import LARGEST

FORMS = (
    ("diag",),
    ("identity", "scale"),
    ("block_diag",),
    ("kron",),
    ("times", "values", "interpolation"),
    ("file", "times", "values", "interpolation"),
)
NEEDED = (("diag",), ("identity",), ("block_diag",), ("kron",), ("times", "values"), ("file", "values"))

ENTRY: PlainDict = {"type": ["number", "string"]}
_ROWS: PlainDict = {"type": "array", "items": {"type": "array", "items": ENTRY}}


def _form(properties: PlainDict, required: tuple[str, ...], title: str) -> PlainDict:
    return {
        "title": title,
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


PART: PlainDict = {"title": "a matrix in any of its forms"}
_PARTS: PlainDict = {"type": "array", "minItems": 1, "items": PART}
_INTERPOLATION = {"enum": ["linear", "previous"]}
_TABLE = {
    "times": {"type": "array", "items": {"type": "number"}},
    "values": {"type": "array"},
    "interpolation": _INTERPOLATION,
}
_FILE = {
    "file": {"type": "string"},
    "times": {"type": "string"},
    "values": {"type": "string"},
    "interpolation": _INTERPOLATION,
}
MATRIX_SCHEMA: PlainDict = {
    "description": "rows of numbers or formulas, one entry for 1x1, diag, identity, block_diag, kron, or a table",
    "anyOf": [
        ENTRY,
        _ROWS,
        {"title": "rows by the names of the states", "type": "array", "items": {"type": "string"}},
        _form({"diag": {"type": "array", "items": ENTRY}}, NEEDED[0], "diagonal"),
        _form(
            {"identity": {"type": "integer", "minimum": 1, "maximum": LARGEST}, "scale": ENTRY}, NEEDED[1], "identity"
        ),
        _form({"block_diag": _PARTS}, NEEDED[2], "matrices along the diagonal, zeros elsewhere"),
        _form({"kron": _PARTS}, NEEDED[3], "Kronecker product"),
        _form(_TABLE, NEEDED[4], "table"),
        _form(_FILE, NEEDED[5], "matrix, or table, in an .npz or .mat file"),
    ],
}
