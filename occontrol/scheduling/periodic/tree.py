"""A proof for all schedules: a tree of words, each with a lower bound of what it costs beyond a potential.

Let Z >= 0 and W a complete prefix code of words (the leaves of a finite tree). If for every leaf u and all prior
information 0 < Y <= Y_max     c_u(Y) + tr(Z Y) - tr(Z Phi_u(Y)) >= |u| g     then no schedule costs less than g a step:
read any schedule as leaves one after the other and add up; the potential telescopes and stays bounded. Y_max is the
information with every sensor on, above which nothing stays. Each leaf is a convex programme in Y, and a tangent at any
Y bounds it from below. The leaf with the smallest bound a step is split, until time is up or the target is reached.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.periodic.letters import Letters

EVALUATIONS = 80  # of one word's programme
LOOK = 16  # splits between two looks at the clock
DEEPEST = 200  # letters of a word that is still split
LOWERED = 1e-11  # of a bound, beside the allowances of its leaves: rounding of the letters themselves


@dataclass(eq=False)
class Node:
    """A word and what is proven of it.

    Parameters
    ----------
    word : letters
    own : bound a step of this word as a leaf
    best : the same of the best pruning of the tree below
    point : (n, n) the prior information whose tangent proves `own`
    children : one for each letter, or none
    """

    word: tuple[int, ...]
    own: float
    best: float
    point: np.ndarray
    children: list[Node] = field(default_factory=list)


class ProofTree:
    """Words with bounds, under one potential.

    Parameters
    ----------
    letters : in units in which the smallest covariance is the identity
    potential : (n, n) Z, positive semidefinite
    enough : a bound a step that no proof can exceed, the cost of a known cycle
    fine : relative precision of a word's programme
    """

    def __init__(self, letters: Letters, potential: np.ndarray, enough: float, fine: float = 1e-6):
        self.letters, self.potential, self.enough, self.fine = letters, potential, enough, fine
        self._arrays = letters.arrays
        self.count = 0
        point = 0.5 * np.eye(letters.states)
        self.root = Node((), -np.inf, -np.inf, point)
        self._split([self.root])

    @property
    def bound(self) -> float:
        """Proven a step for every schedule."""
        best = self.root.best
        return best - LOWERED * abs(best)

    def grow(self, target: float, most: int, monitor: Monitor) -> None:
        """Split until the bound reaches `target`, `most` words have been looked at, or the monitor stops."""
        rounds = 0
        while self.bound < target and self.count < most:
            rounds += 1
            if rounds % LOOK == 0 and monitor.stop:
                return
            path = [self.root]
            while path[-1].children:
                path.append(min(path[-1].children, key=lambda node: node.best))
            if not np.isfinite(path[-1].own) or len(path) > DEEPEST:
                return
            self._split(path)

    def leaves(self) -> list[Node]:
        """The words of the best pruning: a complete prefix code."""
        found, waiting = [], [self.root]
        while waiting:
            node = waiting.pop()
            if not node.children or node.own >= self.root.best:
                found.append(node)
            else:
                waiting += reversed(node.children)
        return found

    def _split(self, path: list[Node]) -> None:
        last = path[-1]
        last.children = [self._node((*last.word, a), last.point) for a in range(self.letters.count)]
        for node in reversed(path):
            node.best = max(node.own, min(child.best for child in node.children))

    def _node(self, word: tuple[int, ...], start: np.ndarray) -> Node:
        from occontrol.scheduling.periodic.kernels import minimise

        self.count += 1
        T = len(word)
        scale = abs(self.enough) * T
        bound, _, allowance, point = minimise(
            *self._arrays, np.array(word), self.potential, self.potential, start, T * self.enough, EVALUATIONS,
            self.fine * scale,
        )  # fmt: skip
        own = (bound - allowance) / T
        return Node(word, own, own, point)
