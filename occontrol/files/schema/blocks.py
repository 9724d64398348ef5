"""Matrices made of matrices, on rows of numbers and formulas: blocks along the diagonal, and Kronecker products."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import TypeAlias

from occontrol.files.schema.tables import LARGEST

Rows: TypeAlias = "list[list[float | str]]"
MOST_LETTERS = 4_000_000  # of all formulas of one matrix


def too_large(key: str, parts: Sequence[Rows]) -> str:
    """What is said of a matrix that would be too large to be made; empty where it is not.

    Parameters
    ----------
    key : "kron" or "block_diag"
    parts : matrices, of any shape
    """
    sizes = [(len(rows), len(rows[0])) for rows in parts]
    join = math.prod if key == "kron" else sum
    rows, columns = join(r for r, _ in sizes), join(c for _, c in sizes)
    if max(rows, columns) > LARGEST:
        return f"{key} makes a matrix of {rows}x{columns}, the limit is {LARGEST} each way"
    if key == "kron":  # every formula of a part stands beside each entry of the others
        filled = [sum(entry != 0.0 for row in part for entry in row) for part in parts]
        letters = sum(_letters(p) * math.prod(filled[:i] + filled[i + 1 :]) for i, p in enumerate(parts))
        if letters > MOST_LETTERS:
            return f"kron makes formulas of {letters} letters in all, the limit is {MOST_LETTERS}"
    return ""


def _letters(rows: Rows) -> int:
    return sum(len(entry) for row in rows for entry in row if isinstance(entry, str))


def block_diagonal(parts: Sequence[Rows]) -> Rows:
    """The parts along the diagonal, zeros elsewhere.

    Parameters
    ----------
    parts : matrices, of any shape
    """
    width, result, left = sum(len(rows[0]) for rows in parts), [], 0
    for rows in parts:
        right = width - left - len(rows[0])
        result += [[0.0] * left + list(row) + [0.0] * right for row in rows]
        left += len(rows[0])
    return result


def kronecker(parts: Sequence[Rows]) -> Rows:
    """The Kronecker product of all parts, from the left: every entry of the first times the whole second.

    Parameters
    ----------
    parts : matrices, of any shape
    """
    return reduce(lambda a, b: [[_times(x, y) for x in row for y in other] for row in a for other in b], parts)


def _times(a: float | str, b: float | str) -> float | str:
    """The product of two entries; a zero takes a formula away, a one leaves it as it is."""
    if not isinstance(a, str) and not isinstance(b, str):
        return a * b + 0.0  # no negative zeros
    for number, other in ((a, b), (b, a)):
        if not isinstance(number, str) and number in (0.0, 1.0):
            return other if number else 0.0
    return f"({a})*({b})" if isinstance(a, str) or a < 0 else f"{a!r}*({b})"
