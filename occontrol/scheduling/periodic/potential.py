"""What prior information is worth along a cycle: the potentials that a proof starts from.

P_k is the derivative of all later charges by the prior covariance S_k of a cycle that goes on for ever; by the prior
information it is -Z_k, Z_k = S_k P_k S_k. A potential tr(Z Y) with one Z has to stand for all phases of the cycle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.numerics.linalg import symmetrise
from occontrol.scheduling.periodic.averaged import steady_costate
from occontrol.scheduling.periodic.letters import Letters

SMALL = 1e-9  # of the mean: added so that a potential of lower rank has an inverse


@dataclass(frozen=True, eq=False)
class Cycle:
    """A cycle that is repeated for ever.

    Parameters
    ----------
    word : (p,) letters
    cost : mean charge a step
    priors : (p+1, n, n) prior covariances, the last equal to the first
    """

    word: np.ndarray
    cost: float
    priors: np.ndarray


def cycle_of(letters: Letters, word: np.ndarray) -> Cycle | None:
    """The cycle of a word; None where its covariance has no limit.

    Parameters
    ----------
    letters : in units in which the smallest covariance is the identity
    word : (p,) letters
    """
    from occontrol.scheduling.periodic.steady import cycle_cost

    word, n = np.asarray(word, dtype=np.int64), letters.states
    priors = np.empty((len(word) + 1, n, n))
    cost = float(cycle_cost(*letters.arrays, word, np.eye(n), priors))
    return Cycle(word, cost, priors) if np.isfinite(cost) else None


def costates(letters: Letters, cycle: Cycle) -> np.ndarray:
    """(p, n, n) P_k of the phases of a cycle.

    Parameters
    ----------
    letters, cycle : the cycle in the letters' units
    """
    from occontrol.scheduling.periodic.kernels import costate

    F, _, L, seen, weight, _ = letters.arrays
    n, p = letters.states, len(cycle.word)

    def back(P: np.ndarray) -> np.ndarray:
        found = np.empty((p, n, n))
        for k in range(p - 1, -1, -1):
            a = cycle.word[k]
            P = found[k] = costate(F[a], L[a], seen[a], weight[a], cycle.priors[k], P)
        return found

    whole, eye = np.eye(n), np.eye(n)
    for k in range(p):
        a, S = cycle.word[k], cycle.priors[k]
        after = symmetrise(np.linalg.solve(eye + S @ L[a], S))
        whole = F[a] @ (eye - after @ L[a]) @ whole
    return back(steady_costate(whole, back(np.zeros((n, n)))[0]))


def potentials(letters: Letters, cycle: Cycle, phases: int = 1) -> dict[str, np.ndarray]:
    """Potentials (P, n, n) by name: means of the Z_k of a cycle, over its steps of one phase each.

    Parameters
    ----------
    letters, cycle : the cycle in the letters' units
    phases : their number P, of which the length of the cycle is a multiple
    """
    S, n = cycle.priors[:-1], letters.states
    Z = symmetrise(S @ costates(letters, cycle) @ S).reshape(-1, phases, n, n)
    mean = np.mean(Z, axis=0)
    size = np.trace(mean, axis1=1, axis2=2)[:, None, None] / n
    harmonic = np.linalg.inv(np.mean(np.linalg.inv(Z + SMALL * size * np.eye(n)), axis=0))
    return {"harmonic mean of the cycle": symmetrise(harmonic), "mean of the cycle": mean}
