"""The house has floors: a file imports only from its own floor or from floors below, and families never meet."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "occontrol"
FLOORS = [
    ["core"], ["numerics"], ["scheduling", "files"], ["families"], ["api", "studies", "adapters"], ["cli", "__main__"]
]  # fmt: skip
FILES = sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")
LONGEST = 300  # lines
INSIDE = 0.5  # share of the imports that stay inside their room
ABOVE = ("__main__", "api", "studies", "cli")  # stand above all rooms: what they import is below by design


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
    """The floor of a module, counted from below; StopIteration for one that stands on none."""
    return next(i for i, rooms in enumerate(FLOORS) if parts[0] in rooms)


def room(parts: list[str]) -> str:
    """core, scheduling, families/robust, ...: the family is a room of its own, the table of families too."""
    return "/".join(parts[:2]) if parts[0] == "families" and is_family(parts) else parts[0]


def is_family(parts: list[str]) -> bool:
    """Whether a module belongs to one family."""
    return parts[0] == "families" and len(parts) > 1 and (PACKAGE / "families" / parts[1]).is_dir()


def parts_of(path: Path) -> list[str]:
    """core/errors.py: ["core", "errors"]; a package's __init__ is the package."""
    parts = list(path.relative_to(PACKAGE).with_suffix("").parts)
    return parts[:-1] if parts[-1] == "__init__" else parts


def module(parts: list[str]) -> list[str]:
    """The module that an imported name is, or stands in."""
    found = PACKAGE.joinpath(*parts)
    return parts if found.with_suffix(".py").exists() or found.is_dir() else parts[:-1]


def edges() -> set[tuple[str, str]]:
    """(importing module, imported module) of every import in the package, each pair once."""
    found = set()
    for path in FILES:
        for _, name in imported(ast.parse(path.read_text(encoding="utf-8"))):
            if other := module(name.split(".")[1:]):
                found.add(("/".join(parts_of(path)), "/".join(other)))
    return found


def when_loaded(tree: ast.Module) -> Iterator[ast.stmt]:
    """The imports that run when a module is loaded: not those of functions, not those for type checkers only."""
    for node in tree.body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if not isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules that import each other in a circle; empty where there is none."""
    done: set[str] = set()

    def follow(name: str, path: list[str]) -> list[str]:
        if name in path:
            return [*path[path.index(name) :], name]
        if name in done:
            return []
        for other in sorted(graph.get(name, ())):
            if found := follow(other, [*path, name]):
                return found
        done.add(name)
        return []

    return next((found for name in sorted(graph) if (found := follow(name, []))), [])


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(PACKAGE)) for p in FILES])
def test_a_file_imports_only_downwards_and_a_family_never_another(path: Path) -> None:
    own = parts_of(path)
    for line, name in imported(ast.parse(path.read_text(encoding="utf-8"))):
        other = name.split(".")[1:]
        place = f"{path.name}:{line} imports {name}"
        assert floor(other) <= floor(own), f"{place}, from above"
        assert not (is_family(own) and is_family(other)) or own[1] == other[1], f"{place}, another family"


@pytest.mark.parametrize("folder", ["cli", "api"])
def test_what_stands_above_the_families_finds_them_by_the_table(folder: str) -> None:
    for path in sorted((PACKAGE / folder).glob("*.py")):
        for line, name in imported(ast.parse(path.read_text(encoding="utf-8"))):
            assert not is_family(name.split(".")[1:]), f"{path.name}:{line} imports {name}"


def test_half_of_the_imports_stay_inside_their_room() -> None:
    pairs = {(a, b) for a, b in edges() if a.split("/")[0] not in ABOVE}
    inside = sum(room(a.split("/")) == room(b.split("/")) for a, b in pairs)
    assert inside >= INSIDE * len(pairs), f"{inside} of {len(pairs)}"


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph: dict[str, set[str]] = {}
    for path in FILES:
        loaded = ast.Module(list(when_loaded(ast.parse(path.read_text(encoding="utf-8")))), [])
        others = (module(name.split(".")[1:]) for _, name in imported(loaded))
        graph["/".join(parts_of(path))] = {"/".join(other) for other in others if other}
    assert not circle(graph), " -> ".join(circle(graph))


@pytest.mark.parametrize("folder", ["occontrol", "scripts"])
def test_no_file_is_too_long_to_be_read_at_once(folder: str) -> None:
    sizes = {p: len(p.read_text(encoding="utf-8").splitlines()) for p in sorted((ROOT / folder).rglob("*.py"))}
    assert not {str(p.relative_to(ROOT)): n for p, n in sizes.items() if n > LONGEST}


def test_the_check_sees_imports_inside_functions_and_by_name() -> None:
    source = "def f():\n    from occontrol.cli import main\n    importlib.import_module('occontrol.files.report')\n"
    assert list(imported(ast.parse(source))) == [(2, "occontrol.cli.main"), (3, "occontrol.files.report")]


def test_the_search_for_circles_can_find_one() -> None:
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert circle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []
    source = "if TYPE_CHECKING:\n    from occontrol.core import errors\nimport occontrol.core.plant\n"
    assert [type(node).__name__ for node in when_loaded(ast.parse(source))] == ["Import"]
