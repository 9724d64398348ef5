"""What readings of a plant without noise tell of the state at its start, a vector of constant parameters.

A reading of row h at step k is one of h Phi_k there, with Phi_k the product of the transitions so far. Directions that
no reading sees are left out where no output needs them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.scheduling.recursion import Recursion

UNSEEN = 1e-13  # of the largest eigenvalue of the correlations: a direction without information
NEEDED = 1e-9  # of an output's row: a part that counts


@dataclass(frozen=True, eq=False)
class Seen:
    """What readings tell of the state at the start.

    Parameters
    ----------
    rows : (N, M, r, n) rows of every decision and sensor, zeros where a sensor has fewer
    output : (p, n) the outputs at the end as functions of the state at the start
    across : (n, d) from the start to the end; d = n where nothing of the start is known
    """

    rows: np.ndarray
    output: np.ndarray
    across: np.ndarray

    @property
    def information(self) -> np.ndarray:
        """(N, M, n, n) L"""
        return np.einsum("kjri,kjrm->kjim", self.rows, self.rows, optimize=True)

    def of(self, unknown: np.ndarray) -> Seen:
        """The same where the start is known but for the states that are `unknown` (n,)."""
        return Seen(self.rows[..., unknown], self.output[:, unknown], self.across[:, unknown])


def seen_from_start(recursion: Recursion, output: np.ndarray) -> Seen:
    """The readings and the outputs of a recursion without noise, in terms of the state at its start.

    Parameters
    ----------
    recursion : Recursion of readings
    output : (p, n) D on the last covariance
    """
    r = recursion
    K, n, first = len(r.steps), r.states, r.first_steps
    widest = int(np.max(np.diff(r.offsets), initial=0))
    longest = int(np.max(np.diff(np.append(first, K))))
    rows = np.zeros((r.intervals, r.sensors, widest * longest, n))
    owner = np.arange(K) if r.owner is None else r.owner
    across = np.eye(n)
    for k in range(K):
        across = r.transition[r.predict[k]] @ across
        place = (k - first[owner[k]]) * widest
        for j in range(r.sensors):
            a, b = r.offsets[j], r.offsets[j + 1]
            rows[owner[k], j, place : place + b - a] = np.sqrt(r.steps[k]) * r.rows[r.row_set[k]][a:b] @ across
    across = r.transition[r.predict[K]] @ across
    return Seen(rows, output @ across, across)


class Unseen(ValueError):
    """An output needs a direction of the state that no reading sees; `direction` (n,) is one of them."""

    def __init__(self, direction: np.ndarray):
        super().__init__("no reading sees a direction that an output needs")
        self.direction = direction


def reduced(seen: Seen, available: np.ndarray) -> tuple[np.ndarray, Seen]:
    """The directions (n, d) that readings see, and rows and outputs in terms of them alone.

    Parameters
    ----------
    seen : Seen
    available : (N, M) positive where a sensor may be used

    Raises Unseen where an output needs another direction.
    """
    n = seen.rows.shape[-1]
    rows = seen.rows[available > 0].reshape(-1, n)
    scale = np.sqrt(np.sum(rows**2, axis=0))
    safe = np.where(scale > 0, scale, 1.0)
    _, sizes, basis = np.linalg.svd(np.vstack([rows / safe, np.zeros((n, n))]), full_matrices=False)
    lost = ~(sizes**2 > UNSEEN * max(float(sizes[0]) ** 2, 1e-300))
    if not np.any(lost):
        return np.eye(n), seen
    for direction in (basis[lost] / safe)[::-1]:
        needed = np.abs(seen.output @ direction)
        size = np.linalg.norm(seen.output, axis=1) * np.linalg.norm(direction)
        if np.any(needed > NEEDED * np.where(size > 0, size, 1.0)):
            raise Unseen(direction)
    kept = (basis[~lost] / safe).T  # x = kept y for what is seen
    return kept, Seen(seen.rows @ kept, seen.output @ kept, seen.across @ kept)
