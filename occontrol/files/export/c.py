"""One C99 file without dependencies: the arrays of the run and the tables of its filter as constants.

Every array is `static const`, so that the file may be included or compiled by itself; integers are int, everything
else double with 17 digits. Arrays without entries are left out, for C has none.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.files.atomic import write_text
from occontrol.files.export.c_text import c_string, comment

PREFIX = "occontrol_"
WIDTH = 120
UNUSED = (  # whoever includes the file may use a part of it
    "#if defined(__GNUC__)",
    "#define OCCONTROL_UNUSED __attribute__((unused))",
    "#else",
    "#define OCCONTROL_UNUSED",
    "#endif",
)


def write(problem: BaseProblem, solution: Solution, tables: Mapping[str, np.ndarray], target: Path) -> list[Path]:
    """Write one C file.

    Parameters
    ----------
    problem : the problem
    solution : Solution
    tables : arrays of the filter, by name, of any shape
    target : the file
    """
    names = list(getattr(getattr(problem, "sensors", None), "names", []))
    title = comment(f"{problem.name}; family {problem.family}, method {solution.method}")
    lines = [f"/* {title}: written by occontrol export */", "#ifndef OCCONTROL_EXPORT_H", "#define OCCONTROL_EXPORT_H"]
    lines += ["", "#include <math.h>", "", *UNUSED, ""]
    if names:
        lines += [f"#define {PREFIX.upper()}SENSORS {len(names)}"]
        listed = ", ".join(map(c_string, names))
        lines += [f"OCCONTROL_UNUSED static const char *const {PREFIX}sensors[{len(names)}] = {{{listed}}};"]
    arrays = dict(solution.arrays)
    arrays |= {f"filter_{name}": value for name, value in tables.items()}
    for name, value in arrays.items():
        array = np.asarray(value)
        if array.size and array.dtype.kind in "fiub":
            lines += ["", *_definition(PREFIX + re.sub(r"\W", "_", name), array)]
    lines += ["", "#endif", ""]
    target.parent.mkdir(parents=True, exist_ok=True)
    return [write_text(target, "\n".join(lines))]


def _definition(name: str, array: np.ndarray) -> list[str]:
    kind, spell = ("double", _number) if array.dtype.kind == "f" else ("int", lambda x: str(int(x)))
    sizes = "".join(f"[{size}]" for size in array.shape)
    return [f"OCCONTROL_UNUSED static const {kind} {name}{sizes} =", *_wrapped(_values(array, spell) + ";")]


def _values(array: np.ndarray, spell: Callable[[float], str]) -> str:
    if array.ndim == 0:
        return spell(array.item())
    inner = map(spell, array.tolist()) if array.ndim == 1 else (_values(part, spell) for part in array)
    return "{" + ", ".join(inner) + "}"


def _number(value: float) -> str:
    if np.isnan(value):
        return "NAN"
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = repr(float(value))  # the shortest text that reads back to the same double
    return text if "." in text or "e" in text else f"{text}.0"


def _wrapped(text: str) -> list[str]:
    lines, line = [], " "
    for word in text.split(" "):
        if len(line) + 1 + len(word) > WIDTH:
            lines.append(line)
            line = " "
        line += f" {word}"
    return [*lines, line]
