"""Sensors drawn by fixed shares at every step: what that costs in the mean, from above, and draws of it.

S' = Phi_a(S) and the charge of a letter are concave in S, so the mean covariance of letters that are drawn one by one
stays below the fixed point of the modified Riccati equation S = sum_a v_a Phi_a(S), and the mean cost below the charge
there. No schedule has that cost by itself: it is a mean over draws.
Source: Gupta, Chung, Hassibi & Murray (2006).
"""

from __future__ import annotations

import numpy as np

from occontrol.scheduling.periodic.letters import Letters
from occontrol.scheduling.periodic.phases import Phases

MOST_ROUNDS, SETTLED, LOST = 20_000, 1e-12, 1e12


def shares_of_phases(shares: np.ndarray, phases: Phases) -> np.ndarray:
    """(P, A) shares (A,) of what is open at every phase, each of sum 1; alike where none of them is open.

    Parameters
    ----------
    shares : (A,) of the letters
    phases : which letters there are at which step
    """
    found = np.where(phases.opened, shares, 0.0)
    none = np.sum(found, axis=1) <= 0
    found[none] = phases.opened[none]
    return found / np.sum(found, axis=1, keepdims=True)


def mean_at_most(letters: Letters, shares: np.ndarray) -> float:
    """The mean cost a step of drawing for ever, from above; inf where the modified Riccati equation has no solution.

    Parameters
    ----------
    letters : in units in which the smallest covariance is the identity
    shares : (P, A) of every phase
    """
    S, before = np.eye(letters.states), np.inf
    for _ in range(MOST_ROUNDS):
        total = 0.0
        for v in shares:
            steps = [(letters.step(S, int(a)), v[a]) for a in np.flatnonzero(v > 0)]
            total += sum(x * charge for (_, charge), x in steps)
            S = sum((x * after for (after, _), x in steps), np.zeros_like(S))
        if not np.trace(S) < LOST:
            return np.inf
        if abs(total - before) <= SETTLED * abs(total):
            return total / len(shares)
        before = total
    return np.inf


def drawn(shares: np.ndarray, rounds: int, seed: int) -> np.ndarray:
    """A word of so many rounds of phases, each letter drawn independently.

    Parameters
    ----------
    shares : (P, A) of every phase
    rounds : how many
    seed : of the random generator
    """
    random = np.random.default_rng(seed)
    limits = np.cumsum(shares, axis=1)
    luck = random.random((rounds, len(shares)))
    word = np.sum(luck[:, :, None] >= limits[None], axis=2)
    return np.minimum(word, shares.shape[1] - 1).ravel().astype(np.int64)
