"""The output predicted from an estimate at any step: the plant itself is followed to the time that is predicted.

w = D x(Tp),   cov w = D [Phi P Phi' + noise on the way] D',   x(Tp), Phi along the path from the estimate
"""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.nonlinear.index import Stages
from occontrol.numerics.flow import combined


class Prediction:
    """From step k of a chain to the predicted output.

    Parameters
    ----------
    problem : with a nonlinear plant
    chain : its Stages
    """

    def __init__(self, problem: AthansProblem, chain: Stages):
        at = problem.output_at if problem.takes_readings else float(problem.predict_at)  # type: ignore[attr-defined]
        self.output = problem.output.at(at)  # type: ignore[attr-defined]
        self.chain = chain
        posterior = problem.discrete and problem.at == "posterior"  # type: ignore[attr-defined]
        self.last = len(chain.lengths) - (1 if posterior else 0)

    def from_estimate(self, k: int, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """w (p,) and its covariance (p, p) from the estimate after k readings.

        Parameters
        ----------
        k : readings so far
        mean : (n,), in state units
        covariance : (n, n)
        """
        D, chain = self.output, self.chain
        if not np.any(D):
            return np.zeros(len(D)), np.zeros((len(D), len(D)))
        flow, left = chain.origin.plant.flow, np.arange(k, self.last)
        left = left[chain.lengths[left] > 0]
        if not len(left):
            return D @ mean, D @ covariance @ D.T
        count = 1 if flow.discrete else 2 * chain.substeps
        lengths = chain.lengths[left]
        times = chain.since[left][:, None] + lengths[:, None] * np.arange(count + 1) / count
        steps = np.repeat(lengths / count, count)
        starts = times[:, :-1].ravel()
        # steps of length 0 fill up to a power of two, so that few functions are compiled
        more = 0 if flow.discrete else (1 << int(np.ceil(np.log2(len(steps))))) - len(steps)
        padded = np.append(starts, np.full(more, times[-1, -1])), np.append(steps, np.zeros(more))
        states, halves = flow.path(mean, *padded)
        states, halves = states[: len(steps) + 1], halves[: len(steps)].reshape(len(left), count, *covariance.shape)
        nodes = np.concatenate([states[:-1].reshape(len(left), count, -1), states[count::count, None]], axis=1)
        seen = nodes[:, :1] if flow.discrete else nodes
        at = times[:, :1] if flow.discrete else times
        Xi = flow.intensities(seen.reshape(-1, len(mean)), at.ravel()).reshape(*seen.shape, len(mean))
        P = covariance
        for F, Q in zip(*combined(halves, Xi, lengths), strict=True):
            P = F @ P @ F.T + Q
        return D @ states[-1], D @ P @ D.T
