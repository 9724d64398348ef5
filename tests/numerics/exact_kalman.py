"""A Kalman filter in rational arithmetic: no rounding at all, for judging the ones that round."""

from __future__ import annotations

from fractions import Fraction

import numpy as np


def exact(matrix):
    """The floating-point numbers of a matrix as fractions, nested lists."""
    return [[Fraction(float(e)) for e in row] for row in np.atleast_2d(matrix)]


def times(a, b):
    """a b."""
    columns = list(zip(*b, strict=True))
    return [[sum((x * y for x, y in zip(row, column, strict=True)), Fraction(0)) for column in columns] for row in a]


def plus(a, b, sign=1):
    """a + sign b."""
    return [[x + sign * y for x, y in zip(r, s, strict=True)] for r, s in zip(a, b, strict=True)]


def transpose(a):
    """a'."""
    return [list(row) for row in zip(*a, strict=True)]


def solve(a, b):
    """a^-1 b by Gauss-Jordan elimination."""
    n = len(a)
    work = [list(row) + list(right) for row, right in zip(a, b, strict=True)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda r: abs(work[r][i]))
        work[i], work[pivot] = work[pivot], work[i]
        work[i] = [x / work[i][i] for x in work[i]]
        for r in range(n):
            if r != i and work[r][i]:
                factor = work[r][i]
                work[r] = [x - factor * y for x, y in zip(work[r], work[i], strict=True)]
    return [row[n:] for row in work]


def step(P, F, Q, H, R, S):
    """Gain, innovation covariance and next covariance with noises of joint covariance [[Q, S], [S', R]]."""
    seen = times(H, P)
    Y = plus(times(seen, transpose(H)), R)
    across = plus(times(times(F, P), transpose(H)), S)
    gain = transpose(solve(Y, transpose(across)))
    after = plus(plus(times(times(F, P), transpose(F)), Q), times(gain, transpose(across)), -1)
    return gain, Y, after


def rounded(a, digits=60):
    """The same with numerators cut to about `digits` decimal digits, so that long runs stay affordable."""
    scale = Fraction(10) ** digits
    return [[Fraction(round(x * scale), 1) / scale for x in row] for row in a]


def floats(a):
    """Back to floating point."""
    return np.array([[float(e) for e in row] for row in a])
