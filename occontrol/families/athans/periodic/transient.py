"""From the initial covariance into a cycle: after how many steps every variance is within 1 % of the cycle's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.scheduling.periodic.letters import Letters

NEAR = 0.01
MOST_CYCLES = 2_000
MOST_STEPS = 20_000


@dataclass(frozen=True, eq=False)
class Transient:
    """The way into a cycle.

    Parameters
    ----------
    steps : from which on every prior variance is within 1 % of that of the cycle; None where it takes too long
    priors : (K+1, n, n) prior covariances up to the end of the cycle in which that happens
    """

    steps: int | None
    priors: np.ndarray


def transient(letters: Letters, word: np.ndarray, steady: np.ndarray, start: np.ndarray) -> Transient:
    """Follow a cycle from a start until it has settled.

    Parameters
    ----------
    letters : in any units
    word : (p,) letters of the cycle
    steady : (p+1, n, n) its prior covariances for ever, in the same units
    start : (n, n) prior covariance at the first step
    """
    p, S, priors = len(word), start, [start]
    last = 0 if _far(S, steady[0]) else -1
    quiet = 0
    for k in range(min(MOST_STEPS, MOST_CYCLES * p)):
        S, _ = letters.step(S, int(word[k % p]))
        priors.append(S)
        if _far(S, steady[(k + 1) % p]):
            last, quiet = k + 1, 0
        else:
            quiet += 1
        # every variance has stayed near over whole cycles, and the distance only shrinks from cycle to cycle
        if quiet >= 2 * p and (k + 1) % p == 0:
            kept = min(len(priors), -(-(last + 1 + p) // p) * p + 1)
            return Transient(last + 1, np.array(priors[:kept]))
    return Transient(None, np.array(priors[: 10 * p + 1]))


def _far(S: np.ndarray, steady: np.ndarray) -> bool:
    d = np.diag(steady)
    return bool(np.any(np.abs(np.diag(S) - d) > NEAR * d))
