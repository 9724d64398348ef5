"""Exact search over all sequences of sensor choices, one choice per epoch.

Unknown: the candidate used in each epoch. Layer by layer, a node is a covariance root and the cost so far. Three exact
cuts keep the layers small: a node whose cost plus a floor of the cost to go cannot beat a known sequence; a node that a
cheaper one dominates (`undominated` in epoch_kernel.py); and nothing else, until a layer exceeds `width`: then
the dearest nodes are dropped and their smallest bound becomes the proven lower bound.

The floor of the cost to go from epoch e is the optimum of a shorter search that starts from the covariance that ALL
candidates together would leave there, which no sequence can beat; floors are found from the last epoch backwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.vlambda.epoch_kernel import advance, expand, undominated

FLOOR_WINDOW = 12  # epochs that a floor looks ahead by search; beyond them the next floor stands
FLOOR_WIDTH = 50
CHUNK = 2e7  # multiplications between two looks at the clock, roughly
FLOOR_SHARE = 0.4  # of the nodes and of the time that floors may take


@dataclass(frozen=True, eq=False)
class SequenceProblem:
    """Choose one candidate per epoch to minimise the summed criterion of the posterior covariance.

    Parameters
    ----------
    root : (n, n) root of the covariance before the first measurement
    transition : (K, n, n); noise_root : (K, n, p)
    starts : (E+1,) first step of each epoch, then K
    rows : (C, K, m, n) whitened measurement rows of each candidate, zero rows as padding
    together : (K, r, n) rows at least as informative as any candidate
    kind : TRACE or LARGEST_EIGENVALUE of families/vlambda/epoch_kernel.py
    """

    root: np.ndarray
    transition: np.ndarray
    noise_root: np.ndarray
    starts: np.ndarray
    rows: np.ndarray
    together: np.ndarray
    kind: int

    @property
    def epochs(self) -> int:
        """The number E of choices."""
        return len(self.starts) - 1

    def slice(self, epoch: int) -> slice:
        """The steps of one epoch."""
        return slice(int(self.starts[epoch]), int(self.starts[epoch + 1]))

    def cost_of(self, sequence: Sequence[int], first: int = 0, root: np.ndarray | None = None) -> float:
        """Summed criterion of a sequence of candidate indices from epoch `first` on.

        `root` (n, n), of the covariance there.
        """
        state = np.array(self.root if root is None else root, order="C")
        cost = 0.0
        for e, choice in enumerate(sequence, start=first):
            s = self.slice(e)
            cost += advance(state, self.transition[s], self.noise_root[s], self.rows[choice, s], self.kind)
        return cost


@dataclass(frozen=True)
class SearchResult:
    """Outcome of a search: `cost` of `sequence`, a proven `lower_bound`, epochs walked (`nodes`), widest layer."""

    cost: float
    lower_bound: float
    sequence: tuple[int, ...]
    nodes: int
    widest: int
    stopped: bool = False

    @property
    def proven(self) -> bool:
        """Whether no sequence can be better, up to rounding."""
        return bool(self.cost - self.lower_bound <= 1e-9 * abs(self.cost))


@dataclass
class _Budget:
    """Epochs walked so far, and when to stop: after `limit` of them, at `deadline`, or when the monitor says so."""

    limit: float
    monitor: Monitor
    nodes: int = 0
    deadline: float = np.inf
    stopped: bool = field(default=False)

    def exhausted(self) -> bool:
        late = self.monitor.seconds > self.deadline
        self.stopped = self.stopped or self.nodes >= self.limit or late or self.monitor.stop
        return self.stopped

    def share(self, part: float) -> _Budget:
        """A part of what is left, counted from here; `nodes` goes on."""
        left = np.inf if self.monitor.time_limit is None else self.monitor.time_limit - self.monitor.seconds
        return _Budget(
            self.nodes + part * (self.limit - self.nodes), self.monitor, self.nodes, self.monitor.seconds + part * left
        )


def _expand(problem: SequenceProblem, roots: np.ndarray, epoch: int, budget: _Budget) -> tuple[np.ndarray, np.ndarray]:
    s, choices = problem.slice(epoch), len(problem.rows)
    rows = np.ascontiguousarray(problem.rows[:, s])
    size = max(1, int(CHUNK / (choices * (s.stop - s.start) * len(problem.root) ** 3)))
    found = []
    for start in range(0, len(roots), size):
        if start and budget.exhausted():
            break
        part = roots[start : start + size]
        found.append(expand(part, problem.transition[s], problem.noise_root[s], rows, problem.kind))
        budget.nodes += len(part) * choices
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def _layers(
    problem: SequenceProblem,
    root: np.ndarray,
    span: tuple[int, int],
    floors: np.ndarray,
    upper: float,
    width: int,
    budget: _Budget,
) -> tuple[float, tuple[int, ...] | None, float, int]:
    """Best completion of epochs span[0] .. span[1]-1 below `upper`: (cost, sequence or None, lower bound, widest).

    The lower bound holds for the cost to the end of the span plus floors[span[1]].
    """
    roots, costs = root[None], np.zeros(1)
    parents: list[tuple[np.ndarray, np.ndarray]] = []
    dropped, widest = np.inf, 1
    for e in range(*span):
        if budget.exhausted():
            return upper, None, min(upper, dropped, float(np.min(costs)) + floors[e]), widest
        after, added = _expand(problem, roots, e, budget)
        if len(after) < len(roots):  # out of time in the middle of a layer
            dropped = min(dropped, float(np.min(costs[len(after) :])) + floors[e])
        total = (costs[: len(after), None] + added).ravel()
        order = np.argsort(total, kind="stable")
        order = order[total[order] + floors[e + 1] < upper]
        if not len(order):
            return upper, None, min(upper, dropped), widest
        if len(order) > 4 * width:
            dropped = min(dropped, float(total[order[4 * width]]) + floors[e + 1])
            order = order[: 4 * width]
        flat = after.reshape(-1, *root.shape)[order]
        keep = undominated(flat @ flat.swapaxes(1, 2), total[order], upper - floors[span[1]])
        order, flat = order[keep], flat[keep]
        widest = max(widest, len(order))
        if len(order) > width:
            dropped = min(dropped, float(total[order[width]]) + floors[e + 1])
            order, flat = order[:width], flat[:width]
        parents.append((order // len(problem.rows), order % len(problem.rows)))
        roots, costs = np.ascontiguousarray(flat), total[order]
    sequence, node = [], int(np.argmin(costs))
    best = float(costs[node]) + floors[span[1]]
    for parent, choice in reversed(parents):
        sequence.append(int(choice[node]))
        node = int(parent[node])
    return best, tuple(reversed(sequence)), min(best, dropped), widest


def _floors(problem: SequenceProblem, budget: _Budget) -> np.ndarray:
    """(E+1,) lower bounds of the cost from each epoch on, whatever was chosen before; floors[0] is one of the whole."""
    state, lowest, together = np.array(problem.root, order="C"), [], np.zeros(problem.epochs + 1)
    for e in range(problem.epochs):
        lowest.append(state.copy())
        s = problem.slice(e)
        together[e] = advance(state, problem.transition[s], problem.noise_root[s], problem.together[s], problem.kind)
    # what all candidates together would leave: below everything, and there at once
    floors = np.cumsum(together[::-1])[::-1].copy()
    for e in reversed(range(problem.epochs)):
        last = min(e + FLOOR_WINDOW, problem.epochs)
        first = _layers(problem, lowest[e], (e, last), floors, np.inf, 1, budget)[0]
        bound = _layers(problem, lowest[e], (e, last), floors, first * (1 + 1e-9), FLOOR_WIDTH, budget)[2]
        floors[e] = max(floors[e], bound)
        if budget.stopped:
            break
    return floors


def search(
    problem: SequenceProblem,
    *,
    incumbents: Sequence[Sequence[int]] = (),
    width: int = 300,
    max_nodes: float = 5e6,
    monitor: Monitor | None = None,
) -> SearchResult:
    """The cheapest sequence, with a proof where the limits allow one.

    Parameters
    ----------
    problem : SequenceProblem
    incumbents : known sequences of candidate indices, one per epoch; the best stays unless a strictly better is found
    width : nodes kept in a layer; beyond it the search stops being exact and says so through `lower_bound`
    max_nodes : epochs walked before the search returns its best
    monitor : progress, time limit and interruption

    Returns
    -------
    SearchResult with lower_bound <= optimum <= cost; `proven` when they agree to 1e-9 relative.
    """
    watch = Monitor() if monitor is None else monitor
    budget = _Budget(max_nodes, watch)
    whole, nothing = (0, problem.epochs), np.zeros(problem.epochs + 1)
    found = [(problem.cost_of(s), tuple(int(c) for c in s)) for s in incumbents]
    for beam in (1, 30):
        part = budget.share(0.2)
        cost, sequence, _, _ = _layers(problem, problem.root, whole, nothing, np.inf, beam, part)
        budget.nodes = part.nodes
        if sequence is not None:
            found.append((cost, sequence))
    if not found:
        constant = (0,) * problem.epochs
        found.append((problem.cost_of(constant), constant))
    # a later sequence must be better by more than rounding to replace an earlier one
    upper, best = found[0]
    for cost, sequence in found[1:]:
        if cost < upper * (1 - 1e-12):
            upper, best = cost, sequence
    part = budget.share(FLOOR_SHARE)
    floors = _floors(problem, part)
    budget.nodes = part.nodes
    watch.report(0, upper, min(upper, float(floors[0])))
    lower, widest = float(floors[0]), 1
    if not budget.exhausted():
        cost, sequence, bound, widest = _layers(
            problem, problem.root, whole, floors, upper * (1 - 1e-12), width, budget
        )
        lower = max(lower, bound if bound < upper * (1 - 1e-12) else upper)
        if sequence is not None:
            upper, best = cost, sequence
    watch.report(1, upper, min(upper, lower))
    return SearchResult(float(upper), float(min(lower, upper)), best, budget.nodes, widest, budget.stopped)
