"""Prediction of w(Tp) = D(Tp) x(Tp) from the estimate at any node.

    w(Tp|t) = D [Phi(Tp,t) x(t) + int_t^Tp Phi(Tp,s) B u ds]
    cov     = D [Phi(Tp,t) Sigma(t) Phi(Tp,t)' + int_t^Tp Phi Xi Phi' ds] D'

The last term, the noise between t and Tp, is missing in Athans' (3.12). Everything but x and Sigma is computed once.
Athans (1971), equations (3.6)-(3.13).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.families.athans.filter.sampled_model import SampledModel, driven_transitions
from occontrol.families.athans.problem import SchedulingProblem


@dataclass(frozen=True, eq=False)
class Predictor:
    """D Phi(Tp, t_k), D int Phi B u and D int Phi Xi Phi' D' for every node t_k.

    Parameters
    ----------
    matrix : (N+1, p, n)
    offset : (N+1, p)
    noise : (N+1, p, p)
    """

    matrix: np.ndarray
    offset: np.ndarray
    noise: np.ndarray

    def predict(self, k: int, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """w (p,) and its error covariance (p, p) from the estimate at node k.

        Parameters
        ----------
        k : node, 0 .. N
        mean : (n,)
        covariance : (n, n)
        """
        return self.matrix[k] @ mean + self.offset[k], self.matrix[k] @ covariance @ self.matrix[k].T + self.noise[k]


def make_predictor(problem: SchedulingProblem, model: SampledModel) -> Predictor:
    """The predictor of a problem on the nodes of a sampled model (either of the two models: their F, g, Q agree).

    Parameters
    ----------
    problem : SchedulingProblem
    model : SampledModel with N intervals and n states
    """
    at, end = float(problem.predict_at), float(model.edges[-1])  # type: ignore[arg-type]
    D = problem.output.at(at)
    N, (p, n) = model.intervals, D.shape
    matrix, offset, noise = np.empty((N + 1, p, n)), np.empty((N + 1, p)), np.empty((N + 1, p, p))
    phi, push, gram = (part[0] for part in driven_transitions(problem.plant, np.zeros(1), np.array([at - end]), end))
    matrix[N], offset[N], noise[N] = D @ phi, D @ push, D @ gram @ D.T
    for k in range(N - 1, -1, -1):
        later = matrix[k + 1]
        matrix[k] = later @ model.transition[k]
        offset[k] = later @ model.input[k] + offset[k + 1]
        noise[k] = later @ model.noise[k] @ later.T + noise[k + 1]
    return Predictor(matrix, offset, noise)
