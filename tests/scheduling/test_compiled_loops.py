"""The loops of a first run hold nothing that numba takes seconds to compile: seen in their text, not compiled."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from occontrol.numerics.loops import copy_matrix, copy_vector, multiply

HOUSE = Path(__file__).resolve().parents[2] / "occontrol"
FIRST_RUN = (
    "numerics/loops.py",
    "numerics/square_root_filter.py",
    "scheduling/exchange.py",
    "scheduling/kernels.py",
    "scheduling/polytope.py",
    "scheduling/polytope_face.py",
    "scheduling/square_root_kernels.py",
    "scheduling/vectors.py",
)


def compiled(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """The functions that numba compiles."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and any("njit" in ast.dump(d) for d in node.decorator_list):
            yield node


def dear(function: ast.FunctionDef) -> list[str]:
    """Slice assignments, and literals where `product` and `copy` take offsets."""
    found = []
    for node in ast.walk(function):
        if isinstance(node, ast.Assign | ast.AugAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found += [
                ast.unparse(node)
                for t in targets
                if isinstance(t, ast.Subscript) and any(isinstance(part, ast.Slice) for part in ast.walk(t.slice))
            ]
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("product", "copy"):
            found += [ast.unparse(node) for argument in node.args if isinstance(argument, ast.Constant)]
    return found


@pytest.mark.parametrize("name", FIRST_RUN)
def test_nothing_dear_is_compiled(name: str) -> None:
    functions = list(compiled(ast.parse((HOUSE / name).read_text(encoding="utf-8"))))
    assert functions and [line for f in functions for line in dear(f)] == []


def test_the_look_sees_what_it_looks_for() -> None:
    text = "@njit\ndef f(a, b):\n    a[:, 1:] = b\n    product(a, 0, b)\n    a[0] = 1\n    copy(a, k, b, k, n)\n"
    assert len(dear(next(compiled(ast.parse(text))))) == 2


def test_the_loops_do_what_numpy_does() -> None:
    random = np.random.default_rng(3)
    A, B, target = random.normal(size=(4, 3)), random.normal(size=(3, 5)), random.normal(size=(6, 7))
    kept = target.copy()
    multiply(A, B, target[1:5, 2:])
    np.testing.assert_allclose(target[1:5, 2:], A @ B, rtol=1e-14, atol=1e-15)
    kept[1:5, 2:] = target[1:5, 2:]
    copy_matrix(A, target[2:, :3])
    kept[2:, :3] = A
    copy_vector(B[0], target[0, 1:6])
    kept[0, 1:6] = B[0]
    np.testing.assert_array_equal(target, kept)
