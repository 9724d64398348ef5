"""exp(a) and int_0^1 exp(a t) x exp(a t)' dt of many small matrices at once.

    F = sum_k a^k / k!,   Q = sum_k M_k / (k+1)!,   M_0 = x,  M_{k+1} = a M_k + (a M_k)'

over 1/2^s of the span, doubled s times: Q <- F Q F' + Q, F <- F F. Doubling adds positive semidefinite terms only, so a
stiff plant loses nothing, and no matrix of twice the size is needed. Each result depends on its own a and x alone, not
on what else is asked for at the same time.
"""

from __future__ import annotations

import numpy as np

ROUNDING = 2.0**-54
LARGEST = -2  # norms up to 2^-2 are summed, larger ones are halved first
TINY = -16  # norms below 2^-16 are summed as if they were that large
CHAIN = 16  # terms at most, that are summed for the corners of long chains of integrators


def short_flow(a: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F and Q of exponents, as in this file's header.

    Parameters
    ----------
    a : (K, n, n), a rate times the length of its span
    x : (K, n, n), symmetric, a noise intensity times the length

    Returns F (K, n, n) and Q (K, n, n). What overflows is not finite.
    """
    size = np.abs(a)
    norm = np.maximum(np.max(np.sum(size, axis=1), axis=1), np.max(np.sum(size, axis=2), axis=1))
    known = np.isfinite(norm)
    exponent = np.clip(np.frexp(np.where(known, norm, 0.0))[1], TINY, None)
    F, Q = np.empty(a.shape), np.empty(a.shape)
    for e in np.unique(exponent):
        which = np.flatnonzero(exponent == e)
        doublings = max(int(e) - LARGEST, 0)
        f, q = _series(np.ldexp(a[which], -doublings), np.ldexp(x[which], -doublings), min(int(e), LARGEST))
        for _ in range(doublings):
            q = f @ q @ np.swapaxes(f, 1, 2) + q
            f = f @ f
        F[which], Q[which] = f, (q + np.swapaxes(q, 1, 2)) / 2
    F[~known] = Q[~known] = np.nan
    return F, Q


def _terms(exponent: int, states: int) -> int:
    """How many terms leave less than rounding, for norms up to 2^exponent."""
    k, rest = 1, 2.0 ** (exponent + 1) / 2
    while rest > ROUNDING:
        k += 1
        rest *= 2.0 ** (exponent + 1) / (k + 1)
    return max(k, min(2 * states - 1, CHAIN))


def _series(a: np.ndarray, x: np.ndarray, exponent: int) -> tuple[np.ndarray, np.ndarray]:
    power = np.tile(np.eye(a.shape[1]), (len(a), 1, 1))
    F, M, Q = power.copy(), x.copy(), x.copy()
    for k in range(1, _terms(exponent, a.shape[1]) + 1):
        power = a @ power / k
        half = a @ M / (k + 1)
        M = half + np.swapaxes(half, 1, 2)
        F += power
        Q += M
    return F, Q
