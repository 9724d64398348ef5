from typing import Any

import numpy as np

lapack: Any

def expm(A: np.ndarray) -> np.ndarray: ...
def solve_triangular(
    a: np.ndarray, b: np.ndarray, trans: int | str = 0, lower: bool = False, unit_diagonal: bool = False,
    overwrite_b: bool = False, check_finite: bool = True,
) -> np.ndarray: ...
def __getattr__(name: str) -> Any: ...
