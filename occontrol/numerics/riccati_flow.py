"""The Riccati equation as a linear fractional flow in square-root form; no step-size limit from stiff data.

Sigma = Y X^-1 with d/dt [X; Y] = H [X; Y], H = [[-A', L], [Xi, A]]. The transition Z of one step gives three matrices

    G = X_x^-1 X_y,  Q = Y_x X_x^-1,  F = X_x^-T        Sigma+ = Q + F Sigma (I + G Sigma)^-1 F'

G and Q are positive semidefinite; with square roots Gamma' Gamma = G, Sigma = S S' the step needs two QR factorisations
and no inverse of Sigma, so Sigma stays positive semidefinite, may be singular, and may be as large as one likes.
A costate P = V' V, P+ = V+' V+ of few rows is carried back by V = V+ K and, without cancellation, by g = S' V'
(see `march`); between two steps [V'; Sigma V'] obeys the same linear equation as [X; Y].
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from occontrol.numerics.linalg import square_root, symmetrise
from occontrol.numerics.riccati_march import march_small

MOST_TERMS = 60
BLOCK_BYTES = 1e6
STIFF = 1e3
SMALL = 8  # states up to which compiled loops are faster than LAPACK


def hamiltonian_matrices(A: np.ndarray, noise: np.ndarray, information: np.ndarray) -> np.ndarray:
    """[[-A', L], [Xi, A]] (..., 2n, 2n) for A, `noise` Xi and `information` L (..., n, n)."""
    A, noise, information = np.broadcast_arrays(A, noise, information)
    return np.block([[-np.swapaxes(A, -1, -2), information], [noise, A]])


def norms(matrices: np.ndarray) -> np.ndarray:
    """An upper bound of the spectral norm of `matrices` (..., m, m)."""
    size, ones = np.abs(matrices), np.ones(matrices.shape[-1])
    return np.sqrt(np.max(size @ ones, axis=-1) * np.max(ones @ size, axis=-1))


def term_count(sizes: np.ndarray) -> int:
    """How many terms of the power series of the flow matter to double precision.

    Parameters
    ----------
    sizes : (D,) norms of the coefficients of H, see `flow_series`
    """
    terms = [1.0]
    while len(terms) < MOST_TERMS and max(terms[-len(sizes) :]) > 1e-17:
        terms.append(sum(s * c for s, c in zip(sizes, reversed(terms), strict=False)) / len(terms))
    return len(terms)


def flow_series(H: np.ndarray, start: np.ndarray, count: int) -> list[np.ndarray]:
    """Coefficients in powers of t of the solution of dz/dt = (H_0 + H_1 t + ..) z, z(0) = start.

    (k + 1) z_{k+1} = sum_j H_j z_{k-j}

    Parameters
    ----------
    H : (P, D, m, m) polynomials on [0, 1];  start : (P, m, c);  count : see `term_count`

    Returns
    -------
    list of `count` arrays (P, m, c)
    """
    terms = [start]
    for k in range(1, count):
        following = H[:, 0] @ terms[-1]
        for j in range(1, min(k, H.shape[1])):
            following += H[:, j] @ terms[k - 1 - j]
        terms.append(following / k)
    return terms


def transitions(H: np.ndarray) -> np.ndarray:
    """(P, m, m) transitions from 0 to 1 for polynomials H (P, D, m, m)."""
    count, m = term_count(np.max(norms(H), axis=0, initial=0.0)), H.shape[-1]
    found = np.empty((len(H), m, m))
    block = max(1, int(BLOCK_BYTES / (8 * m * m)))
    for first in range(0, len(H), block):
        part = slice(first, first + block)
        identity = np.broadcast_to(np.eye(m), found[part].shape)
        found[part] = sum(reversed(flow_series(H[part], identity, count)))
    return found


def values_at(times: np.ndarray, terms: list[np.ndarray]) -> np.ndarray:
    """The series `terms` (each (P, ...)) at `times` (T,) in [0, 1], (P, T, ...)."""
    powers = np.vander(times, len(terms), increasing=True)
    flat = powers @ np.reshape(terms, (len(terms), -1))
    return np.moveaxis(flat.reshape(len(times), *terms[0].shape), 0, 1)


def fractional(transition: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F, G and Q, each (..., n, n), of `transition` (..., 2n, 2n)."""
    n = transition.shape[-1] // 2
    inverse = np.linalg.inv(transition[..., :n, :n])
    gramian = symmetrise(inverse @ transition[..., :n, n:])
    return np.swapaxes(inverse, -1, -2), gramian, symmetrise(transition[..., n:, :n] @ inverse)


def march(
    root: np.ndarray, F: np.ndarray, gamma: np.ndarray, Q: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps of the square root S of Sigma = S S', and the matrices that carry a costate back.

    S+ S+' = Q + F Sigma (I + G Sigma)^-1 F',    P = K' P+ K,    S' P S = E (S+' P+ S+) E'

    K = F (I + Sigma G)^-1 is the closed loop and K S = S+ E'; E is a product of two contractions.

    Parameters
    ----------
    root : (n, n) S at the start;  F, gamma, Q : (k, n, n) of the steps, see `fractional`, with Gamma' Gamma = G

    Returns
    -------
    S (k+1, n, n), E (k, n, n), K (k, n, n)
    """
    count, n = F.shape[:2]
    driven = np.swapaxes(square_root(Q), -1, -2)
    S, E, reduced = np.empty((count + 1, n, n)), np.empty_like(F), np.empty_like(F)
    S[0] = root
    if n <= SMALL:
        given, space = map(np.ascontiguousarray, (F, gamma, driven)), np.empty((3, 2 * n, n))
        march_small(*given, S, E, reduced, *space, np.empty(n))
        return S, E, closed_loop(reduced, F, np.swapaxes(gamma, -1, -2) @ gamma)
    tall, stacked = np.zeros((2 * n, n), order="F"), np.empty((2 * n, n), order="F")
    identity, lower = np.eye(n), np.tri(n)
    for k in range(count):
        tall[:n] = identity
        tall[n:] = gamma[k] @ S[k]
        upper = lapack.dgeqrf(tall, lwork=32 * n)[0][:n]
        reduced[k] = lapack.dtrtrs(upper, S[k].T, trans=1)[0]
        stacked[:n] = reduced[k] @ F[k].T
        stacked[n:] = driven[k]
        following, tau, _, _ = lapack.dgeqrf(stacked, lwork=32 * n)
        S[k + 1] = following[:n].T * lower
        orthogonal = lapack.dorgqr(following, tau, lwork=32 * n)[0]
        E[k] = lapack.dtrtrs(upper, orthogonal[:n])[0]
    return S, E, closed_loop(reduced, F, np.swapaxes(gamma, -1, -2) @ gamma)


def reduced_roots(S: np.ndarray, G: np.ndarray) -> np.ndarray:
    """X with X' X = Sigma (I + G Sigma)^-1 for Sigma = S S'; all (..., n, n)."""
    turned = np.swapaxes(S, -1, -2)
    inner = turned @ G @ S
    identity = np.eye(S.shape[-1])
    # where Sigma G is large its square root is factorised instead, as `march` does: I + inner has lost the identity
    stiff = np.trace(inner, axis1=-2, axis2=-1) > STIFF
    inner[stiff] = 0.0
    lower = np.linalg.cholesky(identity + symmetrise(inner))
    if np.any(stiff):
        gamma = np.swapaxes(square_root(G[stiff]), -1, -2)
        tall = np.concatenate([np.broadcast_to(identity, gamma.shape), gamma @ np.broadcast_to(S, G.shape)[stiff]], -2)
        lower[stiff] = np.swapaxes(np.linalg.qr(tall, mode="r"), -1, -2)
    return np.linalg.solve(lower, turned)


def covariance_after(reduced: np.ndarray, F: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Sigma+ of steps; `reduced` (from `reduced_roots`), F and Q are (..., n, n), as is the result."""
    half = reduced @ np.swapaxes(F, -1, -2)
    return Q + np.swapaxes(half, -1, -2) @ half


def closed_loop(reduced: np.ndarray, F: np.ndarray, G: np.ndarray) -> np.ndarray:
    """K = F (I + Sigma G)^-1 of steps; `reduced` (from `reduced_roots`), F and G are (..., n, n)."""
    return F - np.swapaxes(reduced @ np.swapaxes(F, -1, -2), -1, -2) @ (reduced @ G)
