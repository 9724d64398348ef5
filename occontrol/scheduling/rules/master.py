"""The master problem: the best mixture of known schedules, as a convex problem on the shares.

    f(lam) = F(sum_p lam_p w_p) + sum_p lam_p switching_p + sum_i psi_i(c_i(lam)),   lam in the simplex
    c = (u_i . mixture - b_i for the rows, E(v) - max_error),  psi_i(c) = (max(mu_i + rho_i c, 0)^2 - mu_i^2)/(2 rho_i)

The last sum is an augmented Lagrangian. psi grows and is convex, c is convex, so f is; `minimise_relaxed` takes it as
it is, with one interval and a sensor for every schedule.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.rows import Row
from occontrol.scheduling.rules.task import Task

GROWTH = 4.0  # of the multiplier of the error, from one master to the next


@dataclass
class Multipliers:
    """Prices of the rows and of the error.

    Parameters
    ----------
    rows : (R,)
    error : nu, of E(v) <= max_error
    """

    rows: np.ndarray
    error: float = 0.0

    def padded(self, count: int) -> Multipliers:
        """The same for `count` rows, zero for new ones."""
        return Multipliers(np.pad(self.rows, (0, count - len(self.rows))), self.error)


@dataclass(frozen=True, eq=False)
class Tangent:
    """F at a policy, and what is needed to bound it from there.

    Parameters
    ----------
    weights : (N, C)
    linear, error : sum(cost.v) and E
    slope : (N, C) dE/dv
    """

    weights: np.ndarray
    linear: float
    error: float
    slope: np.ndarray

    @classmethod
    def at(cls, task: Task, weights: np.ndarray) -> Tangent:
        """The tangent of a task at weights (N, C)."""
        J, g = task.sweep.cost_and_gradient(weights)
        linear = float(np.vdot(task.price, weights))
        return cls(weights, linear, J - linear, g - task.price)


class Master:
    """F and its gradient on the shares (1, P); an Objective.

    Parameters
    ----------
    task : Task
    plans : P schedules
    rows : R rows
    multipliers : Multipliers for them
    scale : of F, from which the weights of the squares follow
    """

    def __init__(self, task: Task, plans: list[Plan], rows: list[Row], multipliers: Multipliers, scale: float):
        self.task, self.plans = task, plans
        N, C = task.oracle.shape
        self._columns = np.array([p.weights.ravel() for p in plans]).reshape(len(plans), N * C)
        self._switching = np.array([p.switching for p in plans])
        self._use = np.array([[row.use(p) for p in plans] for row in rows]).reshape(len(rows), len(plans))
        self._limits = np.array([row.limit for row in rows])
        self.multipliers = multipliers
        self._rho = 10.0 * scale
        limit = task.rules.max_error
        # a violation by the limit itself changes the multiplier by its own size at least, and never by more than GROWTH
        limit = limit if np.isfinite(limit) and limit > 0 else 1.0
        self._rho_error = max(10.0 * scale / limit**2, multipliers.error / limit)
        self._most_error = GROWTH * (multipliers.error + scale / limit)
        self.forward_count = self.backward_count = 0
        self.last: Tangent | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(1, P)"""
        return 1, len(self.plans)

    @property
    def states(self) -> int:
        """n"""
        return self.task.sweep.states

    def policy(self, shares: np.ndarray) -> np.ndarray:
        """The mixture (N, C) of shares (1, P)."""
        return (shares.ravel() @ self._columns).reshape(self.task.oracle.shape)

    def excess(self, shares: np.ndarray) -> np.ndarray:
        """(R,) u.mixture - b of shares (1, P)."""
        return self._use @ shares.ravel() - self._limits

    def cost(self, weights: np.ndarray) -> float:
        """f of shares, `weights` (1, P)."""
        self.forward_count += 1
        linear, error = self.task.parts(self.policy(weights))
        return self._combined(weights, linear, error)[0]

    def _combined(self, shares: np.ndarray, linear: float, error: float) -> tuple[float, np.ndarray, float]:
        """f, the prices (R,) of the rows and the factor of E."""
        goal, mu = self.task.goal, self.multipliers
        f = goal.observation * linear + goal.error * error + float(self._switching @ shares.ravel())
        y = np.maximum(mu.rows + self._rho * self.excess(shares), 0.0)
        f += float(np.sum(y**2 - mu.rows**2)) / (2 * self._rho)
        nu = 0.0
        if np.isfinite(self.task.rules.max_error):
            nu = max(mu.error + self._rho_error * (error - self.task.rules.max_error), 0.0)
            f += (nu**2 - mu.error**2) / (2 * self._rho_error)
        return f, y, nu

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """f and df/dlam (1, P) of shares, `weights` (1, P)."""
        self.forward_count += 1
        self.backward_count += 1
        task, goal = self.task, self.task.goal
        at = Tangent.at(task, self.policy(weights))
        f, y, nu = self._combined(weights, at.linear, at.error)
        g = goal.observation * task.price + (goal.error + nu) * at.slope
        return f, (self._columns @ g.ravel() + self._switching + self._use.T @ y)[None]

    def updated(self, shares: np.ndarray, error: float) -> Multipliers:
        """The multipliers after a solve that ended at shares (1, P) with E = `error`."""
        _, y, nu = self._combined(shares, 0.0, error)
        return Multipliers(y, min(nu, self._most_error))
