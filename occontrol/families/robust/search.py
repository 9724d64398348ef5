"""The best sequence of sensors for robust switching: layer by layer, without walking all M^N sequences.

Unknown: one sensor per slot. A node of layer j is the matrix N after j slots. Three cuts keep a layer small:
* a plane (families/robust/bound.py) proves that no completion of the node beats the best known sequence, for each of
  the ways to end that are still open (families/robust/tails.py);
* another node of the layer is below it in the positive semidefinite order: the flow is monotone, so it can only do
  better (exact); once a layer is larger than `merge_above`, also a node that is below (1 + e) times it: the flow is
  concave, so (1 + e) is all that the merge can cost, and every later slot shrinks that e. The e are chosen such that
  all merges together stay within `relative_gap`, and what they cost at most is subtracted from the bound;
* only then, beyond `width`, the nodes with the largest bounds are dropped, and the least of these bounds is reported.
This is the dynamic programming of theorem 3.1, which equals the minimum over open-loop sequences: exact, without a
grid over the center.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import ALLOWANCE
from occontrol.families.robust.bound import ExactSweep, Plane, plane_of, relaxed_policy, shares, walk
from occontrol.families.robust.psd_front import front
from occontrol.families.robust.scattering import advance
from occontrol.families.robust.slots import Slots, exchange
from occontrol.families.robust.tails import Tail, branch_on_tails, tail_bounds

EXACT = 1e-11  # relative difference of sizes that counts as rounding

REFINE, REFINE_EVERY = 100, 3  # a new plane for layers of so many nodes, every so many slots


@dataclass(frozen=True)
class SearchOptions:
    """Limits of the search.

    Parameters
    ----------
    relative_gap : target of the proof; merging uses at most half of it
    merge_above : nodes of a layer up to which the search is exact; beyond it a tenth of `relative_gap` is good enough
    width : nodes of a layer beyond which the least promising are dropped
    node_limit : nodes after which the search goes on with the most promising few only
    tails : whether to branch on the last slots first
    """

    relative_gap: float = 1e-2
    merge_above: int = 1000
    width: int = 3000
    node_limit: int = 100_000
    tails: bool = True


@dataclass(frozen=True)
class SearchOutcome:
    """The best sequence found, a proven lower bound, and the nodes that were looked at."""

    sequence: list[int]
    cost: float
    lower_bound: float
    relaxed_bound: float
    nodes: int
    widest: int
    merged: int
    dropped: int
    limit: str


@dataclass
class _Layer:
    ordinary: np.ndarray
    slack: np.ndarray
    bound: np.ndarray
    sequences: np.ndarray

    def take(self, which: np.ndarray) -> _Layer:
        return _Layer(self.ordinary[which], self.slack[which], self.bound[which], self.sequences[which])


def contraction(slots: Slots) -> np.ndarray:
    """(N, M): N' <= (1 + e) N before a slot becomes N' <= (1 + k e) N after it, k <= 1.

    k is the largest eigenvalue of F M F' against Q + F M F', M = (N^-1 + R)^-1, at an N that no sequence exceeds.
    """
    result = np.ones(slots.element[0].shape[:2])
    above = slots.start
    n = above.shape[0]
    for slot in range(slots.count):
        element = slots.of(slot, np.arange(slots.sensors))
        after = advance(above, element)
        try:
            root = np.linalg.inv(np.linalg.cholesky(after + 1e-300 * np.eye(n)))
            scaled = root @ element[1] @ np.swapaxes(root, 1, 2)
            result[slot] = np.clip(1.0 - np.linalg.eigvalsh(scaled)[:, 0] + 1e-12, 0.0, 1.0)
        except np.linalg.LinAlgError:
            pass  # no contraction is claimed
        # the slot's flow without sensors: every row of C only lowers N
        free = _free_slot(slots, slot)
        above = advance(above, free)
    return result


def _free_slot(slots: Slots, slot: int):
    from occontrol.families.robust.game import ordinary_elements

    game = slots.flow.element(slots.edges[slot], slots.edges[slot + 1])
    return ordinary_elements(game, slots.free[slot], slots.free[slot + 1])


def search(
    slots: Slots,
    incumbents: Sequence[Sequence[int]] = (),
    options: SearchOptions | None = None,
    monitor: Monitor | None = None,
) -> SearchOutcome:
    """The best sequence, with a proof of how good it is.

    Parameters
    ----------
    slots : Slots
    incumbents : known sequences, improved by exchanges before the search starts
    options : SearchOptions
    monitor : progress, time limit and interruption

    Returns SearchOutcome; `limit` names the limit that ended the proof, '' when none did.
    """
    options, monitor = options or SearchOptions(), monitor or Monitor()
    weights, plane, relaxed = relaxed_policy(slots, monitor=monitor)
    planes, rounded, refined, first = [plane], _rounded(slots, weights), 0, relaxed
    starts = [list(s) for s in incumbents] + rounded + [[i] * slots.count for i in range(slots.sensors)]
    ranked = np.argsort(slots.costs(np.array(starts, dtype=int)), kind="stable")[:3]
    found = [exchange(slots, starts[i]) for i in ranked]
    sequence, cost = min(found, key=lambda pair: pair[1])
    monitor.report(0, cost, relaxed)
    degree = slots.size.degree(slots.start.shape[0])
    shrink = contraction(slots)
    tails = np.append(np.cumprod(np.max(shrink, axis=1)[::-1])[::-1], 1.0)
    budget = np.log1p(options.relative_gap / 2) / degree
    target = 0.1 * options.relative_gap if options.tails else np.inf
    ends = branch_on_tails(slots, weights, plane, relaxed, cost, target, monitor)
    known = _Known(planes, ends, cost * (1 - EXACT), slots.count)
    relaxed = min((tail.bound for tail in ends), default=cost)
    monitor.report(0, cost, relaxed)
    layer = _Layer(slots.start[None], np.zeros(1), np.array([relaxed]), np.zeros((1, 0), dtype=np.int16))
    lower, nodes, widest, merged, dropped, limit = cost, 0, 1, 0, 0, ""
    for slot in range(slots.count):
        if monitor.stop:
            lower = min(lower, float(np.min(layer.bound)))
            limit = "interrupted" if monitor.interrupted else "time_limit"
            break
        children = _expand(slots, layer, slot, shrink)
        nodes += len(children.ordinary)
        children = _bound(children, known, slot + 1, degree, tails[slot + 1])
        alive = children.bound < cost * (1 - EXACT)
        children = children.take(np.nonzero(alive)[0])
        if not len(children.ordinary):
            layer = children
            break
        children = children.take(np.argsort(children.bound, kind="stable"))
        if nodes <= options.node_limit:
            children = _bound(_merge(children, 1.0), known, slot + 1, degree, tails[slot + 1])
        if len(children.ordinary) > options.merge_above:
            least = min(lower, float(np.min(children.bound)))
            if cost - least <= 0.1 * options.relative_gap * abs(cost):
                lower, layer = least, children.take(np.arange(0))
                break
        if len(children.ordinary) > options.merge_above and nodes <= options.node_limit:
            before = len(children.ordinary)
            step = np.expm1(budget / slots.count) / max(tails[slot + 1], 1e-12)
            children = _merge(children, 1.0 + min(step, 0.5))
            merged += before - len(children.ordinary)
            children = _bound(children, known, slot + 1, degree, tails[slot + 1])
        width = options.width if nodes <= options.node_limit else max(1, options.merge_above // 20)
        if len(children.ordinary) > width:
            children = children.take(np.argsort(children.bound, kind="stable"))
            lower = min(lower, float(children.bound[width]))
            dropped += len(children.ordinary) - width
            limit = "width" if nodes <= options.node_limit else "node_limit"
            children = children.take(np.arange(width))
        layer = children
        widest = max(widest, len(layer.ordinary))
        monitor.report(slot + 1, cost, min(lower, float(np.min(layer.bound))), nodes=nodes)
        if len(layer.ordinary) >= REFINE and slot + 1 >= refined + REFINE_EVERY and slot + 2 < slots.count:
            planes.append(_refine(slots, layer, weights, slot + 1, monitor))
            refined = slot + 1
    else:
        sizes = slots.size.value(layer.ordinary, slots.level)
        lower = min(lower, float(np.min(sizes / (1 + layer.slack) ** degree, initial=np.inf)))
        best = int(np.argmin(sizes)) if len(sizes) else -1
        if best >= 0 and sizes[best] < cost:
            sequence, cost = exchange(slots, layer.sequences[best])
    lower = max(lower, relaxed, first)
    if lower <= cost * (1 + ALLOWANCE):  # farther above, the numbers contradict themselves and the reader must know
        lower = min(lower, cost * (1 - EXACT))
    return SearchOutcome([int(i) for i in sequence], cost, lower, relaxed, nodes, widest, merged, dropped, limit)


def _rounded(slots: Slots, weights: np.ndarray) -> list[list[int]]:
    """Sequences from the relaxed policy: the largest share of each slot, and the sensor that is owed most time."""
    largest = [int(i) for i in np.argmax(weights, axis=1)]
    owed, sequence = np.zeros(slots.sensors), []
    lengths = np.diff(slots.edges)
    for slot in range(slots.count):
        owed += weights[slot] * lengths[slot]
        sequence.append(int(np.argmax(owed)))
        owed[sequence[-1]] -= lengths[slot]
    return [largest, sequence]


def _expand(slots: Slots, layer: _Layer, slot: int, shrink: np.ndarray) -> _Layer:
    parts = []
    for sensor in range(slots.sensors):
        after = advance(layer.ordinary, slots.of(slot, sensor))
        added = np.full((len(after), 1), sensor, dtype=np.int16)
        sequences = np.concatenate([layer.sequences, added], axis=1)
        parts.append(_Layer(after, layer.slack * shrink[slot, sensor], layer.bound, sequences))
    return _Layer(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("ordinary", "slack", "bound", "sequences"))
    )


@dataclass
class _Known:
    """What bounds a node: planes of the whole problem, tails, and the size that all other tails are proven to reach."""

    planes: list[Plane]
    tails: list[Tail]
    proven: float
    count: int


def _bound(layer: _Layer, known: _Known, edge: int, degree: float, tail: float) -> _Layer:
    """The best plane at every node, less what earlier merges may have cost; never below the parent's bound."""
    information = np.linalg.inv(layer.ordinary)
    bound = tail_bounds(known.tails, edge, known.count, information, layer.sequences, known.proven)
    for plane in known.planes:
        if np.isfinite(plane.constant[edge]):
            bound = np.maximum(bound, plane.constant[edge] - np.einsum("ij,rij->r", plane.slope[edge], information))
    bound = bound / (1 + layer.slack * tail) ** degree
    return _Layer(
        layer.ordinary, layer.slack, np.where(layer.slack > 0, bound, np.maximum(bound, layer.bound)), layer.sequences
    )


def _merge(layer: _Layer, factor: float) -> _Layer:
    owner = front(layer.ordinary, factor)
    kept = np.nonzero(owner == np.arange(len(owner)))[0]
    slack = layer.slack.copy()
    lost = owner != np.arange(len(owner))
    np.maximum.at(slack, owner[lost], factor * (1 + layer.slack[lost]) - 1)
    return _Layer(layer.ordinary, slack, layer.bound, layer.sequences).take(kept)


def _refine(slots: Slots, layer: _Layer, weights: np.ndarray, edge: int, monitor: Monitor) -> Plane:
    """A new plane, from the most promising node."""
    from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed

    start = layer.ordinary[int(np.argmin(layer.bound))]
    sweep, watch = ExactSweep(slots, start, edge), monitor.child(silent=True)
    options = RelaxedOptions(1e-4, slots.spans.affordable(20))
    outcome = minimise_relaxed(sweep, shares(slots, edge), weights[edge:], options, watch)
    policy = np.concatenate([np.zeros((edge, slots.sensors)), outcome.weights])
    power = sweep.power if slots.size.has_kink else np.inf
    return plane_of(slots, policy, walk(slots, policy, start, edge, power), edge)
