"""Whether docstrings state shapes, exceptions and, in core, units: the measure that test_docstrings.py applies.

Public is whatever has no leading underscore, all the way down from the module: functions, classes with their
constructor, and methods. That includes all that occontrol's table of public names reaches. A method without a
docstring of its own speaks with that of the class it overrides.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import occontrol

PACKAGE = Path(occontrol.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
_SIZE = r"(?:\.\.\.?|[\w+*/ -]{1,14}(?:\([\w+*/ -]+\)[\w/]*)?)"  # N, q*m, n(n+1)/2, ...
SHAPE = re.compile(rf"\({_SIZE},(?: ?{_SIZE},?)*\)|\(\.\.\.\)")
RAISED = re.compile(r"\b(?:\w+Error|SolveFailed|KeyboardInterrupt|StopIteration|Stop)\b")


def says_shape(name: str, text: str) -> bool:
    """Whether a sentence that names the parameter goes on to a shape, such as (N, M), or to 'of any shape'."""
    entry = entry_of(name, text)
    sentences = [entry] if entry else re.findall(rf"(?<!\w){re.escape(name)}\b[^\n]*(?:\n[^\n]+)?", text)
    return any(SHAPE.search(sentence) or "of any shape" in sentence for sentence in sentences)


def entry_of(name: str, text: str) -> str:
    """The lines of a parameter section that begin with the name, alone or in a list of names."""
    names = rf"(?:\*?\*?\w+, )*\*?\*?{re.escape(name)}(?:, \*?\*?\w+)*"
    found = re.search(rf"^{names} : .*(?:\n[ \t]+.*)*", text, re.M)
    return found[0] if found else ""


class Public:
    """One public function or method: where it stands, its parameters, its docstring, what it raises itself."""

    def __init__(self, where: str, node: ast.FunctionDef, text: str):
        self.where, self.node, self.text = where, node, text

    def parameters(self) -> list[ast.arg]:
        arguments = self.node.args
        every = [*arguments.posonlyargs, *arguments.args, arguments.vararg, *arguments.kwonlyargs, arguments.kwarg]
        return [a for a in every if a is not None and a.arg not in ("self", "cls") and not a.arg.startswith("_")]

    def without_shape(self) -> list[str]:
        arrays = [a for a in self.parameters() if a.annotation and "ndarray" in ast.unparse(a.annotation)]
        return [a.arg for a in arrays if not says_shape(a.arg, self.text)]

    def unnamed_raises(self) -> list[str]:
        """Exceptions of `raise X` that the docstring does not name.

        `raise helper(..)` asks only that some exception is named. NotImplementedError marks a method that
        subclasses write, and is no event of a run.
        """
        missing = []
        for node in ast.walk(self.node):
            if isinstance(node, ast.Raise) and node.exc is not None:
                called = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
                name = ast.unparse(called).split(".")[-1]
                if name == "NotImplementedError":
                    continue
                if not (re.search(rf"\b{name}\b", self.text) if name[0].isupper() else RAISED.search(self.text)):
                    missing.append(name)
        return missing


def public_functions(tree: ast.Module, classes: dict[str, ast.ClassDef], place: str = "") -> list[Public]:
    found = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            found.append(Public(f"{place}:{node.lineno} {node.name}", node, ast.get_docstring(node) or ""))
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for method in node.body:
                if not isinstance(method, ast.FunctionDef):
                    continue
                where = f"{place}:{method.lineno} {node.name}.{method.name}"
                if method.name == "__init__":
                    text = f"{ast.get_docstring(node) or ''}\n\n{ast.get_docstring(method) or ''}"
                    found.append(Public(where, method, text))
                elif not method.name.startswith("_"):
                    found.append(Public(where, method, _own_or_inherited(method, node, classes)))
    return found


def _own_or_inherited(method: ast.FunctionDef, owner: ast.ClassDef, classes: dict[str, ast.ClassDef]) -> str:
    text = ast.get_docstring(method)
    if text:
        return text
    for base in owner.bases:
        parent = classes.get(ast.unparse(base).split("[")[0].split(".")[-1])
        for node in parent.body if parent is not None else ():
            if isinstance(node, ast.FunctionDef) and node.name == method.name:
                return _own_or_inherited(node, parent, classes)
    return ""


TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
CLASSES = {node.name: node for tree in TREES.values() for node in tree.body if isinstance(node, ast.ClassDef)}
PUBLIC = [p for path, tree in TREES.items() for p in public_functions(tree, CLASSES, str(path.relative_to(PACKAGE)))]


# what has a unit in core, by the name of the parameter or field; all else there is a count, a share, a name, a switch
DIMENSIONAL = frozenset(
    "A B C F G Q noise covariance mean input cost lowest_cost continuous_cost lower_bound continuous_bound windows "
    "edges time times start end spacing matrix left right factor values value estimate prediction "
    "prediction_covariance standard_deviation predicted predicted_deviation output "
    "output_deviation time_limit seconds".split()
)
UNIT = re.compile(r"\b(?:units?|times?|seconds|1/time)\b")


def says_unit(name: str, text: str) -> bool:
    """Whether the entry of a parameter, or a sentence that names it, says its unit; the name itself does not count."""
    entry = entry_of(name, text)
    sentences = [entry.split(":", 1)[1]] if entry else re.findall(rf"[^.]*(?<!\w){re.escape(name)}(?!\w)[^.]*", text)
    return any(UNIT.search(re.sub(rf"`?\b{re.escape(name)}\b`?", "", sentence)) for sentence in sentences)


def fields_of(node: ast.ClassDef) -> list[str]:
    """The fields of a dataclass; those of another class are its own business."""
    if not any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list):
        return []
    return [f.target.id for f in node.body if isinstance(f, ast.AnnAssign) and isinstance(f.target, ast.Name)]


def without_unit(tree: ast.Module) -> list[str]:
    """Dimensional parameters and fields of a module of core whose docstring says no unit."""
    found = []
    for one in public_functions(tree, CLASSES):
        annotated = [a for a in one.parameters() if a.annotation is not None and a.arg in DIMENSIONAL]
        quantities = [a.arg for a in annotated if re.search("float|ndarray", ast.unparse(a.annotation or a))]
        found += [(one.where, name) for name in quantities if not says_unit(name, one.text)]
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            text = ast.get_docstring(node) or ""
            found += [(node.name, f) for f in fields_of(node) if f in DIMENSIONAL and not says_unit(f, text)]
    return [f"{where}: {name}" for where, name in found]
