"""The loops of a first run hold nothing that numba takes long to compile: seen in their text, and counted."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from occontrol.numerics.loops import copy_matrix, copy_vector, multiply

HOUSE = Path(__file__).resolve().parents[2] / "occontrol"
FIRST_RUN = (
    "numerics/loops.py",
    "numerics/riccati_march.py",
    "scheduling/exchange.py",
    "scheduling/kernels.py",
    "scheduling/kernels_costate.py",
    "scheduling/polytope.py",
    "scheduling/polytope_face.py",
    "scheduling/quasi_newton.py",
    "scheduling/rounding.py",
    "scheduling/square_root_kernels.py",
    "scheduling/vectors.py",
)
OWN = {"np.empty", "np.zeros", "np.dot", "min", "max", "int"}  # each is compiled for every kernel that calls it
OF_FILTERS = "numerics/square_root_filter.py"  # compiled when a filter runs, not before the first bound
MOST_EVENTS = 32  # 27 are seen; each np.empty, max or np.dot in a loop adds one or more
COUNTED = """\
import sys
from numba.core import event
names = []
class Count(event.Listener):
    def on_start(self, event):
        names.append(event.data["dispatcher"].py_func.__module__)
    def on_end(self, event):
        pass
event.register("numba:compile", Count())
from occontrol.cli import run
assert run(["solve", sys.argv[1], "--no-figures", "--out", "out"]) == 0
print(" ".join(names))
"""


def compiled(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """The functions that numba compiles."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and any("njit" in ast.dump(d) for d in node.decorator_list):
            yield node


def dear(function: ast.FunctionDef) -> list[str]:
    """Slice assignments, literals where `product` and `copy` take offsets, and what numba compiles by itself."""
    found = []
    for node in ast.walk(function):
        if isinstance(node, ast.Assign | ast.AugAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found += [
                ast.unparse(node)
                for t in targets
                if isinstance(t, ast.Subscript) and any(isinstance(part, ast.Slice) for part in ast.walk(t.slice))
            ]
        if isinstance(node, ast.Call) and ast.unparse(node.func) in OWN:
            found.append(ast.unparse(node))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("product", "copy"):
            found += [ast.unparse(node) for argument in node.args if isinstance(argument, ast.Constant)]
    return found


@pytest.mark.parametrize("name", [*FIRST_RUN, OF_FILTERS])
def test_nothing_dear_is_compiled(name: str) -> None:
    functions = list(compiled(ast.parse((HOUSE / name).read_text(encoding="utf-8"))))
    found = [line for f in functions for line in dear(f) if name != OF_FILTERS or line.split("(")[0] not in OWN]
    assert functions and found == []


def test_the_look_sees_what_it_looks_for() -> None:
    text = "@njit\ndef f(a, b):\n    a[:, 1:] = b\n    product(a, 0, b)\n    a[0] = 1\n    copy(a, k, b, k, n)\n"
    text += "    c = max(a[1], 2)\n"
    assert len(dear(next(compiled(ast.parse(text))))) == 3


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


@pytest.mark.slow
def test_a_first_run_compiles_few_kernels(tmp_path: Path) -> None:
    """The short form is test_nothing_dear_is_compiled."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(HOUSE.parent)}
    problem = HOUSE.parent / "problems" / "scalar_on_off.yaml"
    done = subprocess.run(
        [sys.executable, "-c", COUNTED, str(problem)], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    modules = done.stdout.splitlines()[-1].split()
    assert 10 < len(modules) <= MOST_EVENTS and {name.split(".")[0] for name in modules} == {"occontrol"}
