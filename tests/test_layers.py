"""The house has floors: a file imports only from its own floor or from floors below, and families never meet."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "occontrol"
FLOORS = [["core"], ["numerics"], ["scheduling", "files"], ["families"], ["api", "studies"], ["cli"]]
# what the move alone leaves to be cut
STILL = (
    "families/robust/data", "families/robust/family", "families/robust/result",
    "files/export/contents", "files/figures/estimates", "files/report", "files/schema/__init__",
    "files/schema/json_schema",
)  # fmt: skip
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
    """The floor of a module, counted from below; ValueError for one that stands on none."""
    return next(i for i, rooms in enumerate(FLOORS) if parts[0] in rooms)


def room(parts: list[str]) -> str:
    """core, scheduling, families/robust, ...: the family is a room of its own, the table of families too."""
    return "/".join(parts[:2]) if parts[0] == "families" and is_family(parts) else parts[0]


def is_family(parts: list[str]) -> bool:
    """Whether a module belongs to one family."""
    return parts[0] == "families" and len(parts) > 1 and (PACKAGE / "families" / parts[1]).is_dir()


def edges() -> Iterator[tuple[str, list[str], list[str]]]:
    """Place, importing module and imported module of every import in the package."""
    for path in FILES:
        own = list(path.relative_to(PACKAGE).with_suffix("").parts)
        for line, name in imported(ast.parse(path.read_text(encoding="utf-8"))):
            if other := name.split(".")[1:]:
                yield f"{'/'.join(own)}.py:{line}", own, other


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(PACKAGE)) for p in FILES])
def test_a_file_imports_only_downwards_and_a_family_never_another(path: Path) -> None:
    own = list(path.relative_to(PACKAGE).with_suffix("").parts)
    if "/".join(own) in STILL:
        pytest.xfail("to be cut")
    for line, name in imported(ast.parse(path.read_text(encoding="utf-8"))):
        other = name.split(".")[1:]
        place = f"{path.name}:{line} imports {name}"
        assert floor(other) <= floor(own), f"{place}, from above"
        assert not (is_family(own) and is_family(other)) or own[1] == other[1], f"{place}, another family"


def test_the_check_sees_imports_inside_functions_and_by_name() -> None:
    source = "def f():\n    from occontrol.cli import main\n    importlib.import_module('occontrol.files.report')\n"
    assert list(imported(ast.parse(source))) == [(2, "occontrol.cli.main"), (3, "occontrol.files.report")]
