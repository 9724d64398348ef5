"""Formulas as lists of single operations, from CasADi: run in Python and written in C in the same order.

CasADi's own C text would need its types, its macros and the mathematics library, and in single precision its constants
would still be double; so the operations that it would write are taken from it one by one.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.kinds import CasadiFunction
from occontrol.files.export.flight.elementary import Elementary
from occontrol.files.export.flight.tables import spelled

# operation of CasADi: (C text, function that it needs)
SIGNS = {
    "OP_ASSIGN": ("{a}", ""), "OP_ADD": ("{a} + {b}", ""), "OP_SUB": ("{a} - {b}", ""), "OP_MUL": ("{a} * {b}", ""),
    "OP_DIV": ("{a} / {b}", ""), "OP_NEG": ("-{a}", ""), "OP_SQ": ("{a} * {a}", ""), "OP_TWICE": ("OCC_TWO * {a}", ""),
    "OP_INV": ("OCC_ONE / {a}", ""), "OP_LT": ("({a} < {b}) ? OCC_ONE : OCC_ZERO", ""),
    "OP_LE": ("({a} <= {b}) ? OCC_ONE : OCC_ZERO", ""),
    "OP_EQ": ("(({a} <= {b}) && ({a} >= {b})) ? OCC_ONE : OCC_ZERO", ""),
    "OP_NE": ("(({a} < {b}) || ({a} > {b})) ? OCC_ONE : OCC_ZERO", ""),
    "OP_NOT": ("(({a} < OCC_ZERO) || ({a} > OCC_ZERO)) ? OCC_ZERO : OCC_ONE", ""),
    "OP_AND": ("{a} * {b}", ""), "OP_OR": ("({a} > {b}) ? {a} : {b}", ""),
    "OP_IF_ELSE_ZERO": ("(({a} < OCC_ZERO) || ({a} > OCC_ZERO)) ? {b} : OCC_ZERO", ""),
    "OP_FMIN": ("({a} < {b}) ? {a} : {b}", ""), "OP_FMAX": ("({a} > {b}) ? {a} : {b}", ""),
    "OP_FABS": ("occ_absolute({a})", "absolute"), "OP_POW": ("occ_pow({a}, {b})", "pow"),
    "OP_CONSTPOW": ("occ_pow({a}, {b})", "pow"), "OP_ATAN2": ("occ_atan2({a}, {b})", "atan2"),
    "OP_HYPOT": ("occ_hypot({a}, {b})", "hypot"),
    **{f"OP_{name.upper()}": (f"occ_{name}({{a}})", name) for name in (
        "exp log sqrt sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh log1p expm1 floor ceil sign"
    ).split()},
}  # fmt: skip


@dataclass(frozen=True)
class Operation:
    """One operation on a row of numbers w.

    Parameters
    ----------
    name : as CasADi has it, "OP_ADD" for example
    out : where the result goes: position in w; of OP_OUTPUT the number of the output
    first, second : positions in w of what it takes; of OP_INPUT the number of the input and its entry, of OP_OUTPUT the
        position in w and the entry of the output
    constant : of OP_CONST
    """

    name: str
    out: int
    first: int = 0
    second: int = 0
    constant: float = 0.0


class Program:
    """A function of x (n,) and t with dense outputs, as a list of operations.

    Parameters
    ----------
    name : of the function in C, without the prefix
    function : of CasADi, (x, t) -> matrices

    Raises UsageError for an operation that is not written.
    """

    def __init__(self, name: str, function: CasadiFunction):
        self.name = name
        self.shapes = [tuple(function.size_out(i)) for i in range(function.n_out())]
        self.work = function.sz_w()
        self.operations = list(_operations(function))
        self.sparse = [function.nnz_out(i) < function.numel_out(i) for i in range(function.n_out())]

    @cached_property
    def needs(self) -> set[str]:
        """The elementary functions that it uses."""
        return {SIGNS[each.name][1] for each in self.operations if each.name in SIGNS} - {""}

    @property
    def count(self) -> int:
        """How many operations there are."""
        return sum(each.name in SIGNS for each in self.operations)

    def runner(self, dtype: str) -> Callable[[np.ndarray, np.floating], list[np.ndarray]]:
        """(x, t) -> its outputs, in numbers of `dtype`, "f8" or "f4"."""
        careful = self._steps(Elementary(dtype)), np.dtype(dtype).type
        quick = (self._steps(Elementary(dtype, quick=True)), float) if dtype == "f8" else careful

        def run(x: np.ndarray, t: np.floating) -> list[np.ndarray]:
            try:
                return self._run(*quick, x, t)
            except ZeroDivisionError:
                return self._run(*careful, x, t)

        return run

    def _steps(self, mathematics: Elementary) -> list[tuple]:
        """(what to do, out, first, second); an input is None, an output has what to do False."""
        kinds = {"OP_INPUT": None, "OP_OUTPUT": False}
        return [
            (kinds[each.name] if each.name in kinds else _python(each, mathematics), each.out, each.first, each.second)
            for each in self.operations
        ]

    def _run(self, steps: list[tuple], kind: type, x: np.ndarray, t: np.floating) -> list[np.ndarray]:
        w: list = [kind(0)] * max(1, self.work)
        inputs = [kind(value) for value in x.tolist()], [kind(t)]
        outputs = [[kind(0)] * (rows * columns) for rows, columns in self.shapes]
        for act, out, first, second in steps:
            if act is None:
                w[out] = inputs[first][second]
            elif act is False:
                outputs[out][second] = w[first]
            else:
                w[out] = act(w[first], w[second])
        pairs = zip(outputs, self.shapes, strict=True)
        return [np.array(found, dtype=x.dtype).reshape(shape) for found, shape in pairs]

    def text(self, arguments: Sequence[str], dtype: str) -> str:
        """The function in C.

        Parameters
        ----------
        arguments : for every output its name and size, "f[OCC_STATES]" for example; row by row
        dtype : "f8" or "f4"
        """
        inputs = {each.first for each in self.operations if each.name == "OP_INPUT"}
        names = [argument.split("[", 1)[0] for argument in arguments]
        head = f"static void occ_{self.name}(const occ_value x[OCC_STATES], occ_value t,"
        lines = [head, f"    {', '.join(f'occ_value {argument}' for argument in arguments)})", "{"]
        used = any(each.name not in ("OP_OUTPUT",) for each in self.operations)
        lines += [f"    occ_value w[{max(1, self.work)}];"] if used else []
        lines += ["    uint32_t i;"] if any(self.sparse) else []
        lines += [""] if used or any(self.sparse) else []
        lines += [f"    (void){name};" for i, name in enumerate("xt") if i not in inputs]
        for name, (rows, columns), sparse in zip(names, self.shapes, self.sparse, strict=True):
            if sparse:
                lines += [f"    for (i = 0U; i < {rows * columns}U; i++) {{", f"        {name}[i] = OCC_ZERO;", "    }"]
        for each in self.operations:
            if each.name == "OP_INPUT":
                lines.append(f"    w[{each.out}] = {f'x[{each.second}]' if each.first == 0 else 't'};")
            elif each.name == "OP_CONST":
                lines.append(f"    w[{each.out}] = {spelled(each.constant, dtype)};")
            elif each.name == "OP_OUTPUT":
                lines.append(f"    {names[each.out]}[{each.second}] = w[{each.first}];")
            else:
                a, b = f"w[{each.first}]", f"w[{each.second}]"
                lines.append(f"    w[{each.out}] = {SIGNS[each.name][0].format(a=a, b=b)};")
        return "\n".join([*lines, "}", ""])


def _operations(function: CasadiFunction):
    """The operations of an SX function, entries of outputs counted row by row."""
    import casadi

    names = {value: name for name, value in vars(casadi).items() if name.startswith("OP_")}
    places = []
    for i in range(function.n_out()):
        sparsity, columns = function.sparsity_out(i), function.size2_out(i)
        row, column = sparsity.get_triplet()
        places.append([r * columns + c for r, c in zip(row, column, strict=True)])
    for k in range(function.n_instructions()):
        name = names[function.instruction_id(k)]
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if name == "OP_CONST":
            yield Operation(name, outputs[0], constant=float(function.instruction_constant(k)))
        elif name == "OP_INPUT":
            yield Operation(name, outputs[0], inputs[0], inputs[1])
        elif name == "OP_OUTPUT":
            yield Operation(name, outputs[0], inputs[0], places[outputs[0]][outputs[1]])
        elif name in SIGNS:
            yield Operation(name, outputs[0], inputs[0], inputs[-1])
        else:
            what = f"formulas with {name[3:].lower()} are not written for a target"
            raise UsageError(f"{what}\n  hint: write them with the other functions, or take --to csv")


def _python(each: Operation, m: Elementary) -> Callable:
    one, zero, two = m.type(1), m.type(0), m.type(2)
    value = m.type(each.constant)
    found: dict[str, Callable] = {
        "OP_CONST": lambda a, b: value,
        "OP_ASSIGN": lambda a, b: a,
        "OP_ADD": operator.add,
        "OP_SUB": operator.sub,
        "OP_MUL": operator.mul,
        "OP_DIV": operator.truediv,
        "OP_NEG": lambda a, b: -a,
        "OP_SQ": lambda a, b: a * a,
        "OP_TWICE": lambda a, b: two * a,
        "OP_INV": lambda a, b: one / a,
        "OP_LT": lambda a, b: one if a < b else zero,
        "OP_LE": lambda a, b: one if a <= b else zero,
        "OP_EQ": lambda a, b: one if a <= b <= a else zero,
        "OP_NE": lambda a, b: one if a < b or a > b else zero,
        "OP_NOT": lambda a, b: zero if a < 0 or a > 0 else one,
        "OP_AND": lambda a, b: a * b,
        "OP_OR": lambda a, b: a if a > b else b,
        "OP_IF_ELSE_ZERO": lambda a, b: b if a < 0 or a > 0 else zero,
        "OP_FMIN": lambda a, b: a if a < b else b,
        "OP_FMAX": lambda a, b: a if a > b else b,
        "OP_FABS": lambda a, b: abs(a),
        "OP_POW": m.pow,
        "OP_CONSTPOW": m.pow,
        "OP_ATAN2": m.atan2,
        "OP_HYPOT": m.hypot,
    }
    if each.name in found:
        return found[each.name]
    if each.name not in SIGNS:  # inputs and outputs
        return lambda a, b: a
    one_argument = getattr(m, SIGNS[each.name][1])
    return lambda a, b: one_argument(a)
