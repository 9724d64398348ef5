"""Steps of the square root of a covariance, in compiled loops and by LAPACK, against exact fractions."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.numerics import riccati_flow
from tests.numerics.exact_kalman import exact, plus, solve, times, transpose


def far(value, judge, size=()) -> float:
    """The largest difference of two (n, n) of fractions, as a share of the largest entry of the second, or of size."""
    largest = max(abs(x) for row in (*judge, *size) for x in row)
    return float(max(abs(x) for row in plus(value, judge, -1) for x in row) / largest) if largest else 0.0


@pytest.mark.parametrize("small", [0, 8])
@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_steps_are_those_of_the_covariance(n: int, small: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(riccati_flow, "SMALL", small)
    g, count = np.random.default_rng(n), 6
    F, gamma, noise = g.standard_normal((3, count, n, n))
    gamma[1], noise[2] = 0.0, 0.0  # nothing is measured, nothing drives
    gamma[4] *= 1e5  # a precise reading
    F[3] *= 1e6  # much has grown
    root = 1e4 * g.standard_normal((n, n))  # a prior of 1e8
    root[:, -1] = 0.0 if n > 1 else root[:, -1]  # something is known exactly
    Q = noise @ np.swapaxes(noise, 1, 2)
    S, E, K = riccati_flow.march(root, F, gamma, Q)
    P = exact(g.standard_normal((n, n)))
    for k in range(count):
        s, e, f, y, after = (exact(x) for x in (S[k], E[k], F[k], gamma[k], S[k + 1]))
        before, information = times(s, transpose(s)), times(transpose(y), y)
        # the gain of one step is F (I + P Gamma' Gamma)^-1, its covariance Q + F (I + P Gamma' Gamma)^-1 P F'
        through = solve(transpose(plus(exact(np.eye(n)), times(before, information))), transpose(f))
        loop = transpose(through)
        assert far(times(after, transpose(after)), plus(exact(Q[k]), times(times(loop, before), transpose(f)))) <= 1e-12
        assert far(exact(K[k]), loop, f) <= 1e-9  # a difference from F: it has the digits of F
        turned, carried = times(times(transpose(P), loop), s), times(times(transpose(P), after), transpose(e))
        assert far(times(transpose(carried), carried), times(transpose(turned), turned)) <= 1e-9
        assert np.array_equal(S[k + 1], np.tril(S[k + 1]))
