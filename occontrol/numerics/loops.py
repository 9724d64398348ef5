"""Copies and products inside compiled loops, written out.

A slice assignment (`A[:, :n] = B`) makes numba compile its broadcasting with the texts of all its errors, and `np.dot`
its calls of BLAS: seconds for every kernel that has one, before the first result. These loops compile in a tenth of a
second, and the compiler sees through them. Shapes must fit, nothing is checked.
"""

from __future__ import annotations

import numpy as np
from numba import njit

# kernels are called from Python and from each other, not through a pointer of C: without that entry less is compiled
ENTRY = {"no_cfunc_wrapper": True}
OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}, **ENTRY}


@njit(**OPTIONS)
def copy_vector(source: np.ndarray, target: np.ndarray) -> None:
    """target <- source.

    Parameters
    ----------
    source, target : (n,)
    """
    for i in range(len(source)):
        target[i] = source[i]


@njit(**OPTIONS)
def copy_matrix(source: np.ndarray, target: np.ndarray) -> None:
    """target <- source; `target` may be a part of a larger array.

    Parameters
    ----------
    source, target : (m, n)
    """
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@njit(**OPTIONS)
def multiply(A: np.ndarray, B: np.ndarray, target: np.ndarray) -> None:
    """target <- A B; `target` may be a part of a larger array, and none of A and B.

    Parameters
    ----------
    A : (m, k)
    B : (k, n)
    target : (m, n)
    """
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            target[i, j] = 0.0
        for k in range(A.shape[1]):
            a = A[i, k]
            for j in range(B.shape[1]):
                target[i, j] += a * B[k, j]
