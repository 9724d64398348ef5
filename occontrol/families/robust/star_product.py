"""The algebra of span elements (F, Q, R), whose meaning stands in scattering.py: compose, advance, adjoint."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

Element = tuple[np.ndarray, np.ndarray, np.ndarray]


def transpose(a: np.ndarray) -> np.ndarray:
    """The matrices `a` (..., n, n) transposed."""
    return np.swapaxes(a, -1, -2)


def even(a: np.ndarray) -> np.ndarray:
    """The symmetric part of matrices `a` (..., n, n)."""
    return (a + transpose(a)) / 2


def star(first: Element, second: Element) -> Element:
    """The element of `first` followed by `second`.

    With G = (I + Q1 R2)^-1:   F = F2 G F1,   Q = Q2 + F2 G Q1 F2',   R = R1 + F1' R2 G F1
    """
    F1, Q1, R1 = first
    F2, Q2, R2 = second
    G = np.linalg.inv(np.eye(F1.shape[-1]) + Q1 @ R2)
    FG, GF = F2 @ G, G @ F1
    return FG @ F1, even(Q2 + FG @ Q1 @ transpose(F2)), even(R1 + transpose(F1) @ R2 @ GF)


def compose_exists(first: Element, second: Element) -> np.ndarray:
    """Whether P = 0 at the start survives both spans: eigenvalues of Q1 R2 above -1 (without sensors: exact)."""
    values, vectors = np.linalg.eigh(first[1])
    root = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    inner = np.eye(values.shape[-1]) + transpose(root) @ second[2] @ root
    return np.linalg.eigvalsh(inner)[..., 0] > 0


def star_checked(first: Element, second: Element, exists: np.ndarray | None) -> Element:
    """The star product; clears `exists` (T,) where P = 0 escapes, and puts the empty span there."""
    if exists is None:
        return star(first, second)
    lives = compose_exists(first, second)
    exists &= lives if lives.ndim == 1 else np.all(lives, axis=1)
    n = first[0].shape[-1]
    calm = [np.where(lives[..., None, None], part, empty) for part, empty in zip(second, identity(n), strict=True)]
    return star(first, tuple(calm))  # type: ignore[arg-type]


def advance(P: np.ndarray, element: Element) -> np.ndarray:
    """P at the end of the span:  Q + F P (I + R P)^-1 F'   (P (..., n, n) may be singular)."""
    F, Q, R = element
    inner = np.linalg.solve(np.eye(P.shape[-1]) + P @ R, P)
    return even(Q + F @ even(inner) @ transpose(F))


def retreat(P: np.ndarray, weight: np.ndarray, element: Element) -> np.ndarray:
    """Adjoint of `advance`: the gradient before the span of <weight, P after>, at the P before.

    P and `weight` are (..., n, n).
    """
    F, _, R = element
    J = F @ np.linalg.inv(np.eye(P.shape[-1]) + P @ R)
    return even(transpose(J) @ weight @ J)


def identity(n: int, batch: tuple[int, ...] = ()) -> Element:
    """The element of an empty span."""
    return np.broadcast_to(np.eye(n), (*batch, n, n)).copy(), np.zeros((*batch, n, n)), np.zeros((*batch, n, n))


def from_transfer(M: np.ndarray) -> Element:
    """(F, Q, R) from the transfer matrix M (..., 2n, 2n) of the Hamiltonian system."""
    n = M.shape[-1] // 2
    inverse = np.linalg.inv(M[..., n:, n:])
    return transpose(inverse), even(M[..., :n, n:] @ inverse), even(inverse @ M[..., n:, :n])


def exponential(H: np.ndarray) -> np.ndarray:
    """exp of many small H (..., k, k) at once: the [9/9] Pade quotient, exact to rounding for 1-norms up to 2."""
    if np.max(np.sum(np.abs(H), axis=-2), initial=0.0) > 2.0:
        return expm(H)
    c = (17643225600, 8821612800, 2075673600, 302702400, 30270240, 2162160, 110880, 3960, 90, 1)
    one, H2 = np.eye(H.shape[-1]), H @ H
    H4 = H2 @ H2
    H6, H8 = H4 @ H2, H4 @ H4
    odd = H @ (c[9] * H8 + c[7] * H6 + c[5] * H4 + c[3] * H2 + c[1] * one)
    even = c[8] * H8 + c[6] * H6 + c[4] * H4 + c[2] * H2 + c[0] * one
    return np.linalg.solve(even - odd, even + odd)
