"""How a group of sensors is chosen at every step of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Chooser:
    """How a group of sensors is chosen at every step.

    Parameters
    ----------
    sequence : luck (runs, steps), number of groups -> (runs, steps) positions of groups; None where the scores decide
    bound_weight, position_weight : see `score_groups` in families/hybrid/imm_kernel.py
    """

    sequence: Callable[[np.ndarray, int], np.ndarray] | None = None
    bound_weight: float = 1.0
    position_weight: float = 0.0


def in_turn(luck: np.ndarray, count: int) -> np.ndarray:
    """The groups in turn.

    Parameters
    ----------
    luck : (runs, steps), not looked at
    count : number of groups

    Returns
    -------
    (runs, steps) positions of groups
    """
    return np.broadcast_to(np.arange(luck.shape[1]) % count, luck.shape)


def at_random(luck: np.ndarray, count: int) -> np.ndarray:
    """Any group with equal probability.

    Parameters
    ----------
    luck : (runs, steps) uniform numbers in [0, 1)
    count : number of groups

    Returns
    -------
    (runs, steps) positions of groups
    """
    return np.minimum((luck * count).astype(int), count - 1)
