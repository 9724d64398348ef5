"""A stronger relaxation for single readings: a share of a reading is made dearer, a whole one is not.

In the plain relaxation a reading of noise R at share v has the extra noise R (1/v - 1). Any D >= R whose extraction
leaves Cov(all readings) - blkdiag(D) positive definite may take R's place: the extra noise D (1/v - 1) is the same at
v = 0 and v = 1, larger between, and J is still jointly convex (the perspective of a convex quadratic in the estimator's
gains). With D = rho R the rows stay, and the weight v is replaced by

    phi(v) = v / (rho + (1 - rho) v),    J~(v) = J(phi(v)) + sum cost (v - phi(v)),   rho >= 1

so prices stay linear in v. rho is the largest for which all sensors together, read at every instant with the noise
R - D = (1 - rho) R, keep every innovation positive definite.
"""

from __future__ import annotations

import numpy as np

from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.sweep import Sweep

HALVINGS = 14
INSIDE = 0.98  # of rho - 1 that is used: rounding must not reach the border of convexity
POSITIVE = 1e-9  # of the largest innovation: what the smallest must exceed
WORK = 3e9  # operations that a search for rho may take


def extraction(recursion: Recursion) -> float:
    """The rho of this file's header; 1 where nothing can be gained, or where looking would take too long.

    Parameters
    ----------
    recursion : Recursion of readings, with steps of one
    """
    r, rows, K = recursion, recursion.rows.shape[1], len(recursion.steps)
    if not rows or rows > r.states or K * HALVINGS * (rows**3 + 3 * r.states**3) > WORK:
        return 1.0  # more values than states: their covariance is singular
    first = r.transition[r.predict[0]] @ r.initial @ r.transition[r.predict[0]].T + r.noise[r.predict[0]]
    c = r.rows[r.row_set[0]]
    high = float(np.linalg.eigvalsh(c @ first @ c.T)[0])
    if not high > POSITIVE:
        return 1.0
    low = 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _stays_positive(r, middle):
            low = middle
        else:
            high = middle
    return 1.0 + INSIDE * low


def _stays_positive(r: Recursion, extracted: float) -> bool:
    """Whether every innovation C S C' - extracted I is positive definite when all rows are read with that noise."""
    S = r.initial
    for k in range(len(r.steps)):
        F, c = r.transition[r.predict[k]], r.rows[r.row_set[k]]
        S = F @ S @ F.T + r.noise[r.predict[k]]
        B = c @ S
        innovation = B @ c.T - extracted * np.eye(len(c))
        values = np.linalg.eigvalsh((innovation + innovation.T) / 2)
        if not values[0] > POSITIVE * max(values[-1], 1.0):
            return False
        S = S - B.T @ np.linalg.solve(innovation, B)
        S = (S + S.T) / 2
    return True


class ExtractedSweep:
    """J~ of this file's header as an Objective on the same policies.

    Parameters
    ----------
    sweep : of the recursion
    rho : from `extraction`
    """

    def __init__(self, sweep: Sweep, rho: float):
        self.sweep, self.rho = sweep, rho
        r = sweep.recursion
        self._price = r.decision_cost
        self._reads = np.diff(r.offsets) > 0  # idle measures nothing: its weight may exceed 1

    @property
    def shape(self) -> tuple[int, int]:
        """(N, M) of the policies."""
        return self.sweep.shape

    @property
    def states(self) -> int:
        """n"""
        return self.sweep.states

    @property
    def forward_count(self) -> int:
        """Evaluations of the cost so far."""
        return self.sweep.forward_count

    @property
    def backward_count(self) -> int:
        """Evaluations of the gradient so far."""
        return self.sweep.backward_count

    def _bent(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """phi (N, M) and its derivative."""
        under = self.rho + (1.0 - self.rho) * weights
        phi = np.where(self._reads, weights / under, weights)
        return phi, np.where(self._reads, self.rho / under**2, 1.0)

    def cost(self, weights: np.ndarray) -> float:
        """J~ of a policy (N, M). `weights` (N, M)."""
        phi, _ = self._bent(weights)
        return self.sweep.cost(phi) + float(np.vdot(self._price, weights - phi))

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J~ and dJ~/dv (N, M) of a policy (N, M). `weights` (N, M)."""
        phi, slope = self._bent(weights)
        J, g = self.sweep.cost_and_gradient(phi)
        return J + float(np.vdot(self._price, weights - phi)), (g - self._price) * slope + self._price
