"""What one step for ever can be: the letters of words, in units in which the smallest covariance is the identity.

A letter is one choice of sensors, kept for one step. Whatever the clock (steps, samples, continuous sensing), it acts
on the prior covariance S, or the prior information Y = S^-1, as

    S' = Q + F (Y + L)^-1 F',      charge(Y) = constant + sum_i tr(M_i (Y + O_i)^-1),     L, O_i, M_i >= 0

so S' grows with S, Y' is operator-concave in Y, and every charge is convex in Y and falls with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import InfeasibleError
from occontrol.numerics.linalg import symmetrise

SINGULAR = 1e-10  # smallest eigenvalue of a correlation matrix that noise of the plant reaches


@dataclass(frozen=True, eq=False)
class Letters:
    """The A choices that there are at every step.

    Parameters
    ----------
    F : (A, n, n) transition
    Q : (A, n, n) noise
    L : (A, n, n) information that is gained
    seen : (A, C, n, n) O_i, information after which the C parts of a charge are taken
    weight : (A, C, n, n) M_i, their weights
    constant : (A,) the rest of the charge, prices of sensors among it
    """

    F: np.ndarray
    Q: np.ndarray
    L: np.ndarray
    seen: np.ndarray
    weight: np.ndarray
    constant: np.ndarray

    @property
    def count(self) -> int:
        """The number A of letters."""
        return len(self.F)

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.F.shape[1]

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """The six arrays, contiguous, as the compiled loops take them."""
        fields = (self.F, self.Q, self.L, self.seen, self.weight, self.constant)
        return tuple(np.ascontiguousarray(a, dtype=float) for a in fields)

    @property
    def shares_plant(self) -> bool:
        """Whether F, Q and the weights are the same for all letters, so that letters can be averaged."""
        return all(np.all(a == a[:1]) for a in (self.F, self.Q, self.weight))

    def step(self, S: np.ndarray, letter: int) -> tuple[np.ndarray, float]:
        """The next prior covariance (n, n) and the charge of one step.

        Parameters
        ----------
        S : (n, n) prior covariance, also a singular one
        letter : which
        """
        eye, charge = np.eye(self.states), float(self.constant[letter])
        for seen, weight in zip(self.seen[letter], self.weight[letter], strict=True):
            charge += float(np.vdot(weight, np.linalg.solve(eye + S @ seen, S)))
        after = symmetrise(np.linalg.solve(eye + S @ self.L[letter], S))
        F = self.F[letter]
        return symmetrise(F @ after @ F.T + self.Q[letter]), charge

    def in_units(self, root: np.ndarray) -> Letters:
        """The same letters in the coordinates z, x = root z.

        Parameters
        ----------
        root : (n, n) nonsingular
        """
        inverse = np.linalg.inv(root)
        return Letters(
            inverse @ self.F @ root,
            symmetrise(inverse @ self.Q @ inverse.T),
            symmetrise(root.T @ self.L @ root),
            symmetrise(root.T @ self.seen @ root),
            symmetrise(root.T @ self.weight @ root),
            self.constant,
        )


def smallest_covariance(F: np.ndarray, Q: np.ndarray, everything: np.ndarray) -> np.ndarray:
    """The steady prior covariance with every sensor on at once: in the long run no schedule comes below it.

    Parameters
    ----------
    F, Q : (n, n) of one step
    everything : (n, n) information of one step with all sensors

    Returns (n, n), positive definite. Raises InfeasibleError where the covariance grows beyond all numbers, or where
    the noise of the plant does not reach every state, so that it falls to nothing.
    """
    from occontrol.scheduling.periodic.steady import settle

    n = len(F)
    reached, power = np.zeros(n), Q
    for _ in range(n):
        reached += np.diag(power)
        power = symmetrise(F @ power @ F.T)
    if np.any(reached <= 0):
        raise InfeasibleError(_unreached([f"x{i + 1}" for i in np.flatnonzero(reached <= 0)]))
    root = np.sqrt(reached)
    f, q, m = F * root / root[:, None], Q / np.outer(root, root), everything * np.outer(root, root)
    S, settled = settle(f[None].copy(), q[None], m[None], np.zeros(1, dtype=np.int64), np.eye(n))
    if not settled:
        raise InfeasibleError(_unseen(f, m))
    scale = np.sqrt(np.diag(S))
    values, vectors = np.linalg.eigh(S / np.outer(scale, scale))
    if values[0] < SINGULAR:
        raise InfeasibleError(_unreached([f"x{i + 1}" for i in np.flatnonzero(np.abs(vectors[:, 0]) > 0.1)]))
    return symmetrise(S * np.outer(root, root))


def _unreached(states: list[str]) -> str:
    what = f"the noise of the plant does not reach every state ({', '.join(states)})"
    why = "with measurements for ever the covariance falls to nothing there"
    return f"{what}: {why}\n  hint: leave these states out, or give them some noise"


def _unseen(F: np.ndarray, everything: np.ndarray) -> str:
    """Which modes grow, or stay, and are seen by no sensor."""
    lost = []
    for value in np.linalg.eigvals(F):
        stacked = np.vstack([F - value * np.eye(len(F)), everything / max(float(np.max(np.abs(everything))), 1e-300)])
        if abs(value) > 1 - 1e-9 and np.linalg.svd(stacked, compute_uv=False)[-1] < 1e-9 * np.linalg.norm(stacked):
            lost.append(f"{abs(value):.4g}")
    modes = f" (growth a step: {', '.join(sorted(set(lost)))})" if lost else ""
    what = f"no schedule keeps the covariance bounded for ever: no sensor sees a mode of the plant that stays{modes}"
    return f"{what}\n  hint: add a sensor that sees it, or leave the mode out"
