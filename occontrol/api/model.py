"""A problem file to start from, made of the state space in a MATLAB file: `occontrol init --from model.mat`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from occontrol.core.errors import FileAccessError, Mistake, ProblemError

# what is looked for: the names that it may have
NAMES = {"A": ("A", "F"), "C": ("C", "H"), "Q": ("Q", "Xi"), "R": ("R", "Theta"), "P": ("P0", "P", "Sigma0"),
         "x": ("x0",), "D": ("D",), "dt": ("Ts", "dt")}  # fmt: skip
MISSING = "   # NOT IN THE FILE: a stand-in, set it"


def problem_text(path: str | Path) -> str:
    """The text of a problem file of family athans with the matrices of a .mat file, digit for digit.

    Parameters
    ----------
    path : a .mat file with A (or F), C (or H) and, as far as it has them, Q, R, P0, x0, Ts; D must be zero

    Raises ProblemError where the file holds no such state space, FileAccessError where it cannot be read.
    """
    from occontrol.files.mat_file import mat_shapes, read_mat

    path = Path(path)
    if not path.is_file():
        raise FileAccessError(f"there is no file {path}")
    if path.suffix.lower() != ".mat":
        raise _wrong(path, f"the file name ends in '{path.suffix}'", "a state space is read from a .mat file")
    shapes = mat_shapes(path, str(path))
    chosen = {key: next((n for n in names if shapes.get(n) is not None), None) for key, names in NAMES.items()}
    given = {key: read_mat(path, name, str(path)) for key, name in chosen.items() if name is not None}
    for key in ("A", "C"):
        if key not in given:
            there = ", ".join(name for name, shape in shapes.items() if shape is not None) or "no arrays of numbers"
            raise _wrong(path, f"there is no {key} in the file", f"it holds: {there}")
    return _text(path, given)


def _text(path: Path, given: Mapping[str, np.ndarray]) -> str:
    A, C = given["A"], given["C"]
    n, m = A.shape[0], C.shape[0]
    wanted = {"A": (n, n), "C": (m, n), "Q": (n, n), "R": (m, m), "P": (n, n)}
    for key, shape in wanted.items():
        if key in given and given[key].shape != shape:
            what = f"{key} is {'x'.join(map(str, given[key].shape))}, it must be {shape[0]}x{shape[1]}"
            raise _wrong(path, what, f"A has {n} states, C has {m} rows")
    if np.any(given.get("D", 0.0)):
        raise _wrong(path, "D is not zero", "subtract D u from the measurements, and leave D out")
    step = float(given["dt"].ravel()[0]) if "dt" in given and given["dt"].size else 0.0
    letters = ("F", "Q", "H", "R") if step else ("A", "noise", "C", "noise")
    lines = [f"# Made by occontrol init --from {path.name}: look through it, then: occontrol solve FILE"]
    lines += ["family: athans", f"name: {path.stem}"]
    if step:
        lines += [f"horizon: {{steps: 100}}              # one step is the sampling time {step!r} of the file"]
    else:
        lines += [f"horizon: {{start: 0, end: {_span(A):g}, intervals: 200}}   # from the slowest pole: set it"]
    kind = "the covariance of the plant noise of a step" if step else "the intensity of the plant noise"
    lines += ["plant:", f"  {letters[0]}: {_rows(A)}", f"  # {kind}"]
    lines += [f"  {letters[1]}: {_rows(given['Q']) if 'Q' in given else f'{{identity: {n}}}' + MISSING}"]
    lines += ["  initial:"]
    lines += [f"    mean: {given['x'].ravel().tolist()}"] if "x" in given and given["x"].size == n else []
    lines += [f"    covariance: {_rows(given['P']) if 'P' in given else f'{{identity: {n}}}' + MISSING}", "sensors:"]
    R = given.get("R")
    own = R is None or not np.any(R - np.diag(np.diag(R)))
    parts = [(i, i + 1) for i in range(m)] if own else [(0, m)]
    for i, j in parts:
        noise = "[[1.0]]" if R is None else _rows(R[i:j, i:j])
        name = f"y{i + 1}" if own else "y"
        lines += [f"  - {{name: {name}, {letters[2]}: {_rows(C[i:j])}, {letters[3]}: {noise}, cost: 0}}"]
        lines[-1] += MISSING if R is None else ""
    lines += [f"objective: {{output: {{identity: {n}}}}}    # what is to be known at the end: set it"]
    return "\n".join(lines) + "\n"


def _span(A: np.ndarray) -> float:
    """A few time constants of the slowest pole, in one digit."""
    rates = np.abs(np.linalg.eigvals(A)) if np.all(np.isfinite(A)) else np.zeros(1)
    slow = min((float(r) for r in rates if r > 1e-9 * max(1e-300, float(np.max(rates)))), default=0.5)
    return float(f"{5 / slow:.0e}")


def _rows(matrix: np.ndarray) -> str:
    return "[" + ", ".join(str(row) for row in matrix.tolist()) + "]"


def _wrong(path: Path, what: str, hint: str) -> ProblemError:
    return ProblemError(Mistake((), what, hint, place=str(path)))
