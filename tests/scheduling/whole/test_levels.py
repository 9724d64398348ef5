"""Places of a covariance among levels: values put together there lie below any concave function that grows."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.scheduling.whole.levels import lies, mixed, place


def packed(S: np.ndarray) -> np.ndarray:
    return S[np.tril_indices(len(S))]


def concave(S: np.ndarray, G: np.ndarray, w: np.ndarray) -> float:
    """w'(S^-1 + G)^-1 w + ln det(I + S): both grow with S and are concave in it."""
    n = len(S)
    return float(w @ np.linalg.solve(np.eye(n) + S @ G, S) @ w + np.linalg.slogdet(np.eye(n) + S)[1])


@pytest.mark.parametrize("n", [1, 2, 4])
@pytest.mark.parametrize("seed", range(4))
def test_a_mixture_of_values_lies_below_the_value(n: int, seed: int) -> None:
    g = np.random.default_rng(seed)

    def more() -> np.ndarray:
        root = g.standard_normal((n, n))
        return root @ root.T

    floor = 0.2 * more() + 0.1 * np.eye(n)
    low = floor + more()
    high = low + 2.0 * more()
    sizes, X, E = np.array([[n, 0]]), np.empty(n * (n + 1) // 2), np.empty((n, n))
    G, w = more(), g.standard_normal(n)
    values = np.array([[[concave(low, G, w), 0.0], [concave(high, G, w), 0.0]]])
    values[0, 0, 0] = concave(floor, G, w)  # level 0 of lump 0 is the floor, level 1 the covariance of the lump
    values[0, 0, 1], values[0, 1, 1] = concave(low, G, w), concave(high, G, w)
    seen = set()
    for part in (-1.0, -0.7, -0.3, 0.0, 0.2, 0.45, 0.8, 1.0):
        S = (1 - part) * low + part * high if part >= 0 else (1 + part) * low - part * floor
        S = S * (1 + 1e-6)  # room for rounding
        x = lies(sizes, packed(S), packed(low), packed(high), packed(floor), X, E)
        assert -1.0 <= x <= 1.0 and part - 0.02 <= x <= part + 1e-3
        bound, value = mixed(values, 0, 0, 1, x), concave(S, G, w)
        assert bound <= value * (1 + 1e-9)
        seen.add(np.sign(round(x, 3)))
    assert {-1.0, 1.0} <= seen
    # a covariance that lies above neither is put down to the floor
    assert lies(sizes, packed(floor * (1 + 1e-6)), packed(low), packed(high), packed(floor), X, E) < -0.97
    level, share = place(
        sizes, packed(0.5 * (low + high) * (1 + 1e-6)), np.array([packed(x) for x in (floor, low, high)]), X, E
    )
    assert level == 1 and 0.48 <= share <= 0.501
