"""Docstrings are kept true: every public name has one, and what the library hands out explains every parameter."""

from __future__ import annotations

import ast
import enum
import inspect
import re
from operator import attrgetter
from pathlib import Path

import pytest

import occontrol
from tests.docstring_measure import PUBLIC, TREES, without_unit

PACKAGE = Path(occontrol.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))


def public_definitions(tree: ast.Module) -> list[ast.FunctionDef | ast.ClassDef]:
    return [n for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef) and not n.name.startswith("_")]


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(PACKAGE)) for p in FILES])
def test_modules_and_public_definitions_say_what_they_are(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    missing = [] if not tree.body or ast.get_docstring(tree) else ["the module"]
    # the classes of a schema are the keys of a problem file, described field by field
    documents = path.stem in ("schema", "schema_parts")
    for node in public_definitions(tree):
        if not ast.get_docstring(node) and not (documents and isinstance(node, ast.ClassDef)):
            missing.append(node.name)
    assert not missing, f"no docstring: {', '.join(missing)}"


def unexplained(thing: object) -> list[str]:
    """Parameters of a function, or of a class's constructor, that its docstring never names."""
    text = inspect.getdoc(thing) or ""
    parameters = [p for p in inspect.signature(thing).parameters.values() if not p.name.startswith("_")]  # type: ignore[arg-type]
    return [p.name for p in parameters if not re.search(rf"\b{p.name}\b", text)]


def public_names() -> list[str]:
    """Names at the top, and those below the name of a family, such as robust.Random."""
    families = [name for name in dir(occontrol) if name not in occontrol.__all__]
    below = [f"{family}.{name}" for family in families for name in dir(getattr(occontrol, family))]
    return [*occontrol.__all__, *below]


@pytest.mark.parametrize("name", public_names())
def test_the_docstring_of_a_public_name_mentions_every_parameter(name: str) -> None:
    thing = attrgetter(name)(occontrol)
    if inspect.isclass(thing) and issubclass(thing, Exception | enum.Enum):
        assert inspect.getdoc(thing)
        return
    assert not unexplained(thing), f"{name}: {unexplained(thing)}"


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(PACKAGE)) for p in FILES])
def test_a_parameter_section_names_nothing_that_is_not_there(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            stale = described(ast.get_docstring(node) or "") - {
                a.arg for a in ast.walk(node.args) if isinstance(a, ast.arg)
            }
            assert not stale, f"{path.name}:{node.lineno} {node.name} explains {sorted(stale)}, which it does not take"


def described(text: str) -> set[str]:
    """The names before the colons of a docstring's parameter section."""
    if "Parameters\n----------\n" not in text:
        return set()
    section = text.split("Parameters\n----------\n", 1)[1]
    section = re.split(r"\n\n|\n\w+\n-+\n", section)[0]
    heads = [m[1] for line in section.splitlines() if (m := re.match(r"(\*{0,2}\w+(?:, \*{0,2}\w+)*) : ", line))]
    return {name.lstrip("*") for head in heads for name in head.split(", ")}


def test_the_check_can_fail() -> None:
    def solve(problem: int, speed: int) -> None:
        """Solve a problem."""

    assert unexplained(solve) == ["speed"]
    assert described(
        "Solve.\n\nParameters\n----------\nx, y : numbers\nz : (N,)\n    more: of it\n\nRaises: no"
    ) == set("xyz")


def test_every_array_parameter_of_a_public_function_states_its_shape() -> None:
    wrong = [f"{one.where}: {', '.join(one.without_shape())}" for one in PUBLIC if one.without_shape()]
    assert not wrong, "\n".join(wrong)
    annotations = [ast.unparse(a.annotation) for one in PUBLIC for a in one.parameters() if a.annotation]
    assert sum("ndarray" in text for text in annotations) > 500


def test_every_exception_raised_in_a_public_function_is_named() -> None:
    """The commands of cli are left out: their docstrings are help texts, which speak of exit codes."""
    library = [one for one in PUBLIC if not one.where.startswith("cli")]
    wrong = [f"{one.where}: {', '.join(one.unnamed_raises())}" for one in library if one.unnamed_raises()]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("path", sorted((PACKAGE / "core").glob("*.py")), ids=lambda path: path.name)
def test_core_states_the_unit_of_every_dimensional_parameter(path: Path) -> None:
    assert not without_unit(TREES[path])
