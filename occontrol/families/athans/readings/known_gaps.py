"""The plant from reading to reading where its maps are given instead of a matrix A(t): a linearised plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occontrol.core.signal import Signal


@dataclass(frozen=True, eq=False)
class KnownGaps:
    """The maps of N+1 spans, to the first of N readings, between them and on to the end; and that to the prediction.

    Parameters
    ----------
    transition : (N+1, n, n) F
    noise : (N+1, n, n) Q, covariance that the plant noise adds over a span
    beyond : F and Q (n, n) from the end to the prediction
    charges : R, (n, n) Signal -> M (N+1, n, n) and c (N+1,) with int tr(R S) dt = tr(M S) + c over a span
    """

    transition: np.ndarray
    noise: np.ndarray
    beyond: tuple[np.ndarray, np.ndarray]
    charges: Callable[[Signal], tuple[np.ndarray, np.ndarray]]
