"""Transition and noise of spans in the tree of halves, each computed once.

A whole follows from its halves, F = Fb Fa and Q = Fb Qa Fb' + Qb, so a finer mesh asked for first makes the coarser
ones cheap: for a plant that varies with time the integration of F and Q is most of the work.
"""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.discretise import HalfPredicts
from occontrol.families.athans.integration.features import features
from occontrol.families.athans.integration.mesh import Mesh
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.transition import transitions, unique_spans


class Spans:
    """F (n, n) and Q (n, n) of spans (root, level, position) of one problem, see Mesh.

    Parameters
    ----------
    problem : SchedulingProblem
    roots : Mesh whose roots are meant
    """

    def __init__(self, problem: SchedulingProblem, roots: Mesh):
        self.problem, n = problem, problem.states
        plant = problem.plant
        self.fixed = plant.A.constant and plant.noise.constant
        self.origin = float(problem.edges[0])
        self._length, self._kind, self._start = roots.lengths, np.arange(len(roots.lengths)), roots.edges[:-1]
        if self.fixed:
            self._length, self._kind = unique_spans(roots.lengths)
            self._start = np.zeros(len(self._length))
        cuts = [features(s, self.origin, float(problem.elapsed[-1])) for s in (plant.A, plant.noise)]
        self._cuts = np.unique(np.concatenate(cuts))
        self._known: dict[tuple[int, int, int], int] = {}
        self._F, self._Q = np.empty((0, n, n)), np.empty((0, n, n))

    def of(self, root: np.ndarray, level: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, ...]:
        """Distinct F and Q (U, n, n) and the index (K,) of each span among them.

        Parameters
        ----------
        root, level, position : (K,) as in Mesh
        """
        kind = self._kind[root]
        place = np.zeros_like(position) if self.fixed else position
        keys, index = np.unique(np.column_stack([kind, level, place]), axis=0, return_inverse=True)
        keys = [tuple(key) for key in keys.tolist()]
        missing = [key for key in keys if key not in self._known]
        joined = [key for key in missing if all(half in self._known for half in self._halves(key))]
        fresh = [key for key in missing if not all(half in self._known for half in self._halves(key))]
        if fresh:
            self._compute(fresh)
        if joined:
            self._join(joined)
        at = np.array([self._known[key] for key in keys])
        return self._F[at], self._Q[at], index.ravel().astype(np.int64)

    def half_predicts(self, mesh: Mesh) -> HalfPredicts:
        """The two halves of every step of a mesh."""
        halves = mesh.halved()
        return HalfPredicts(*self.of(halves.root, halves.level, halves.position))

    def _halves(self, key: tuple[int, int, int]) -> tuple[tuple[int, int, int], ...]:
        kind, level, place = key
        return ((kind, level + 1, 2 * place), (kind, level + 1, 2 * place + (0 if self.fixed else 1)))

    def _keep(self, keys: list[tuple[int, int, int]], F: np.ndarray, Q: np.ndarray) -> None:
        count = len(self._F)
        self._F, self._Q = np.concatenate([self._F, F]), np.concatenate([self._Q, Q])
        self._known.update((key, count + i) for i, key in enumerate(keys))

    def _compute(self, keys: list[tuple[int, int, int]]) -> None:
        kind, level, place = np.array(keys, dtype=np.int64).T
        lengths = np.ldexp(self._length[kind], -level)
        starts = self._start[kind] + place * lengths
        plant = self.problem.plant
        F, Q = transitions(plant.A, plant.noise, starts, starts + lengths, self.origin, self._cuts)
        self._keep(keys, F, Q)

    def _join(self, keys: list[tuple[int, int, int]]) -> None:
        first, second = np.array([[self._known[half] for half in self._halves(key)] for key in keys]).T
        Fa, Fb = self._F[first], self._F[second]
        Q = Fb @ self._Q[first] @ np.swapaxes(Fb, 1, 2) + self._Q[second]
        self._keep(keys, Fb @ Fa, (Q + np.swapaxes(Q, 1, 2)) / 2)
