"""One step of the (extended) Kalman filter for many runs at once; covariances by Joseph's form.

P- = F P F' + Q,   S = H P- H' + R,   K = P- H' S^-1,   x+ = x + K (z - h(x)),
P+ = (I - K H) P- (I - K H)' + K R K'
"""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.replanning.chain import Seen, product


def predicted(covariance: np.ndarray, F: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """F P F' + Q of B runs; `covariance`, `F`, `Q` (B, n, n)."""
    moved = F @ covariance @ np.swapaxes(F, 1, 2) + Q
    return (moved + np.swapaxes(moved, 1, 2)) / 2


def updated(
    mean: np.ndarray, covariance: np.ndarray, seen: Seen, reading: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (B, n), covariance (B, n, n) and NIS (B,) after a reading of every run.

    Parameters
    ----------
    mean, covariance : (B, n), (B, n, n) before it
    seen : what the sensor should report of `mean`
    reading : (B, m)
    angles : (m,) whose differences are taken between -pi and pi
    """
    H, R = seen.slope, seen.noise
    error = reading - seen.value
    error = np.where(angles, np.mod(error + np.pi, 2 * np.pi) - np.pi, error)
    cross = covariance @ np.swapaxes(H, 1, 2)
    S = H @ cross + R
    gain = np.swapaxes(np.linalg.solve(S, np.swapaxes(cross, 1, 2)), 1, 2)
    nis = np.sum(error * np.linalg.solve(S, error[:, :, None])[:, :, 0], axis=1)
    rest = np.eye(mean.shape[1]) - gain @ H
    found = rest @ covariance @ np.swapaxes(rest, 1, 2) + gain @ R @ np.swapaxes(gain, 1, 2)
    return mean + product(gain, error), (found + np.swapaxes(found, 1, 2)) / 2, nis


def squared(error: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(B,) e' R e of B errors, `error` (B, n), and one `weight` (n, n)."""
    return np.sum(error * product(np.broadcast_to(weight, (len(error), *weight.shape)), error), axis=1)


def normalised(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(B,) e' P^-1 e / n; what P leaves no room for counts where e is not zero there.

    `error` (B, n), `covariance` (B, n, n). A state that is known exactly (a parameter of no deviation) has no part.
    """
    scale = np.sqrt(np.maximum(np.einsum("bii->bi", covariance), 0.0))
    known = scale <= 0
    safe = np.where(known, 1.0, scale)
    correlation = covariance / (safe[:, :, None] * safe[:, None, :])
    index = np.arange(covariance.shape[1])
    correlation[:, index, index] = np.where(known, 1.0, correlation[:, index, index]) + 1e-13
    e = np.where(known, 0.0, error / safe)
    found = np.sum(e * np.linalg.solve(correlation, e[:, :, None])[:, :, 0], axis=1)
    return found / np.maximum(np.sum(~known, axis=1), 1)
