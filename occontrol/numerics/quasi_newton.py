"""Limited-memory BFGS as an operator: products B d of the compact form (Byrd, Nocedal & Schnabel 1994)."""

from __future__ import annotations

import numpy as np


class CompactBFGS:
    """B = theta I - [theta S, Y] [[theta S'S, L], [L', -D]]^-1 [theta S, Y]' from the last `memory` pairs.

    Parameters
    ----------
    memory : how many pairs are kept
    theta : curvature before the first pair
    """

    def __init__(self, memory: int = 15, theta: float = 1e-3):
        self.memory, self.theta, self.start = memory, theta, theta
        self.reset()

    def reset(self) -> None:
        """Forget all pairs."""
        self.S: list[np.ndarray] = []
        self.Y: list[np.ndarray] = []
        self._middle: np.ndarray | None = None

    def update(self, s: np.ndarray, y: np.ndarray) -> None:
        """Take the pair step s, gradient change y; skipped unless s.y is clearly positive."""
        sy, yy = float(np.vdot(s, y)), float(np.vdot(y, y))
        if not sy > 1e-12 * np.sqrt(float(np.vdot(s, s)) * yy):
            return
        self.S.append(s.ravel().copy())
        self.Y.append(y.ravel().copy())
        if len(self.S) > self.memory:
            del self.S[0], self.Y[0]
        self.theta = yy / sy
        S, Y = np.array(self.S), np.array(self.Y)
        SY = S @ Y.T
        D, L = np.diag(np.diag(SY)), np.tril(SY, -1)
        self._W = np.concatenate([self.theta * S, Y])
        self._middle = np.linalg.pinv(np.block([[self.theta * S @ S.T, L], [L.T, -D]]))

    def product(self, d: np.ndarray) -> np.ndarray:
        """B d, of the shape of d."""
        if self._middle is None:
            return self.theta * d
        flat = d.ravel()
        return (self.theta * flat - self._W.T @ (self._middle @ (self._W @ flat))).reshape(d.shape)
