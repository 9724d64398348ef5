"""Checks of vectors and probability distributions that a user gives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.errors import Mistake, Path

SUM_TOLERANCE = 1e-9


def check_vector(name: str, vector: np.ndarray, size: int, path: Path, hint: str) -> list[Mistake]:
    """A finite vector of a given length. `vector` should be (size,)."""
    count = len(vector)
    if count != size:
        what = f"{name} has {count} entr{'y' if count == 1 else 'ies'}, it must have {size}"
        return [Mistake(path, what, hint)]
    return [] if np.all(np.isfinite(vector)) else [Mistake(path, f"{name} is not finite")]


def normalised(rows: np.ndarray) -> np.ndarray:
    """Distributions, `rows` (..., outcomes), divided by their sums; those that sum to 1 up to rounding stay.

    So doing it twice is doing it once, and a problem that was written and read again is the same to the last bit.
    """
    total = rows.sum(axis=-1, keepdims=True)
    rounding = 4 * np.finfo(float).eps * rows.shape[-1]
    return np.where(np.abs(total - 1.0) <= rounding, rows, rows / total)


def check_distribution(name: str, vector: np.ndarray, outcomes: Sequence[str], path: Path) -> list[Mistake]:
    """Probabilities: not negative, and summing to 1 within 1e-9. `vector` is (outcomes,)."""
    if not np.all(np.isfinite(vector)):
        return [Mistake(path, f"{name} is not finite")]
    if np.any(vector < 0):
        j = int(np.argmin(vector))
        what = f"{name} has the negative entry {vector[j]:g} for '{outcomes[j]}'"
        return [Mistake((*path, j), what, "probabilities are not negative")]
    total = float(vector.sum())
    if abs(total - 1.0) > SUM_TOLERANCE:
        hint = "fractions may be written as formulas, for example '1/3'"
        return [Mistake(path, f"{name} sums to {total:.12g}, not to 1", hint)]
    return []
