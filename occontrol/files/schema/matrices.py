"""What a problem file may give for a matrix: rows, a bare number or formula, diag, identity, or a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from occontrol.core.errors import Collector, Path, ProblemError
from occontrol.core.expression import value_of
from occontrol.core.linear_form import linear_form
from occontrol.core.signal import ConstantSignal, ExpressionSignal, Signal
from occontrol.core.state_labels import default_names
from occontrol.files.schema.blocks import block_diagonal, kronecker, too_large
from occontrol.files.schema.constants import Constants
from occontrol.files.schema.matrix_forms import FORMS, NEEDED
from occontrol.files.schema.tables import LARGEST
from occontrol.files.schema.tabulated import in_file, tabulated
from occontrol.files.schema.words import shown, suggest

_PLANT = (("plant", "A"), ("plant", "F"))

_BY_NAMES = ("output", "C", "H")  # their columns are the states
_PURE = {"diag", "identity", "block_diag", "kron"}
_EXAMPLES = {"block_diag": "block_diag: [[[1, 0]], {identity: 2}]", "kron": "kron: [{identity: 3}, [[0, 1], [0, 0]]]"}


class MatrixReader:
    """Turns values of the document into Signals; mistakes go to `found` with their exact path.

    Parameters
    ----------
    found : Collector for the mistakes
    load : (file, array name, path) -> array of a table file, or None after it has added its mistake
    name : path -> what the user calls the thing
    constants : of the file
    names : of the states, where the file names them
    """

    def __init__(
        self,
        found: Collector,
        load: Callable[..., np.ndarray | None],
        name: Callable[[Path], str],
        constants: Constants,
        names: Sequence[str] = (),
    ):
        self.found, self.load, self.name, self.constants, self.names = found, load, name, constants, names
        self.states: int | None = None  # of the plant, once its A or F was read

    def wrong(self, path: Path, what: str, hint: str = "", key: bool = False, of: Path | None = None) -> None:
        self.found.add(path, f"{self.name(path if of is None else of)}{what}", hint, key)

    def entry(self, value: object, path: Path, of: Path, where: str, variables: tuple[str, ...]) -> float | str | None:
        """A finite number or a checked formula."""
        if isinstance(value, str):
            try:
                value = self.constants.put_into(value, variables)
            except ProblemError as error:
                for m in error.mistakes:
                    self.found.add(path, f"{self.name(of)}{where}: {m.what}", m.hint)
                return None
            if isinstance(value, str):
                return value
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.wrong(path, f"{where} is {shown(value)}, it must be a number or a formula", of=of)
            return None
        if not math.isfinite(value):
            self.wrong(path, f"{where} is {shown(value)}, it must be finite", of=of)
            return None
        return float(value)

    def signal(self, value: object, path: Path, variables: tuple[str, ...] = ("t",)) -> Signal | None:
        """The matrix at `path`, constant, of formulas (of one variable), or tabulated; None after a mistake."""
        signal = self._signal(value, path, variables)
        if signal is not None and path in _PLANT:
            self.states = signal.shape[0]
        return signal

    def _signal(self, value: object, path: Path, variables: tuple[str, ...]) -> Signal | None:
        if isinstance(value, dict) and not _PURE & value.keys():
            return self._mapping(value, path, variables)
        rows = self.rows(value, path, variables)
        if rows is None:
            return None
        if any(isinstance(e, str) for row in rows for e in row):
            return ExpressionSignal(tuple(map(tuple, rows)), variables[0] if variables else "t")
        return _constant(np.array(rows, dtype=float))

    def rows(self, value: object, path: Path, variables: tuple[str, ...] = ("t",)) -> list[list[float | str]] | None:
        """Rows of numbers and formulas (of any of `variables`), for whoever builds a function from them."""
        if isinstance(value, dict) and _PURE & value.keys():
            return self._shorthand(value, path, variables)
        if isinstance(value, dict) and "file" in value and "times" not in value and self._keys_fit(value, path):
            matrix = in_file(self, value, path)
            return None if matrix is None else matrix.tolist()
        if not isinstance(value, list):
            single = self.entry(value, path, path, "", variables)
            return None if single is None else [[single]]
        if not value:
            self.wrong(path, " is an empty list", "a matrix is a list of rows")
            return None
        if path[-1] in _BY_NAMES and all(isinstance(row, str) for row in value) and (self.names or self.states):
            return self._by_names(value, path, variables)
        if not all(isinstance(row, list) for row in value):
            k = next(i for i, row in enumerate(value) if not isinstance(row, list))
            flat = not any(isinstance(row, list) for row in value)
            what = " is a flat list, it must be a list of rows" if flat else f": row {k + 1} is {shown(value[k])}"
            self.wrong((*path, k), what, "one row is [[1, 0]], one column is [[1], [0]]", of=path)
            return None
        lengths = [len(row) for row in value]
        if len(set(lengths)) > 1 or lengths[0] == 0:
            k = next((i for i, n in enumerate(lengths) if n != lengths[0] or n == 0), 0)
            what = f": row {k + 1} has {lengths[k]} entries, row 1 has {lengths[0]}" if k else ": row 1 is empty"
            self.wrong((*path, k), what, "all rows have the same number of entries", of=path)
            return None
        result = [
            [self.entry(e, (*path, i, j), path, f" entry [{i + 1},{j + 1}]", variables) for j, e in enumerate(row)]
            for i, row in enumerate(value)
        ]
        return None if any(e is None for row in result for e in row) else result  # type: ignore[return-value]

    def _by_names(self, value: list[str], path: Path, variables: tuple[str, ...]) -> list[list[float | str]] | None:
        """Rows of which each is a formula of the states, such as 'vx - vy'."""
        names, rows = self.names or default_names(self.states or 0), []
        for i, text in enumerate(value):
            try:
                whole = self.constants.put_into(text, (*names, *variables))
                rows.append(linear_form(str(whole), names, variables))
            except ProblemError as error:
                for m in error.mistakes:
                    self.found.add((*path, i), f"{self.name(path)} row {i + 1}: {m.what}", m.hint)
        return rows if len(rows) == len(value) else None

    def vector(self, value: object, path: Path) -> np.ndarray | None:
        """A list of numbers (a bare number is a list of one)."""
        entries = self.entries(value, path, ())
        return None if entries is None else np.array(entries, dtype=float)

    def entries(self, value: object, path: Path, variables: tuple[str, ...] = ("t",)) -> list[float | str] | None:
        """A list of numbers and, when there are variables, formulas."""
        items = value if isinstance(value, list) else [value]
        if value is None or not items:
            self.wrong(path, " is empty", "give a list of numbers")
            return None
        if all(isinstance(e, list) and len(e) == 1 for e in items):
            items = [e[0] for e in items if isinstance(e, list)]
        result = []
        for i, e in enumerate(items):
            where = f" entry {i + 1}" if isinstance(value, list) else ""
            if isinstance(e, str) and not variables and not self.constants.values:
                self.wrong((*path, i), f"{where} is {shown(e)}, it must be a number", of=path)
                result.append(None)
            else:
                read = self.entry(e, (*path, i), path, where, variables)
                result.append(value_of(read) if isinstance(read, str) and not variables else read)
        return None if any(e is None for e in result) else result  # type: ignore[return-value]

    def constant(self, value: object, path: Path) -> np.ndarray | None:
        """A matrix that may not depend on time; formulas without variables are allowed."""
        if isinstance(value, dict) and "times" in value:
            self.wrong(path, " is a table, it must be constant")
            return None
        signal = self.signal(value, path, ())
        return None if signal is None else signal.at(0.0)

    def _mapping(self, value: dict, path: Path, variables: tuple[str, ...]) -> Signal | None:
        if not any(needed[0] in value for needed in NEEDED):
            known = sorted({key for keys in FORMS for key in keys})
            unknown = next((key for key in value if key not in known), None)
            what = f": unknown key '{unknown}'" if unknown is not None else " is not a matrix"
            hint = (
                suggest(str(unknown), known)
                if unknown is not None
                else "rows, {diag: ..}, {identity: ..} or {times: .., values: ..}"
            )
            self.wrong((*path, unknown) if unknown is not None else path, what, hint, key=unknown is not None, of=path)
            return None
        return self._kept(value, path) if self._keys_fit(value, path) else None

    def _kept(self, value: dict, path: Path) -> Signal | None:
        """A table, or a single matrix in a file."""
        if "times" in value:
            return tabulated(self, value, path)
        matrix = in_file(self, value, path)
        return None if matrix is None else _constant(matrix)

    def _keys_fit(self, value: dict, path: Path) -> bool:
        """Whether a mapping has the keys of its form and no others; False after its mistakes were noted."""
        form = max(i for i, needed in enumerate(NEEDED) if needed[0] in value)
        bad = [key for key in value if key not in FORMS[form]]
        for key in bad:
            self.wrong(
                (*path, key),
                f": unknown key '{key}' beside '{NEEDED[form][0]}'",
                suggest(str(key), FORMS[form]),
                True,
                path,
            )
        lacking = [key for key in NEEDED[form] if key not in value]
        for key in lacking:
            self.wrong(path, f" has no '{key}'", "a table needs " + " and ".join(NEEDED[form]))
        return not bad and not lacking

    def _shorthand(self, value: dict, path: Path, variables: tuple[str, ...]) -> list[list[float | str]] | None:
        """diag, identity, block_diag or kron."""
        if not self._keys_fit(value, path):
            return None
        if "block_diag" in value or "kron" in value:
            return self._composed(value, path, variables)
        return self._square(value, path, variables)

    def _composed(self, value: dict, path: Path, variables: tuple[str, ...]) -> list[list[float | str]] | None:
        """A matrix made of others, which may be made of others."""
        key, join = ("kron", kronecker) if "kron" in value else ("block_diag", block_diagonal)
        parts = value[key]
        if not isinstance(parts, list) or not parts:
            self.wrong(
                (*path, key), f".{key} is {shown(parts)}, it must be a list of matrices", _EXAMPLES[key], of=path
            )
            return None
        read = [self.rows(part, (*path, key, i), variables) for i, part in enumerate(parts)]
        matrices = [rows for rows in read if rows is not None]
        if len(matrices) < len(read):
            return None
        if what := too_large(key, matrices):
            self.wrong((*path, key), f": {what}", of=path)
            return None
        return join(matrices)

    def _square(self, value: dict, path: Path, variables: tuple[str, ...]) -> list[list[float | str]] | None:
        if "diag" in value:
            items = value["diag"]
            if not isinstance(items, list) or not 1 <= len(items) <= LARGEST:
                self.wrong(
                    (*path, "diag"), f".diag is {shown(items)}, it must be a list of 1 to {LARGEST} entries", of=path
                )
                return None
            diagonal = self.entries(items, (*path, "diag"), variables)
        else:
            n = value["identity"]
            if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= LARGEST:
                what = f".identity is {shown(n)}, it must be a whole number from 1 to {LARGEST}"
                self.wrong((*path, "identity"), what, of=path)
                return None
            scale = self.entry(value.get("scale", 1.0), (*path, "scale"), path, ".scale", variables)
            diagonal = None if scale is None else [scale] * n
        if diagonal is None:
            return None
        return [[d if i == j else 0.0 for j in range(len(diagonal))] for i, d in enumerate(diagonal)]


def _constant(matrix: np.ndarray) -> ConstantSignal:
    matrix.setflags(write=False)
    return ConstantSignal(matrix)
