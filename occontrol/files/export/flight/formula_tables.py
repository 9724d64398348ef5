"""What a nonlinear filter needs on a target: its formulas as programs, its few tables, and their C text."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np

from occontrol.core.target import FormulaModel, TargetPlan
from occontrol.files.export.flight.elementary import LN2, Elementary, parts_of
from occontrol.files.export.flight.program import Program
from occontrol.files.export.flight.tables import Table, smallest, spelled, wrapped

PREDICTIONS = 2  # of a replay: each moves over all that is left
REPLAYED = 2000  # steps of Runge and Kutta in a replay, after which nothing new is tried

# what each function is made of
NEEDS = {
    "sin": ("turn",), "cos": ("turn",), "tan": ("sin", "cos"), "turn": ("floor", "polynomial"),
    "exp": ("floor", "scale", "polynomial"), "expm1": ("exp", "absolute"), "sinh": ("exp", "absolute"),
    "cosh": ("exp", "absolute"), "tanh": ("sinh", "exp"), "log": ("split", "area", "absolute"),
    "area": ("polynomial",), "log1p": ("area", "log"), "asinh": ("sqrt", "log1p"), "acosh": ("sqrt", "log"),
    "atanh": ("log1p",), "atan": ("floor", "polynomial"), "atan2": ("atan",), "asin": ("atan2", "sqrt"),
    "acos": ("atan2", "sqrt"), "sqrt": ("split", "scale"), "floor": ("absolute",), "ceil": ("floor",),
    "split": ("powers",), "scale": ("powers",), "hypot": ("sqrt", "absolute"), "pow": ("exp", "log", "floor"),
}  # fmt: skip


def needed(names: set[str]) -> set[str]:
    """The functions called `names` and all that they are made of."""
    found: set[str] = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += NEEDS.get(name, ())
    return found


def programs_of(plan: TargetPlan) -> dict[str, Program]:
    """{name: program} of the formulas of a `plan`; UsageError for functions that are not written."""
    model = plan.formulas
    if model is None:
        return {}
    found = {"right": Program("right", model.right)}
    if model.noise is not None:
        found["noise"] = Program("noise", model.noise)
    for j in sorted({j for active in plan.active for j in active}):
        report = model.reports[j]
        if report is not None:
            found[f"report_{j}"] = Program(f"report_{j}", report)
    return found


def replayed(plan: TargetPlan) -> int:
    """Over how many intervals of a `plan` a self-test runs: all, or as many as take a moment in Python."""
    if plan.again is not None:  # three rounds of a cycle
        return plan.intervals + 2 * (plan.intervals - plan.again)
    each = 1 if plan.formulas is None or plan.formulas.discrete else 2 * plan.formulas.substeps
    return plan.intervals if plan.formulas is None else min(plan.intervals, max(4, REPLAYED // each))


def formula_flags(plan: TargetPlan, model: FormulaModel) -> set[str]:
    """The parts of the templates that a nonlinear `plan` with its `model` keeps."""
    found = {"nonlinear", "discrete" if model.discrete else "continuous"}
    found |= {"noise"} if model.noise is not None else set()
    return found | ({"angles"} if _angles(plan, model).any() else set())


def _angles(plan: TargetPlan, model: FormulaModel) -> np.ndarray:
    width = max(1, *(sum(plan.rows[j] for j in active) for active in plan.active))
    found = np.zeros((plan.intervals, width), dtype="u1")
    for k, active in enumerate(plan.active):
        answers = [answer for j in active for answer in model.angles[j]]
        found[k, : len(answers)] = answers
    return found


def formula_rows(plan: TargetPlan, model: FormulaModel) -> dict[str, np.ndarray]:
    """{name: rows} of the tables whose rows are shared, in the numbers of the filter.

    Parameters
    ----------
    plan : TargetPlan
    model : its formulas
    """
    rows = {}
    if model.outputs:
        N = plan.intervals + 1
        rows["predict_matrix"] = np.tile(model.output.T.reshape(1, -1), (N, 1))
        rows["predict_offset"] = rows["predict_variance"] = np.zeros((N, model.outputs))
    return rows


def time_tables(plan: TargetPlan, model: FormulaModel) -> list[Table]:
    """The spans, and which values are angles, for the `model` of a `plan`."""
    found = [Table("since", model.since[:, None].astype("f8")), Table("lengths", model.lengths[:, None].astype("f8"))]
    angles = _angles(plan, model)
    if angles.any():
        rows, index = np.unique(angles, axis=0, return_inverse=True)
        found += [Table("angle", rows), Table("angle_row", smallest(index.ravel()))]
    return found


def formula_source(text: str, plan: TargetPlan, programs: Mapping[str, Program], dtype: str, elementary: str) -> str:
    """The C text of elementary functions, formulas and sensors, with the constants that it and `text` use.

    Parameters
    ----------
    text : the rest of the source, which uses some of the constants
    plan : with formulas
    programs : {name: program} of it
    dtype : "f8" or "f4"
    elementary : the template of the elementary functions, with the parts that are needed
    """
    n = "OCC_STATES"
    parts = [filled_numbers(elementary, dtype)]
    if "right" in programs:
        parts.append(programs["right"].text([f"f[{n}]", "jacobian[OCC_SQUARE]"], dtype))
    if "noise" in programs:
        parts.append(programs["noise"].text(["intensity[OCC_SQUARE]"], dtype))
    sensors = [name for name in programs if name.startswith("report_")]
    for name in sensors:
        m = programs[name].shapes[0][0]
        parts.append(programs[name].text([f"h[{m}]", f"slope[{m}U * {n}]", f"noise[{m * m}]"], dtype))
    parts.append(_expect(plan, sensors, programs))
    body = "\n".join(parts)
    used = _macros(dtype)
    wanted = [name for name in used if re.search(rf"\b{name}\b", body + text)]
    return "\n".join([*(f"#define {name} {used[name]}" for name in wanted), "", body])


def _expect(plan: TargetPlan, sensors: list[str], programs: Mapping[str, Program]) -> str:
    """What is read at the end of an interval, in C."""
    largest = max([1, *(programs[name].shapes[0][0] for name in sensors)])
    lines = [
        "/* values h, slope and noise of the sensors in use at the end of interval k, at x */",
        "static void occ_expect(uint32_t k, const occ_value x[OCC_STATES], occ_value t,",
        "    occ_value h[OCC_VALUES], occ_value slope[OCC_VALUES * OCC_STATES],",
        "    occ_value noise[OCC_VALUES * OCC_VALUES])",
        "{",
        f"    occ_value own[{largest * largest}];",
        "    uint32_t first = 0U;",
        "    uint32_t c;",
        "    uint32_t j;",
        "    uint32_t r;",
        "",
        "    for (c = 0U; c < (OCC_VALUES * OCC_VALUES); c++) {",
        "        noise[c] = OCC_ZERO;",
        "    }",
        f"    for (c = 0U; c < {largest * largest}U; c++) {{",
        "        own[c] = OCC_ZERO;",
        "    }",
        "    for (j = 0U; j < OCC_SENSORS; j++) {",
        "        if (occ_schedule[occ_schedule_row[k]][j] != 0U) {",
        "            const uint32_t count = occ_sensor_values[0][j];",
    ]
    for i, name in enumerate(sensors):
        lines.append(f"            {'} else ' if i else ''}if (j == {name[7:]}U) {{")
        lines.append(f"                occ_{name}(x, t, &h[first], &slope[first * OCC_STATES], own);")
    if sensors:
        lines += ["            } else {", "                /* has no values */", "            }"]
    else:
        lines += ["            (void)x;", "            (void)t;", "            (void)h;", "            (void)slope;"]
    lines += [
        "            for (r = 0U; r < count; r++) {",
        "                for (c = 0U; c < count; c++) {",
        "                    noise[((first + r) * OCC_VALUES) + (first + c)] = own[(r * count) + c];",
        "                }",
        "            }",
        "            first += count;",
        "        }",
        "    }",
        "}",
        "",
    ]
    return "\n".join(lines)


def _macros(dtype: str) -> dict[str, str]:
    kind, high = np.dtype(dtype).type, parts_of(LN2, 33 if dtype == "f8" else 12, 2)
    values = {
        "HALF": 0.5, "TWO": 2.0, "THREE": 3.0, "FOUR": 4.0, "SIX": 6.0, "PI": math.pi, "HALF_PI": math.pi / 2,
        "TURN": 2 * math.pi, "WHOLE": float(Elementary(dtype).whole), "MOST": 800.0 if dtype == "f8" else 110.0,
        "LN2": math.log(2), "LN2_HIGH": high[0], "LN2_LOW": high[1], "SPANNED": float(kind(16) * np.finfo(kind).eps),
    }  # fmt: skip
    found = {f"OCC_{name}": spelled(value, dtype) for name, value in values.items()}
    counted = {k: v for k, v in Elementary(dtype).constants.items() if k not in ("half_pi", "arcs", "ln2")}
    return found | {f"OCC_{name.upper()}": f"{len(values)}U" for name, values in counted.items()}


def filled_numbers(template: str, dtype: str) -> str:
    """A `template` of elementary functions with its numbers, of `dtype` "f8" or "f4"."""
    constants = Elementary(dtype).constants

    def array(name: str, called: str, indent: str) -> str:
        words = [spelled(float(value), dtype) for value in constants[name]]
        head = f"{indent}static const occ_value {called}[{len(words)}] = {{"
        body = wrapped(words).replace("\n", f"\n{indent}")
        return f"{head}\n{indent}{body}}};"

    exponents = [str(round(math.log2(float(value)))) for value in constants["powers"]]
    words = {name.upper(): array(name, name, "    ") for name in constants}
    words["EXPONENTIAL"] = array("exponential", "occ_exponential", "") + "\n"
    words["POWERS"] = "\n".join([
        array("powers", "occ_powers", ""), array("fractions", "occ_fractions", ""),
        f"static const int32_t occ_exponents[{len(exponents)}] = {{{', '.join(exponents)}}};", "",
    ])  # fmt: skip
    for name, value in words.items():
        template = template.replace(f"@{name}@", value)
    return re.sub(r"@(\d[\d.]*)@", lambda match: spelled(float(match[1]), dtype), template)


def elementary_flags(flags: set[str], programs: Mapping[str, Program]) -> set[str]:
    """The elementary functions that formulas and templates with `flags` use."""
    names = set().union(*(program.needs for program in programs.values()))
    return needed(names | ({"floor"} if "angles" in flags else set()))
