"""Steps of the square root of a covariance: what they stand for, in compiled loops and by LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.numerics import riccati_flow


@pytest.mark.parametrize("small", [0, 8])
@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_steps_are_those_of_the_covariance(n: int, small: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(riccati_flow, "SMALL", small)
    g, count = np.random.default_rng(n), 6
    F, gamma, noise = g.standard_normal((3, count, n, n))
    gamma[1], noise[2] = 0.0, 0.0  # nothing is measured, nothing drives
    F[3] *= 100.0
    root = g.standard_normal((n, n))
    root[:, -1] = 0.0 if n > 1 else root[:, -1]  # something is known exactly
    Q = noise @ np.swapaxes(noise, 1, 2)
    S, E, K = riccati_flow.march(root, F, gamma, Q)
    P = g.standard_normal((n, n))
    for k in range(count):
        before, G = S[k] @ S[k].T, gamma[k].T @ gamma[k]
        loop = F[k] @ np.linalg.inv(np.eye(n) + before @ G)
        after = Q[k] + loop @ before @ F[k].T
        assert S[k + 1] @ S[k + 1].T == pytest.approx(after, rel=1e-9, abs=1e-10 * np.max(np.abs(after)))
        assert K[k] == pytest.approx(loop, rel=1e-6, abs=1e-8 * np.max(np.abs(loop)))
        turned = S[k].T @ loop.T @ P @ P.T @ loop @ S[k]
        carried = E[k] @ S[k + 1].T @ P @ P.T @ S[k + 1] @ E[k].T
        assert carried == pytest.approx(turned, rel=1e-6, abs=1e-7 * np.max(np.abs(turned)))
        assert np.array_equal(S[k + 1], np.tril(S[k + 1]))
