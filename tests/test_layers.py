"""The house has floors: a file imports only from its own floor or from floors below, and families never meet."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "occontrol"
FLOORS = ["core", "numerics", "equations", "solvers", "filtering", "families", "files", "calls", "cli"]
FILES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def imported(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and full name of everything of this package that a file imports, also inside functions and by name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: relative imports hide the floor"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "import_module":
            names = [arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]
        else:
            continue
        yield from ((node.lineno, name) for name in names if name.split(".")[0] == "occontrol")


def floor(parts: list[str]) -> int:
    return FLOORS.index(parts[0])


def family(parts: list[str]) -> str | None:
    """hybrid for families/hybrid.py and families/hybrid_runs.py; None for the table of families."""
    return parts[1].split("_")[0] if parts[0] == "families" and len(parts) > 1 and parts[1] != "__init__" else None


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(PACKAGE)) for p in FILES])
def test_a_file_imports_only_downwards(path: Path) -> None:
    own = list(path.relative_to(PACKAGE).with_suffix("").parts)
    for line, name in imported(ast.parse(path.read_text(encoding="utf-8"))):
        other = name.split(".")[1:]
        if not other or other[0] not in FLOORS:
            raise AssertionError(f"{path.name}:{line} imports {name}, which stands on no floor")
        assert floor(other) <= floor(own), f"{path.name}:{line} on floor {own[0]} imports {name} from above"
        if family(own) and (PACKAGE / "families" / f"{other[-1] if len(other) < 3 else other[1]}.py").exists():
            assert family(other) in (None, family(own)), f"{path.name}:{line} imports another family: {name}"


def test_the_check_sees_imports_inside_functions_and_by_name() -> None:
    source = "def f():\n    from occontrol.cli import main\n    importlib.import_module('occontrol.files.report')\n"
    assert list(imported(ast.parse(source))) == [(2, "occontrol.cli.main"), (3, "occontrol.files.report")]
