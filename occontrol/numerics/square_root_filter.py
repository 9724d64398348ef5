"""The Kalman filter in square-root form, compiled: what every discrete filter of the house does with a covariance.

Unknown: a root S (n, n) of the covariance, P = S S', not always a triangle. A covariance is formed for the reader
only, so it cannot lose symmetry or definiteness, whatever the data. One array holds all that is uncertain, one column
for each independent source of it (the states before, then the noise), and reflections make it a lower triangle:

    [H S, V]           [D   0 ]
    [F S, W] Theta  =  [X   S+],     D D' = H P H' + R,   X = K D,   S+ S+' = P+,     cov [w; v] = [W; V] [W; V]'

Columns change places so that every reflection starts from the largest entry of its row: then columns of very different
size (a prior of 1e16 beside a sensor of 1e-12) keep their own relative accuracy.
Source: Kailath, Sayed & Hassibi, Linear Estimation, section 12.3; Cox & Higham (1998) for the interchanges.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.loops import copy_matrix, multiply

OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz", "reassoc"}}


@njit(**OPTIONS)
def triangularise(array: np.ndarray, count: int) -> None:
    """Make the first `count` rows of an array a lower triangle by an orthogonal change of its columns, in place.

    Parameters
    ----------
    array : (r, s) C-ordered; afterwards array @ array' is what it was
    count : how many rows, at most r; the rows below keep columns that are no triangle
    """
    rows, columns = array.shape
    for c in range(min(count, columns)):
        v = array[c]
        best, at = 0.0, c
        for i in range(c, columns):
            size = abs(v[i])
            if size > best:
                best, at = size, i
        if best == 0.0:
            continue
        if at != c:
            for j in range(rows):
                array[j, c], array[j, at] = array[j, at], array[j, c]
        total = 0.0
        for i in range(c, columns):
            x = v[i] / best
            total += x * x
        alpha = -best * np.sqrt(total) if v[c] > 0.0 else best * np.sqrt(total)
        head = v[c] - alpha
        scale = head / alpha
        v[c] = 1.0
        for i in range(c + 1, columns):
            v[i] /= head
        u = v[c:]
        j = c + 1
        while j + 2 <= rows:  # two rows at a time: u is read once for both
            p, q = array[j, c:], array[j + 1, c:]
            a, b = 0.0, 0.0
            for i in range(len(u)):
                x = u[i]
                a += x * p[i]
                b += x * q[i]
            a, b = a * scale, b * scale
            for i in range(len(u)):
                x = u[i]
                p[i] += a * x
                q[i] += b * x
            j += 2
        if j < rows:
            p = array[j, c:]
            a = 0.0
            for i in range(len(u)):
                a += u[i] * p[i]
            a *= scale
            for i in range(len(u)):
                p[i] += a * u[i]
        v[c] = alpha
        for i in range(c + 1, columns):
            v[i] = 0.0


@njit(**OPTIONS)
def predict(root: np.ndarray, transition: np.ndarray, noise_root: np.ndarray) -> np.ndarray:
    """S+ (n, n), lower triangular, of F P F' + G G'.

    [F S, G] Theta = [S+, 0]

    Parameters
    ----------
    root : (n, n) S with P = S S'
    transition : (n, n) F
    noise_root : (n, p) G
    """
    n, p = noise_root.shape
    array = np.empty((n, n + p))
    multiply(transition, root, array[:, :n])
    copy_matrix(noise_root, array[:, n:])
    triangularise(array, n)
    return array[:, :n].copy()


@njit(**OPTIONS)
def update(root: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Take a whitened measurement y = C x + v with cov v = I into a root.

    [C S, I; S, 0] Theta = [D, 0; X, S+]

    Parameters
    ----------
    root : (n, n) S with P = S S'
    rows : (m, n) C = R^{-1/2} H

    Returns S+ (n, n), X = K D (n, m) and the innovation's root D (m, m), lower triangular: D D' = I + C P C'. The gain
    is K = X D^-1; with the whitened innovation D^-1 (y - C x) the mean moves by X times it, and its square is the
    normalised innovation squared.
    """
    m, n = rows.shape
    array = np.zeros((m + n, n + m))
    multiply(rows, root, array[:m, :n])
    copy_matrix(root, array[m:, :n])
    for i in range(m):
        array[i, n + i] = 1.0
    triangularise(array, m)
    return array[m:, m:].copy(), array[m:, :m].copy(), array[:m, :m].copy()


@njit(**OPTIONS)
def advance(
    root: np.ndarray, transition: np.ndarray, rows: np.ndarray, noise_root: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reading and transition in one, plant noise and reading noise correlated: the header's array.

    x+ = F x + w,   z = H x + v,   cov [v; w] = N N'

    Parameters
    ----------
    root : (n, n) S with P = S S'
    transition : (n, n) F
    rows : (m, n) H; m = 0 where nothing was read
    noise_root : (m + n, s) N with s >= m, the rows of the reading first

    Returns S+ (n, n), lower triangular, X = K D (n, m) and the innovation's root D (m, m), as `update` does.
    """
    m, n = rows.shape
    array = np.empty((m + n, n + noise_root.shape[1]))
    multiply(rows, root, array[:m, :n])
    multiply(transition, root, array[m:, :n])
    copy_matrix(noise_root, array[:, n:])
    triangularise(array, m + n)
    return array[m:, m : m + n].copy(), array[m:, :m].copy(), array[:m, :m].copy()


@njit(**OPTIONS)
def whitened(innovation_root: np.ndarray, innovation: np.ndarray) -> np.ndarray:
    """D^-1 e (m,) by forward substitution; its square is the normalised innovation squared.

    Parameters
    ----------
    innovation_root : (m, m) D, lower triangular
    innovation : (m,) e
    """
    white = innovation.copy()
    for i in range(len(white)):
        for j in range(i):
            white[i] -= innovation_root[i, j] * white[j]
        white[i] /= innovation_root[i, i]
    return white


@njit(**OPTIONS)
def gain_of(normalised: np.ndarray, innovation_root: np.ndarray) -> np.ndarray:
    """The gain K (n, m) = X D^-1 of a step.

    Parameters
    ----------
    normalised : (n, m) X
    innovation_root : (m, m) D, lower triangular
    """
    gain = normalised.copy()
    for j in range(len(innovation_root) - 1, -1, -1):
        for l in range(len(gain)):  # noqa: E741
            for i in range(j + 1, len(innovation_root)):
                gain[l, j] -= gain[l, i] * innovation_root[i, j]
            gain[l, j] /= innovation_root[j, j]
    return gain


@njit(**OPTIONS)
def condition(root: np.ndarray) -> float:
    """About ||S|| ||S^-1|| of a lower triangle; seldom too small by more than a factor of ten, inf where singular.

    S x = b with every b_i = 1 or -1, whichever makes x_i the larger (Cline, Moler, Stewart & Wilkinson 1979).

    Parameters
    ----------
    root : (n, n) S, lower triangular
    """
    n = len(root)
    largest, answer = 0.0, 0.0
    x = np.empty(n)
    for i in range(n):
        carried, size = 0.0, 0.0
        for j in range(i):
            carried += root[i, j] * x[j]
            size += root[i, j] * root[i, j]
        d = root[i, i]
        if d == 0.0:
            return np.inf
        x[i] = (-1.0 - carried if carried > 0.0 else 1.0 - carried) / d
        answer = max(answer, abs(x[i]))
        largest = max(largest, size + d * d)
    return np.sqrt(largest) * answer
