"""Steps of integration: every interval of the schedule, or each of its equal parts, in a tree of halves.

Step k is the part [position, position + 1] / 2^level of its root. So there are few different lengths, whatever the
mesh, and what is known of two halves gives their whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.families.athans.integration.features import samples, sided, varies_between
from occontrol.families.athans.problem import SchedulingProblem

MOST_IN_INTERVAL = 64
MOST_STEPS = 500_000  # of the mesh: halved twice for the estimate of its error they are 2,000,000
DEEPEST = 44
# decay over a step, h max(-Re eig A), from which what a sensor does in its middle is forgotten before its end
FORGOTTEN, REMEMBERED = 4.0, 2.0
GONE = 40.0  # decay from which no double knows what was before


@dataclass(frozen=True, eq=False)
class Mesh:
    """K steps on R roots in N intervals.

    Parameters
    ----------
    edges : (R+1,) of the roots, since the start
    lengths : (R,) of the roots
    interval : (R,) of the schedule, that each root lies in
    root : (K,) of each step, increasing
    level, position : (K,) its place in the root
    """

    edges: np.ndarray
    lengths: np.ndarray
    interval: np.ndarray
    root: np.ndarray
    level: np.ndarray
    position: np.ndarray

    @classmethod
    def coarsest(cls, problem: SchedulingProblem, parts: int | Sequence[int] = 1) -> Mesh:
        """`parts` equal steps an interval, or so many for each."""
        counts = np.broadcast_to(np.asarray(parts, dtype=np.int64), (problem.intervals,))
        interval = np.repeat(np.arange(problem.intervals), counts)
        count, place = len(interval), np.arange(len(interval)) - np.repeat(np.cumsum(counts) - counts, counts)
        lengths = problem.steps[interval] / counts[interval]
        edges = np.append(problem.elapsed[interval] + place * lengths, problem.elapsed[-1])
        zeros = np.zeros(count, dtype=np.int64)
        return cls(edges, lengths, interval, np.arange(count), zeros, zeros)

    def __len__(self) -> int:
        return len(self.root)

    @property
    def owner(self) -> np.ndarray:
        """(K,) the interval of the schedule that each step lies in."""
        return self.interval[self.root]

    @property
    def steps(self) -> np.ndarray:
        """(K,) lengths."""
        return np.ldexp(self.lengths[self.root], -self.level)

    @property
    def starts(self) -> np.ndarray:
        """(K,) times since the start of the horizon."""
        return self.edges[self.root] + self.position * self.steps

    @property
    def key(self) -> bytes:
        """The same for the same steps of the same problem only."""
        return self.root.tobytes() + self.level.tobytes()

    @property
    def nodes(self) -> np.ndarray:
        """(K+1,) ends of the steps since the start of the horizon."""
        return np.append(self.starts, self.edges[-1])

    @property
    def counts(self) -> np.ndarray:
        """(N,) steps of each interval."""
        return np.bincount(self.owner)

    def divided(self, depth: np.ndarray) -> Mesh:
        """Step k cut into 2^depth[k] equal parts.

        Parameters
        ----------
        depth : (K,) whole numbers, at least 0
        """
        count = np.left_shift(1, depth)
        index = np.repeat(np.arange(len(self)), count)
        place = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
        position = np.left_shift(self.position[index], depth[index]) + place
        level = self.level[index] + depth[index]
        return Mesh(self.edges, self.lengths, self.interval, self.root[index], level, position)

    def halved(self) -> Mesh:
        """Every step in two."""
        return self.divided(np.ones(len(self), dtype=np.int64))

    def equidistributed(self, errors: np.ndarray, allowed: float) -> Mesh:
        """Divided until the errors are of one size and their sum is below `allowed`, as far as the limits permit.

        An error falls with the cube of the step, so steps proportional to error^-1/3 take the fewest.

        Parameters
        ----------
        errors : (K,) of the steps, any sign
        allowed : bound of the sum of their sizes
        """
        roots = np.cbrt(np.abs(errors))
        total = float(np.sum(roots))
        if not total > 0:
            return self
        # m_k = roots_k s steps each have errors (1/s)^3, together total / s^2
        wanted = roots * np.sqrt(total / allowed)
        depth = np.clip(np.ceil(np.log2(np.maximum(wanted, 1.0)) - 0.15), 0, 6).astype(np.int64)
        depth = np.minimum(depth, np.maximum(DEEPEST - self.level, 0))
        for _ in range(8):
            after = np.bincount(self.owner, np.left_shift(1, depth))
            full = (after > MOST_IN_INTERVAL)[self.owner] & (depth > 0)
            if not np.any(full):
                break
            depth = depth - full
        after = np.left_shift(1, depth)
        if np.sum(after) > MOST_STEPS:
            depth = np.zeros_like(depth)
        return self.divided(depth)


def first_mesh(problem: SchedulingProblem, rows: np.ndarray) -> Mesh:
    """One step an interval, shorter ones where the data varies, where a large prior meets its first measurements, and
    before the end of intervals over which the plant forgets.

    Steps grow as t + 1/lambda from the start, lambda = max_j lambda_max(Sigma0 L_j).

    Parameters
    ----------
    problem : SchedulingProblem
    rows : (r, n) Theta^{-1/2} C of all sensors at the start, one below the other
    """
    mesh = Mesh.coarsest(problem)
    origin, end = float(problem.edges[0]), float(mesh.edges[-1])
    moving = [s for p, s in problem.signals.items() if not s.constant and p != ("objective", "output")]
    looked = [(s, *samples(s, origin, end)) for s in moving if p_matters(s)]
    for _ in range(6):
        depth = np.zeros(len(mesh), dtype=np.int64)
        nodes = mesh.nodes
        for signal, times, values in looked:
            busy = varies_between(times, values, *sided(signal, origin, nodes), nodes)
            depth |= busy & (mesh.counts[mesh.owner] < MOST_IN_INTERVAL)
        if not np.any(depth):
            break
        mesh = mesh.divided(depth)
    rate = float(np.max(np.einsum("ri,ij,rj->r", rows, problem.plant.covariance, rows), initial=0.0))
    while rate * mesh.steps[0] > 2.0 and mesh.level[0] < DEEPEST and mesh.counts[0] < MOST_IN_INTERVAL:
        depth = np.zeros(len(mesh), dtype=np.int64)
        depth[0] = 1
        mesh = mesh.divided(depth)
    return _remembering(mesh, problem)


def _remembering(mesh: Mesh, problem: SchedulingProblem) -> Mesh:
    """Steps halved again and again towards the ends of intervals over which the plant forgets.

    A step measures in its middle. Where the plant decays from there to the end, neither the step nor its halves show
    that the sensor does anything, and the estimate of their error is zero with them.
    """
    A = problem.plant.A.sample(problem.edges[1:] if not problem.plant.A.constant else problem.edges[-1:])
    size = np.linalg.norm(A, axis=(1, 2)) * problem.steps
    if not np.any(size > FORGOTTEN) or not np.all(np.isfinite(A)):
        return mesh
    rate = np.max(-np.linalg.eigvals(A).real, axis=1) * np.ones(problem.intervals)
    later = problem.elapsed[-1] - problem.elapsed[1:]
    fast = (rate * problem.steps > FORGOTTEN) & (rate * later < GONE)
    while True:
        last = np.append(np.flatnonzero(np.diff(mesh.owner)), len(mesh) - 1)
        long = fast & (rate * mesh.steps[last] > REMEMBERED) & (mesh.level[last] < DEEPEST)
        long &= mesh.counts < MOST_IN_INTERVAL
        if not np.any(long):
            return mesh
        depth = np.zeros(len(mesh), dtype=np.int64)
        depth[last[long]] = 1
        mesh = mesh.divided(depth)


def p_matters(signal: object) -> bool:
    """Whether a signal has values at all (the noise of 'idle' has none)."""
    return int(np.prod(getattr(signal, "shape", (0,)))) > 0
