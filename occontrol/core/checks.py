"""One checker and one sentence style for every matrix that a user gives."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import Mistake, Path, ProblemError
from occontrol.core.signal import ExpressionSignal, Signal

ASYMMETRY = 1e-9
NEGATIVE = 1e-10
SINGULAR = 1e-14
SAMPLES_BETWEEN = 513
LARGEST = 1e100  # products of a few such numbers are still finite
UNITS = "choose other units"


def check_shape(
    name: str, shape: tuple[int, int], rows: int | None, columns: int | None, path: Path, hint: str = ""
) -> list[Mistake]:
    """Compare a shape with the wanted one; None is any."""
    wrong = (rows is not None and shape[0] != rows) or (columns is not None and shape[1] != columns)
    if not wrong:
        return []
    wanted = f"be {rows}x{columns}"
    if rows is None or columns is None:
        count, kind = (columns, "column") if rows is None else (rows, "row")
        wanted = f"have {count} {kind}{'s' * (count != 1)}"
    return [Mistake(path, f"{name} is {shape[0]}x{shape[1]}, it must {wanted}", hint)]


def check_covariance(
    name: str, matrix: np.ndarray, path: Path, definite: bool = False, when: str = ""
) -> list[Mistake]:
    """Finite, symmetric to 1e-9 relative and positive semidefinite (or definite); names the eigenvalue.

    `matrix` is (n, n), in any unit.
    """
    if not np.all(np.isfinite(matrix)):
        return [Mistake(path, f"{name} is not finite{when}")]
    if matrix.shape[0] != matrix.shape[1]:
        return [Mistake(path, f"{name} is {matrix.shape[0]}x{matrix.shape[1]}, it must be square")]
    if matrix.size == 0:
        return []
    scale = float(np.max(np.abs(matrix)))
    if scale > LARGEST:
        return [Mistake(path, f"{name} is too large{when}: it holds {scale:g}", UNITS)]
    if np.max(np.abs(matrix - matrix.T)) > ASYMMETRY * scale:
        i, j = np.unravel_index(int(np.argmax(np.abs(matrix - matrix.T))), matrix.shape)
        entries = f"entry [{i + 1},{j + 1}] is {matrix[i, j]:.10g}, [{j + 1},{i + 1}] is {matrix[j, i]:.10g}"
        return [Mistake(path, f"{name} is not symmetric{when}: {entries}")]
    eigenvalues = np.linalg.eigvalsh((matrix + matrix.T) / 2)
    smallest, largest = float(eigenvalues[0]), max(float(eigenvalues[-1]), 0.0)
    if definite and smallest <= SINGULAR * largest and not _definite_in_own_units(matrix):
        return [Mistake(path, f"{name} is not positive definite{when}: its smallest eigenvalue is {smallest:g}")]
    if definite and np.min(np.diag(matrix)) < 1 / LARGEST:
        return [Mistake(path, f"{name} is too small{when}: its smallest eigenvalue is {smallest:g}", UNITS)]
    if not definite and smallest < -NEGATIVE * max(largest, -smallest * 1e-3):
        return [Mistake(path, f"{name} is not positive semidefinite{when}: its smallest eigenvalue is {smallest:g}")]
    return []


def _definite_in_own_units(matrix: np.ndarray) -> bool:
    """Whether a symmetric matrix is positive definite once its diagonal is one: rows may have units far apart."""
    diagonal = np.diag(matrix)
    if not np.all(diagonal > 0):
        return False
    scale = np.sqrt(diagonal)
    values = np.linalg.eigvalsh((matrix + matrix.T) / 2 / scale / scale[:, None])
    return bool(values[0] > SINGULAR * values[-1])


def check_finite(name: str, signal: Signal, times: np.ndarray, path: Path, variable: str = "t") -> list[Mistake]:
    """Evaluate a signal on a grid, and formulas between; name the first time at which it is not finite.

    `times` (K,), in the unit of time.
    """
    if signal.constant or len(times) == 0:
        scale = float(np.max(np.abs(signal.at(0.0)), initial=0.0)) if signal.constant else 0.0
        return [Mistake(path, f"{name} is too large: it holds {scale:g}", UNITS)] if scale > LARGEST else []
    hint = "it must be finite over the whole horizon"
    try:
        times = looked_at(signal, times, variable)
    except ProblemError as error:  # a formula whose jumps cannot be told
        return [Mistake(path, f"{name}: {m.what}", m.hint) for m in error.mistakes]
    values = signal.sample(times)
    bad = ~np.all(np.isfinite(values), axis=(1, 2))
    if np.any(bad):
        k = int(np.argmax(bad))
        i, j = np.argwhere(~np.isfinite(values[k]))[0]
        where = f"entry [{i + 1},{j + 1}] is {values[k, i, j]}"
        return [Mistake(path, f"{name} is not finite at {variable} = {times[k]:.6g}: {where}", hint)]
    pole = signal.pole(times) if isinstance(signal, ExpressionSignal) and variable == "t" else None
    if pole is not None:
        what = f"{name} is not finite at {variable} = {pole[0]:.6g}: entry [{pole[1] + 1},{pole[2] + 1}] is infinite"
        return [Mistake(path, what, hint)]
    sizes = np.max(np.abs(values), axis=(1, 2), initial=0.0)
    k = int(np.argmax(sizes))
    what = f"{name} is too large at {variable} = {times[k]:.6g}: it holds {sizes[k]:g}"
    return [Mistake(path, what, UNITS)] if sizes[k] > LARGEST else []


def looked_at(signal: Signal, times: np.ndarray, variable: str = "t") -> np.ndarray:
    """The times at which a signal is checked: the grid, and in continuous time more between for a formula or table.

    `times` (K,) is the grid, in the unit of time.
    """
    if variable != "t" or signal.constant:
        return times
    inside = signal.breaks(float(times[0]), float(times[-1]))
    if isinstance(signal, ExpressionSignal):
        inside = np.union1d(inside, np.linspace(times[0], times[-1], SAMPLES_BETWEEN))
    return np.union1d(times, inside[(inside > times[0]) & (inside < times[-1])])


def check_covariance_signal(
    name: str, signal: Signal, times: np.ndarray, path: Path, definite: bool = False, variable: str = "t"
) -> list[Mistake]:
    """`check_covariance` at every time of the grid; the first failure is reported with its time.

    `times` (K,) is the grid, in the unit of time.
    """
    if signal.constant:
        return check_covariance(name, signal.at(0.0), path, definite)
    if len(times) == 0:
        return []
    mistakes = check_finite(name, signal, times, path, variable)
    if mistakes:
        return mistakes
    times = looked_at(signal, times, variable)
    values = signal.sample(times)
    if signal.shape[0] != signal.shape[1] or signal.shape[0] == 0:
        return check_covariance(name, values[0], path, definite)
    swapped = np.swapaxes(values, 1, 2)
    smallest = np.linalg.eigvalsh((values + swapped) / 2)[:, 0]
    uneven = np.max(np.abs(values - swapped), axis=(1, 2)) > 0
    # only what may fail is looked at one by one
    for k in np.flatnonzero((smallest <= 1e-9 * np.max(np.abs(values), axis=(1, 2))) | uneven):
        found = check_covariance(name, values[k], path, definite, f" at {variable} = {times[k]:.6g}")
        if found:
            return found
    return []
