"""The game Riccati equations of robust observability, and the structure behind them.

Letters, as in Savkin, Evans & Skafidas: P shape of the set of possible states (P(0) = X0^-1), Y weight of the center in
the supremum over all measurements, X the same without sensors, N = (P^-1 - X)^-1. A, B, K plant, C the sensor in use.

The paper's (10) and (25) print Y P K'K K'K P Y where the supremum over y gives Y P C'C P Y. With that term Y and P
are tied to X, in which no sensor enters:
    Y = X (I - P X)^-1,      dN/dt = (A + BB'X) N + N (A + BB'X)' - N C'C N + BB',      P = N (I + X N)^-1
so N is an ordinary error covariance, Y(0) is the same for all schedules, and uniform robust observability on [0, T]
means: X exists on [0, T] and X(0) < X0.
"""

from __future__ import annotations

import numpy as np

from occontrol.families.robust.scattering import Element


def _t(a: np.ndarray) -> np.ndarray:
    return np.swapaxes(a, -1, -2)


def shape_rate(P: np.ndarray, A: np.ndarray, B: np.ndarray, K: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Rate of the shape of the set of possible states.

    dP/dt = A P + P A' + P (K'K - C'C) P + B B',   P(0) = X0^-1

    Parameters
    ----------
    P : (n, n) symmetric, [state unit]^2
    A, B, K, C : (n, n), (n, p), (q, n), (m, n) at the same time

    Savkin, Evans & Skafidas, equations (4), (17).
    """
    return A @ P + P @ A.T + P @ (K.T @ K - C.T @ C) @ P + B @ B.T


def center_rate(
    x: np.ndarray, y: np.ndarray, P: np.ndarray, A: np.ndarray, K: np.ndarray, C: np.ndarray
) -> tuple[np.ndarray, float]:
    """Rates of the center and of the energy that the measurements leave.

    dx/dt = [A + P (K'K - C'C)] x + P C' y,      d rho/dt = |K x|^2 - |C x - y|^2

    Parameters
    ----------
    x, y : (n,) center, (m,) measurement
    P, A, K, C : (n, n), (n, n), (q, n), (m, n) at the same time

    Savkin, Evans & Skafidas, equations (5), (7), (18).
    """
    miss = C @ x - y
    z = K @ x
    return A @ x + P @ (K.T @ z - C.T @ miss), float(z @ z - miss @ miss)


def center_weight_rate(Y: np.ndarray, P: np.ndarray, A: np.ndarray, K: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Rate of the weight of the center in the supremum over all measurements.

    -dY/dt = (A + P K'K)'Y + Y (A + P K'K) + K'K + Y P C'C P Y,   Y(T) = 0

    Parameters
    ----------
    Y, P : (n, n) symmetric
    A, K, C : (n, n), (q, n), (m, n) at the same time

    Savkin, Evans & Skafidas, equations (10), (25), with C'C where the paper prints K'K K'K.
    """
    moved = A + P @ K.T @ K
    return -(moved.T @ Y + Y @ moved + K.T @ K + Y @ P @ C.T @ C @ P @ Y)


def center_weight(X: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Y = X (I - P X)^-1, (..., n, n); at the start P = X0^-1 and no schedule enters."""
    Y = X @ np.linalg.inv(np.eye(X.shape[-1]) - P @ X)
    return (Y + _t(Y)) / 2


def ordinary_start(weight: np.ndarray, X: np.ndarray) -> np.ndarray:
    """N(0) = (X0 - X(0))^-1 (n, n) from `weight` X0 (n, n) and X(0) (n, n); needs X(0) < X0."""
    N = np.linalg.inv(weight - X)
    return (N + N.T) / 2


def from_ordinary(N: np.ndarray, X: np.ndarray) -> np.ndarray:
    """P = N (I + X N)^-1, (..., n, n)."""
    P = N @ np.linalg.inv(np.eye(N.shape[-1]) + X @ N)
    return (P + _t(P)) / 2


def ordinary_elements(element: Element, X_start: np.ndarray, X_end: np.ndarray) -> Element:
    """The span element of N from that of P, with X at both ends of the span: X_start, X_end (..., n, n).

    F_N = (I - Q X1)^-1 F,   Q_N = (I - Q X1)^-1 Q,   R_N = X0 + R - F' X1 (I - Q X1)^-1 F
    """
    F, Q, R = element
    G = np.linalg.inv(np.eye(F.shape[-1]) - Q @ X_end)
    FN, QN = G @ F, G @ Q
    RN = X_start + R - _t(F) @ X_end @ FN
    return FN, (QN + _t(QN)) / 2, (RN + _t(RN)) / 2
