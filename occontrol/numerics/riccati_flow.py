"""The Riccati equation as a linear fractional flow in square-root form; no step-size limit from stiff data.

Sigma = Y X^-1 with d/dt [X; Y] = [[-A', L], [Xi, A]] [X; Y]. The transition Z of one step gives three matrices

    G = X_x^-1 X_y,  Q = Y_x X_x^-1,  F = X_x^-T        Sigma+ = Q + F Sigma (I + G Sigma)^-1 F'

G and Q are positive semidefinite; with square roots Gamma' Gamma = G, Sigma = S S' the step needs two QR factorisations
and no inverse of Sigma, so Sigma stays positive semidefinite, may be singular, and may be as large as one likes.
The costate travels as Psi = S' P S (see `march`), which neither overflows nor cancels.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.gauss import NODES, gauss_nodes, integration_matrix
from occontrol.numerics.linalg import square_root, symmetrise

PICARD = 24
TAYLOR = 19


def hamiltonian_matrices(A: np.ndarray, noise: np.ndarray, information: np.ndarray) -> np.ndarray:
    """[[-A', L], [Xi, A]] for (..., n, n) matrices, shape (..., 2n, 2n)."""
    A, noise, information = np.broadcast_arrays(A, noise, information)
    return np.block([[-np.swapaxes(A, -1, -2), information], [noise, A]])


def norms(matrices: np.ndarray) -> np.ndarray:
    """An upper bound of the spectral norm of (..., m, m) matrices."""
    size = np.abs(matrices)
    return np.sqrt(size.sum(axis=-1).max(axis=-1) * size.sum(axis=-2).max(axis=-1))


def balancing(largest: np.ndarray) -> np.ndarray:
    """Powers of two d (n,): in the coordinates x/d the Hamiltonian matrix has (nearly) the least Frobenius norm.

    Parameters
    ----------
    largest : (2n, 2n) absolute values of [[-A', L], [Xi, A]], the largest over time
    """
    n = len(largest) // 2
    A, noise, information = (largest[n:, n:] ** 2, largest[n:, :n] ** 2, largest[:n, n:] ** 2)
    d = np.ones(n)
    for _ in range(60):
        changed = False
        for i in range(n):
            off = np.arange(n) != i
            up = np.sum(A[off, i] * (d[i] / d[off]) ** 2) + np.sum(information[off, i] * (d[i] * d[off]) ** 2)
            down = np.sum(A[i, off] * (d[off] / d[i]) ** 2) + np.sum(noise[i, off] / (d[i] * d[off]) ** 2)
            measured, driven = information[i, i] * d[i] ** 4, noise[i, i] / d[i] ** 4
            here = 2 * up + 2 * down + measured + driven
            for factor in (0.5, 2.0):
                there = 2 * up * factor**2 + 2 * down / factor**2 + measured * factor**4 + driven / factor**4
                if there < 0.9 * here:
                    d[i] *= factor
                    changed = True
                    break
        if not changed:
            break
    return d


def constant_transitions(lengths: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Transitions from each of the points 0, nodes, 1 of a panel to the next, for constant matrices, by Taylor series.

    Parameters
    ----------
    lengths : (P,), with lengths * norms(matrices) <= 1
    matrices : (P, 2n, 2n)

    Returns
    -------
    (P, NODES + 1, 2n, 2n)
    """
    points = np.concatenate([[0.0], gauss_nodes()[0], [1.0]])
    steps = np.diff(points)
    scaled = lengths[:, None, None] * matrices
    power = np.broadcast_to(np.eye(matrices.shape[-1]), matrices.shape)
    total = np.repeat(power[:, None], NODES + 1, axis=1).copy()
    for k in range(1, TAYLOR + 1):
        power = power @ scaled / k
        total += steps[None, :, None, None] ** k * power[:, None]
    return total


def varying_transitions(lengths: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """As `constant_transitions`, for matrices (P, NODES, 2n, 2n) given at the nodes.

    Gauss-Legendre collocation of the linear equation, solved by Picard iteration; lengths * norms <= 1/2.
    """
    size = matrices.shape[-1]
    identity = np.eye(size)
    scaled = lengths[:, None, None, None] * matrices
    _, weights = gauss_nodes()
    rule = np.concatenate([integration_matrix(), weights[None]])
    values = np.broadcast_to(identity, (len(lengths), NODES + 1, size, size))
    for _ in range(PICARD):
        rate = scaled @ values[:, :NODES]
        following = identity + np.einsum("ij,pjab->piab", rule, rate, optimize=True)
        change = np.max(np.abs(following - values)) if len(lengths) else 0.0
        values = following
        if change <= 2e-16:
            break
    n = size // 2
    before = np.concatenate([np.broadcast_to(identity, (len(lengths), 1, size, size)), values[:, :NODES]], axis=1)
    turned = np.swapaxes(before, -1, -2)
    # the inverse of a symplectic matrix
    inverse = np.block([[turned[..., n:, n:], -turned[..., n:, :n]], [-turned[..., :n, n:], turned[..., :n, :n]]])
    return values @ inverse


def fractional_factors(transitions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F, Gamma and B of transitions (..., 2n, 2n): Gamma' Gamma = G and B B' = Q; each (..., n, n)."""
    n = transitions.shape[-1] // 2
    inverse = np.linalg.inv(transitions[..., :n, :n])
    gramian = symmetrise(inverse @ transitions[..., :n, n:])
    driven = symmetrise(transitions[..., n:, :n] @ inverse)
    return np.swapaxes(inverse, -1, -2), np.swapaxes(square_root(gramian), -1, -2), square_root(driven)


@njit(cache=True, nogil=True, error_model="numpy")
def march(S: np.ndarray, E: np.ndarray, F: np.ndarray, gamma: np.ndarray, driven: np.ndarray) -> None:
    """Steps of the square root S of Sigma = S S', and the matrices E that carry the costate back.

    S+ S+' = Q + F Sigma (I + G Sigma)^-1 F',    S' P S = E (S+' P+ S+) E'

    Both factors of E are contractions: P = K' P+ K with K = F (I + Sigma G)^-1 and K S = S+ E'.

    Parameters
    ----------
    S : (K+1, n, n) S[0] is given, the others are filled in
    E : (K, n, n) filled in
    F, gamma, driven : (K, n, n) of the steps, see `fractional_factors`
    """
    K, n = E.shape[0], E.shape[1]
    tall, stacked = np.empty((2 * n, n)), np.empty((2 * n, n))
    for k in range(K):
        tall[:n] = np.eye(n)
        tall[n:] = gamma[k] @ S[k]
        _, upper = np.linalg.qr(tall)
        reduced = np.ascontiguousarray(S[k].T)
        # upper' reduced = S', by forward substitution
        for i in range(n):
            for m in range(i):
                x = upper[m, i]
                for c in range(n):
                    reduced[i, c] -= x * reduced[m, c]
            x = 1.0 / upper[i, i]
            for c in range(n):
                reduced[i, c] *= x
        stacked[:n] = reduced @ F[k].T
        stacked[n:] = driven[k].T
        orthogonal, following = np.linalg.qr(stacked)
        S[k + 1] = following.T
        E[k] = orthogonal[:n]
        # upper E = orthogonal, by back substitution
        for i in range(n - 1, -1, -1):
            for m in range(i + 1, n):
                x = upper[i, m]
                for c in range(n):
                    E[k, i, c] -= x * E[k, m, c]
            x = 1.0 / upper[i, i]
            for c in range(n):
                E[k, i, c] *= x


def closed_loop_transition(covariance: np.ndarray, F: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """K = F (I + Sigma G)^-1 of steps (..., n, n); well conditioned only where a step is not stiff."""
    loop = np.eye(F.shape[-1]) + covariance @ np.swapaxes(gamma, -1, -2) @ gamma
    return np.swapaxes(np.linalg.solve(np.swapaxes(loop, -1, -2), np.swapaxes(F, -1, -2)), -1, -2)
