"""Types: signatures say what they take, and `Any` stands only where nobody can say more."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOST = 60  # of `Any` in the whole package: attributes that are looked up by name, and what has no types of its own


def uses_of_any(source: str) -> Iterator[int]:
    """The line of every `Any`, in annotations, in aliases and inside quotes; imports do not count."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Name) and node.id == "Any":
            yield node.lineno
        elif isinstance(node, ast.Attribute) and node.attr == "Any":
            yield node.lineno
        elif isinstance(node, ast.arg | ast.AnnAssign | ast.FunctionDef):
            annotation = node.returns if isinstance(node, ast.FunctionDef) else node.annotation
            for inner in ast.walk(annotation) if annotation is not None else ():
                if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
                    try:
                        yield from (inner.lineno for _ in uses_of_any(inner.value))
                    except SyntaxError:  # words of a Literal
                        continue


def test_any_is_rare() -> None:
    found = []
    for file in sorted((ROOT / "occontrol").rglob("*.py")):
        found += [f"{file.relative_to(ROOT)}:{line}" for line in uses_of_any(file.read_text(encoding="utf-8"))]
    assert len(found) < MOST, "\n".join(found)


def test_the_count_sees_every_form() -> None:
    source = """
import typing
from typing import Any, TypeAlias
Plain: TypeAlias = Any
def one(a: Any, *b: "list[Any]", **c: typing.Any) -> dict[str, Any]: ...
value: "Any" = 1
"""
    assert len(list(uses_of_any(source))) == 6
