"""A proof for all schedules: a tree of words, each with a lower bound of what it costs beyond a potential.

Let Z >= 0 and W a complete prefix code of words (the leaves of a finite tree). If for every leaf u and all prior
information 0 < Y <= Y_max     c_u(Y) + tr(Z Y) - tr(Z Phi_u(Y)) >= |u| g     then no schedule costs less than g a step:
read any schedule as leaves one after the other and add up; the potential telescopes and stays bounded. Y_max is the
information with every sensor on, above which nothing stays. Each leaf is a convex programme in Y, and a tangent at any
Y bounds it from below. The leaf with the smallest bound a step is split, until time is up or the target is reached.

Where the letters there are depend on the phase of a step, each phase has a code and a potential of its own, and a leaf
that begins at phase k is judged by tr(Z_k Y) - tr(Z_{k+|u|} Phi_u(Y)): the sum along a schedule telescopes as before.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.numerics.linalg import symmetrise
from occontrol.scheduling.periodic.certificate import TreeProof, words_array
from occontrol.scheduling.periodic.letters import Letters
from occontrol.scheduling.periodic.phases import Phases, always

EVALUATIONS = 80  # of one word's programme
LOOK = 16  # splits between two looks at the clock
DEEPEST = 200  # letters of a word that is still split
LOWERED = 1e-11  # of a bound, beside the allowances of its leaves: rounding of the letters themselves


@dataclass(eq=False)
class Node:
    """A word and what is proven of it.

    Parameters
    ----------
    phase : at which the word begins
    word : letters
    own : bound a step of this word as a leaf
    best : the same of the best pruning of the tree below
    point : (n, n) the prior information whose tangent proves `own`
    children : one for each letter, or none
    """

    phase: int
    word: tuple[int, ...]
    own: float
    best: float
    point: np.ndarray
    children: list[Node] = field(default_factory=list)


class ProofTree:
    """Words with bounds, under one potential, or one for every phase.

    Parameters
    ----------
    letters : in units in which the smallest covariance is the identity
    potential : (n, n) Z, or (P, n, n) of P phases, positive semidefinite
    enough : a bound a step that no proof can exceed, the cost of a known cycle
    fine : relative precision of a word's programme
    phases : which letters there are at which step; None is all of them always
    """

    def __init__(
        self, letters: Letters, potential: np.ndarray, enough: float, fine: float = 1e-6, phases: Phases | None = None
    ):
        self.letters, self.enough, self.fine = letters, enough, fine
        self.phases = phases or always(letters.count)
        n, P = letters.states, self.phases.count
        self.potential = np.array(np.broadcast_to(potential, (P, n, n)), dtype=float, order="C")
        self._arrays = letters.arrays
        self.count = 0
        point = 0.5 * np.eye(n)
        self.roots = [Node(k, (), -np.inf, -np.inf, point) for k in range(P)]
        for root in self.roots:
            self._split([root])

    @property
    def proven(self) -> float:
        """The least of what the codes of all phases prove, as it was computed."""
        return min(root.best for root in self.roots)

    @property
    def bound(self) -> float:
        """Proven a step for every schedule."""
        best = self.proven
        return best - LOWERED * abs(best)

    def grow(self, target: float, most: int, monitor: Monitor) -> None:
        """Split until the bound reaches `target`, `most` words have been looked at, or the monitor stops."""
        rounds = 0
        while self.bound < target and self.count < most:
            rounds += 1
            if rounds % LOOK == 0 and monitor.stop:
                return
            path = [min(self.roots, key=lambda node: node.best)]
            while path[-1].children:
                path.append(min(path[-1].children, key=lambda node: node.best))
            if not np.isfinite(path[-1].own) or len(path) > DEEPEST:
                return
            self._split(path)

    def leaves(self) -> list[Node]:
        """The words of the best pruning: a complete prefix code for every phase."""
        found, waiting, best = [], list(reversed(self.roots)), self.proven
        while waiting:
            node = waiting.pop()
            if not node.children or node.own >= best:
                found.append(node)
            else:
                waiting += reversed(node.children)
        return found

    def proof(self, root: np.ndarray) -> TreeProof:
        """The leaves as what a run folder keeps, in the units of the problem.

        Parameters
        ----------
        root : (n, n) x = root z
        """
        leaves, inverse = self.leaves(), np.linalg.inv(root)
        points = symmetrise(inverse.T @ np.array([leaf.point for leaf in leaves]) @ inverse)
        starts = np.array([leaf.phase for leaf in leaves])
        Z = symmetrise(root @ self.potential @ root.T)
        return TreeProof(words_array([leaf.word for leaf in leaves]), points, Z, starts)

    def _split(self, path: list[Node]) -> None:
        last = path[-1]
        following = self.phases.at(last.phase + len(last.word))
        last.children = [self._node(last.phase, (*last.word, a), last.point) for a in following]
        for node in reversed(path):
            node.best = max(node.own, min(child.best for child in node.children))

    def _node(self, phase: int, word: tuple[int, ...], start: np.ndarray) -> Node:
        from occontrol.scheduling.periodic.kernels import minimise

        self.count += 1
        T = len(word)
        scale = abs(self.enough) * T
        before, after = self.potential[phase], self.potential[(phase + T) % self.phases.count]
        bound, _, allowance, point = minimise(
            *self._arrays, np.array(word), before, after, start, T * self.enough, EVALUATIONS, self.fine * scale,
        )  # fmt: skip
        own = (bound - allowance) / T
        return Node(phase, word, own, own, point)
