"""Linear matrix inequalities by Clarabel, called directly.

Unknowns: values (m,).  minimise costs' values,  constant + sum_i values_i f_i f_i' >= 0,  0 <= values <= upper.
The matrix is packed as its upper triangle, column by column, off-diagonal entries times sqrt 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

LARGEST = 80  # rows; the packed cone is dense: storage grows with the fourth power, time with the sixth


@dataclass(frozen=True, eq=False)
class SdpResult:
    """Raw outcome; nothing in it is verified.

    Parameters
    ----------
    values : (m,)
    dual : (r, r) multiplier of the matrix inequality
    slack : (m,) multiplier of values >= 0
    status : Clarabel's own word
    iterations : int
    """

    values: np.ndarray
    dual: np.ndarray
    slack: np.ndarray
    status: str
    iterations: int


def pack(matrix: np.ndarray) -> np.ndarray:
    """The triangle (..., r(r+1)/2) of a symmetric `matrix` (..., r, r), scaled so that inner products stay the same."""
    column, row = np.tril_indices(matrix.shape[-1])
    return matrix[..., row, column] * np.where(row == column, 1.0, np.sqrt(2.0))


def unpack(vector: np.ndarray, rows: int) -> np.ndarray:
    """The inverse of `pack`: (..., r, r) for `vector` (..., r(r+1)/2) and `rows` r."""
    column, row = np.tril_indices(rows)
    matrix = np.zeros((rows, rows))
    matrix[row, column] = vector / np.where(row == column, 1.0, np.sqrt(2.0))
    return matrix + np.triu(matrix, 1).T


def solve_lmi(
    constant: np.ndarray,
    factors: np.ndarray,
    costs: np.ndarray,
    upper: np.ndarray,
    tolerance: float = 1e-12,
    max_iterations: int = 200,
    time_limit: float = float("inf"),
) -> SdpResult:
    """Minimise costs' values over the inequality in the header.

    Parameters
    ----------
    constant : (r, r) symmetric, r <= LARGEST
    factors : (m, r) the f_i
    costs, upper : (m,) objective and caps (infinity: none)
    tolerance : Clarabel's gap and feasibility tolerances; its defaults leave 1e-8 in the objective
    time_limit : seconds

    Raises ValueError for more than LARGEST rows.
    """
    import clarabel as module
    from scipy.sparse import csc_matrix, vstack

    clarabel: Any = module  # it ships no type stubs
    m, r = factors.shape
    if r > LARGEST:
        raise ValueError(f"a matrix inequality of {r} rows is too large for Clarabel's packed cone (at most {LARGEST})")
    capped = np.flatnonzero(np.isfinite(upper))
    products = pack(factors[:, :, None] * factors[:, None, :])
    one = np.eye(m)
    blocks = [csc_matrix(-one), csc_matrix(one[capped]), csc_matrix(-products.T)]
    right = np.concatenate([np.zeros(m), upper[capped], pack(constant)])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = max_iterations
    settings.time_limit = time_limit
    for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas", "tol_ktratio"):
        setattr(settings, name, tolerance)
    cones = [clarabel.NonnegativeConeT(m), clarabel.NonnegativeConeT(len(capped)), clarabel.PSDTriangleConeT(r)]
    solver = clarabel.DefaultSolver(csc_matrix((m, m)), costs, vstack(blocks, format="csc"), right, cones, settings)
    found = solver.solve()
    duals = np.array(found.z)
    dual = unpack(duals[m + len(capped) :], r)
    return SdpResult(np.array(found.x), dual, duals[:m], str(found.status), int(found.iterations))
