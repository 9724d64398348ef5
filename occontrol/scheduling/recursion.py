"""The Recursion: steps of integration, each of which belongs to one decision of the schedule.

    predict k   S <- F S F' + Q          update k   S+ = (S^-1 + h sum_j v_j C_j' Theta_j^-1 C_j)^-1
in the order predict 0, update 0, predict 1, ..., update K-1, predict K. Weights v are decisions: a row of the policy
(N, M) for every decision, used by all of its steps. Steps are as fine as accuracy needs, decisions as coarse as the
schedule may be. J stays convex in the policy, since repeating rows is linear.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Recursion:
    """Everything that the sweeps need, as arrays: K steps, N decisions, M sensors, n states.

    Parameters
    ----------
    initial : (n, n) covariance before predict 0
    transition, noise : (U, n, n) distinct F and Q of the predicts
    predict : (K+1,) which of the U belongs to predict k
    rows : (S, r, n) scaled rows Theta^{-1/2} C of all sensors, one below the other
    row_set : (K,) which of the S belongs to update k
    offsets : (M+1,) rows of sensor j are offsets[j]:offsets[j+1]
    steps : (K,) lengths h
    cost : (K, M) alpha q_j h
    running : (V, n, n) distinct R, or (0, n, n) if there is none
    running_set : (K,) which of the V is charged at update k
    terminal : (n, n) weight W on the covariance after predict K
    available : (N, M) positive where a sensor may be used: elsewhere no gradient is computed
    owner : (K,) the decision 0 .. N-1 that each step belongs to, in order and none left out; None: one step a decision
    charge : (K, 2) factors of tr(R S-) and tr(R S+) in the running cost of each step; None: h/2 both, as in continuous
        time. A reading in discrete time is charged before it (1, 0) or after it (0, 1)

    Raises ValueError for an owner that is not 0 .. N-1 in order.
    """

    initial: np.ndarray
    transition: np.ndarray
    noise: np.ndarray
    predict: np.ndarray
    rows: np.ndarray
    row_set: np.ndarray
    offsets: np.ndarray
    steps: np.ndarray
    cost: np.ndarray
    running: np.ndarray
    running_set: np.ndarray
    terminal: np.ndarray
    available: np.ndarray
    owner: np.ndarray | None = None
    charge: np.ndarray | None = None

    def __post_init__(self) -> None:
        decisions = np.arange(len(self.available))
        owner = decisions if self.owner is None else np.asarray(self.owner)
        complete = len(owner) == len(self.steps) and np.array_equal(np.unique(owner), decisions)
        if not complete or np.any(np.diff(owner) < 0):
            raise ValueError(f"owner must name the decisions 0 .. {len(decisions) - 1} in order, one for every step")
        # what follows copies nothing where every decision has one step
        object.__setattr__(self, "owner", None if len(owner) == len(decisions) else owner.astype(np.int64))

    @cached_property
    def charges(self) -> np.ndarray:
        """(K, 2) factors of tr(R S-) and tr(R S+) at every step."""
        if self.charge is None:
            return np.repeat(0.5 * self.steps[:, None], 2, axis=1)
        return np.ascontiguousarray(self.charge, dtype=float)

    @property
    def states(self) -> int:
        """n"""
        return self.initial.shape[0]

    @property
    def intervals(self) -> int:
        """N, the number of decisions."""
        return len(self.available)

    @property
    def sensors(self) -> int:
        """M"""
        return len(self.offsets) - 1

    @cached_property
    def first_steps(self) -> np.ndarray:
        """(N,) the first step of every decision."""
        if self.owner is None:
            return np.arange(self.intervals)
        return np.flatnonzero(np.diff(self.owner, prepend=-1))

    @property
    def lengths(self) -> np.ndarray:
        """(N,) how long each decision lasts."""
        return self.by_decision(self.steps)

    @property
    def decision_cost(self) -> np.ndarray:
        """(N, M) what using a sensor for the whole of a decision costs."""
        return self.by_decision(self.cost)

    def on_steps(self, policy: np.ndarray) -> np.ndarray:
        """The rows (K, ...) that the steps use of a policy (N, ...); the policy itself where there is one step each.

        Parameters
        ----------
        policy : (N, ...) one row for every decision
        """
        return policy if self.owner is None else policy[self.owner]

    def by_decision(self, values: np.ndarray) -> np.ndarray:
        """The sums (N, ...) of (K, ...) over the steps of each decision: the transpose of `on_steps`.

        Parameters
        ----------
        values : (K, ...) one row for every step
        """
        return values if self.owner is None else np.add.reduceat(values, self.first_steps, axis=0)
