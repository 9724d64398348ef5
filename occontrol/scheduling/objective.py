"""What the solvers of this room need to know about a cost: its value, its gradient and its size."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from occontrol.scheduling.recursion import Recursion


class Objective(Protocol):
    """A convex function of policies (N, M), such as scheduling/sweep.py or the exact slots of the robust family.

    Attributes
    ----------
    shape : (N, M) of the policies
    states : n, by which the relaxation sizes its memory
    forward_count, backward_count : evaluations of the cost and of the gradient so far
    """

    @property
    def forward_count(self) -> int: ...

    @property
    def backward_count(self) -> int: ...

    @property
    def shape(self) -> tuple[int, int]: ...

    @property
    def states(self) -> int: ...

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, M)."""
        ...

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy, `weights` (N, M)."""
        ...


class RecursiveObjective(Objective, Protocol):
    """An objective whose decisions are those of a recursion.

    Attributes
    ----------
    recursion : Recursion with one step an interval
    """

    @property
    def recursion(self) -> Recursion: ...
