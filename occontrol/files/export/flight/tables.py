"""Tables of constants: equal rows stored once, numbers as C text, and the checksum that the target computes again."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import UsageError

WIDTH = 116
WINDOW = 64  # rows that a new one is compared with
KINDS = {"f8": "double", "f4": "float", "u1": "uint8_t", "u2": "uint16_t", "u4": "uint32_t"}


@dataclass(frozen=True, eq=False)
class Table:
    """One constant array of the target.

    Parameters
    ----------
    name : in C, without the prefix
    values : (rows, width), or (rows,) for a plain list
    """

    name: str
    values: np.ndarray

    @property
    def kind(self) -> str:
        """Its type in C."""
        return KINDS[self.values.dtype.str[1:]]

    @property
    def crc(self) -> int:
        """CRC-32 over its numbers, least significant byte first."""
        little = self.values.astype(self.values.dtype.newbyteorder("<"))
        return zlib.crc32(np.ascontiguousarray(little).tobytes())

    @property
    def declarator(self) -> str:
        """For example `const double occ_mean[1][2]`."""
        return f"const {self.kind} occ_{self.name}{''.join(f'[{size}]' for size in self.values.shape)}"

    def definition(self) -> str:
        """The array with all its numbers."""
        rows = self.values.tolist()
        spell = {"f8": _double, "f4": _single}.get(self.values.dtype.str[1:], lambda x: f"{x}U")
        if self.values.ndim == 1:
            return f"{self.declarator} = {{\n{wrapped([spell(x) for x in rows])}}};\n"
        body = ",\n".join("    {" + wrapped([spell(x) for x in row]).strip() + "}" for row in rows)
        return f"{self.declarator} = {{\n{body}}};\n"


def wrapped(words: list[str]) -> str:
    """Words with commas, in indented lines of at most WIDTH characters."""
    lines, line = [], "    "
    for i, word in enumerate(words):
        piece = word + (", " if i + 1 < len(words) else "")
        if len(line) + len(piece) > WIDTH and line.strip():
            lines.append(line.rstrip())
            line = "    "
        line += piece
    return "\n".join([*lines, line])


def _double(value: float) -> str:
    text = repr(value)  # the shortest text that reads back to the same double
    return text if "." in text or "e" in text else f"{text}.0"


def _single(value: float) -> str:
    text = str(np.float32(value))
    return (text if "." in text or "e" in text else f"{text}.0") + "F"


def spelled(value: float, dtype: str) -> str:
    """A finite `value` in C, of `dtype` "f8" or "f4"; UsageError where that does not hold it."""
    with np.errstate(over="ignore"):
        if not np.isfinite(np.dtype(dtype).type(value)):
            what = f"a formula has the number {value:g}, which {'double' if dtype == 'f8' else 'single'} precision"
            raise UsageError(f"{what} does not hold\n  hint: --precision double, or other units")
    return _double(value) if dtype == "f8" else _single(value)


def smallest(values: np.ndarray) -> np.ndarray:
    """Whole numbers from 0 upwards in the smallest type of C that holds them; `values` of any shape."""
    largest = int(np.max(values, initial=0))
    return values.astype("u1" if largest < 2**8 else "u2" if largest < 2**16 else "u4")


def distinct(rows: np.ndarray, near: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The first of all rows that are equal, and for every row which one it is.

    Parameters
    ----------
    rows : (N, width)
    near : (N, width) how far the numbers of another row may lie from those of a row that counts as equal; None: equal

    Returns positions (R,) among the rows, and index (N,) into these.
    """
    first: dict[bytes, int] = {}
    kept: list[int] = []
    index = np.zeros(len(rows), dtype=int)
    for k, row in enumerate(rows):
        key = row.tobytes()
        at = first.get(key)
        if at is None and near is not None and kept:
            recent = kept[-WINDOW:]
            others = rows[recent]
            same = np.all(np.abs(others - row) <= near[k], axis=1)
            if np.any(same):
                at = len(kept) - len(recent) + int(np.argmax(same))
                first[key] = at
        if at is None:
            at = first[key] = len(kept)
            kept.append(k)
        index[k] = at
    return np.array(kept, dtype=int), index


def shared(name: str, rows: np.ndarray) -> list[Table]:
    """A table of distinct rows and the list that says which row belongs to k.

    Parameters
    ----------
    name : of the table
    rows : (N, width)
    """
    kept, index = distinct(rows)
    return [Table(name, np.ascontiguousarray(rows[kept])), Table(f"{name}_row", smallest(index))]
