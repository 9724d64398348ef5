"""Edges added where one choice an interval spoils the bound in continuous time, a diffuse start above all.

    delta_i = min_w w.g_i - sum over the steps of interval i of min_w w.g_step

is what the continuous bound loses on interval i to the grid of decisions. Where the sum of these and the policy's own
excess exceeds GAP_THAT_ADDS_EDGES of the cost, the worst intervals are cut at steps of the mesh, and the relaxation
goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import STEPS_FOR_BOUND
from occontrol.families.athans.integration.folded import Extrapolated
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.integration.priced import PricedSweep
from occontrol.families.athans.integration.relaxed import interval_loss, relax
from occontrol.families.athans.integration.resume import earlier_policy
from occontrol.families.athans.methods import Collocation
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome
from occontrol.scheduling.sweep import Sweep

GAP_THAT_ADDS_EDGES = 0.01  # of the cost: the gap at the top above which edges are added
GAP_WANTED = 0.001  # of the cost: the gap at the top that is then aimed at
PARTS = 4
SMALLEST_SHARE = 1e-6  # share of an interval that is worth an edge
SMALLEST_WORTH = 1e-3 * GAP_WANTED  # of the cost: what a choice on a piece must be able to change
ROUNDS = 8
MOST_ADDED_EDGES = 120  # edges, beside a quarter of the intervals
WHY = "one choice would spoil this interval"


def search_space(problem: SchedulingProblem, method: Any, monitor: Monitor) -> tuple[Integrator, Sweep]:
    """What a method searches on: the problem's edges with those that were added, and the sweep with the relaxation.

    Parameters
    ----------
    problem : SchedulingProblem
    method : of the family
    monitor : Monitor
    """
    if isinstance(method, Collocation):  # it relaxes for itself
        integrator = Integrator(problem, method.relative_gap)
        return integrator, integrator.sweep
    monitor.stage = "relaxation"
    limits = RelaxedOptions(method.relative_gap, getattr(method, "max_iterations", STEPS_FOR_BOUND))
    return relax_and_refine(problem, limits, monitor, start=earlier_policy(problem, monitor))


def relax_and_refine(
    problem: SchedulingProblem,
    limits: RelaxedOptions,
    monitor: Monitor,
    refine: bool = True,
    start: np.ndarray | None = None,
) -> tuple[Integrator, PricedSweep]:
    """The relaxation of a problem, on further edges where the file lets them be added and they are needed.

    Parameters
    ----------
    problem : SchedulingProblem
    limits : of the relaxation
    monitor : Monitor
    refine : False adds no edge whatever the problem says
    start : (N, M) policy to begin at, or None

    Returns the Integrator of the problem with its edges, and the relaxation as a PricedSweep.
    """
    integrator = Integrator(problem, limits.relative_gap)
    found = relax(integrator, limits, monitor, start)
    room, top = problem.intervals // 4 + MOST_ADDED_EDGES, GAP_THAT_ADDS_EDGES
    for _ in range(ROUNDS if refine and problem.integration.refine and problem.integration.substeps is None else 0):
        if monitor.stop or room <= 0 or not np.isfinite(found.outcome.cost):
            break
        extra, parent = _cuts(problem, integrator, found, room, top)
        if not len(extra):
            break
        room, top = room - len(extra), GAP_WANTED
        problem = problem.with_edges([(float(t), WHY) for t in extra])
        integrator = Integrator(problem, limits.relative_gap)
        # the gap itself is needed once the edges are known
        rough = replace(limits, relative_gap=max(GAP_WANTED, limits.relative_gap))
        found = relax(integrator, rough, monitor, found.outcome.weights[parent])
    if top < GAP_THAT_ADDS_EDGES and room > 0 and not monitor.stop:
        extra, start = _shared(problem, found.outcome, room)
        if len(extra):
            problem = problem.with_edges([(float(t), WHY) for t in extra])
            integrator = Integrator(problem, limits.relative_gap)
        found = relax(integrator, limits, monitor, start)
    elif top < GAP_THAT_ADDS_EDGES:
        found = relax(integrator, limits, monitor, found.outcome.weights)
    return integrator, found


def _cuts(
    problem: SchedulingProblem, integrator: Integrator, found: PricedSweep, room: int, top: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times (K,) at which intervals are to be cut, and the interval (N+K,) that each new one comes from."""
    v, cost = found.outcome.weights, abs(found.outcome.cost)
    on = found.on
    if on is None:
        on = integrator.extrapolated(integrator.first)
    if not isinstance(on, Extrapolated):
        return np.empty(0), np.empty(0)
    J, g = on.cost_and_gradient(v)
    allowed = feasible_set(problem)
    loss, own = interval_loss(on, allowed), J - allowed.bound(J, v, g)
    # an interval that is full of steps and still inaccurate is spoilt as well, once edges are added at all
    coarse = integrator.unresolved(on, v)
    if not np.sum(loss) + own > top * cost and not (top < GAP_THAT_ADDS_EDGES and np.any(coarse)):
        return np.empty(0), np.empty(0)
    order = np.argsort(-loss, kind="stable")
    below = np.sum(loss) - np.cumsum(loss[order]) <= 0.5 * GAP_WANTED * cost
    count = int(np.argmax(below)) + 1 if np.any(below) else len(order)
    order = np.concatenate([order[:count], np.setdiff1d(np.flatnonzero(coarse), order[:count])])
    order = [i for i in order if loss[i] > 0 or coarse[i]]
    return _cut_at_steps(problem, on, order, coarse, SMALLEST_WORTH * cost, room)


def _shared(problem: SchedulingProblem, found: RelaxedOutcome, room: int) -> tuple[np.ndarray, np.ndarray]:
    """Times that part shared intervals between their sensors, and the policy (N+K, M) that does so.

    A schedule can only switch at edges, and a share of 1e-3 of an interval cannot be rounded: so the interval gives it
    a piece of its own at its end.
    """
    v = found.weights
    whole = np.round(v)
    share = np.max(np.abs(v - whole), axis=1)
    dear = share * np.max(np.abs(found.gradient), axis=1)
    same = np.sum(whole, axis=1) == np.round(np.sum(v, axis=1))
    at = problem.edges[1:] - share * problem.steps
    apart = _least_apart(problem.edges)
    resolved = (at > problem.edges[:-1] + apart) & (at < problem.edges[1:] - apart)
    inside = (SMALLEST_SHARE < share) & (share < 1 - SMALLEST_SHARE) & same & resolved
    order = [i for i in np.argsort(-dear, kind="stable") if inside[i]][:room]
    pieces, times = [], []
    for i in range(len(v)):
        if i not in order:
            pieces.append(v[i])
            continue
        times.append(float(at[i]))
        rest = np.maximum(v[i] - (1 - share[i]) * whole[i], 0.0)
        pieces += [whole[i], rest * (np.sum(v[i]) / np.sum(rest))]
    return np.array(times), np.array(pieces)


def _least_apart(edges: np.ndarray) -> float:
    """What two times must be apart to be two edges: a few units in the last place of the largest."""
    return 16 * float(np.spacing(np.max(np.abs(edges))))


def _cut_at_steps(
    problem: SchedulingProblem, on: Extrapolated, order: Sequence[int], coarse: np.ndarray, least: float, room: int
) -> tuple[np.ndarray, np.ndarray]:
    """At most `room` times at which the intervals of `order` are cut, and the interval each new one comes from.

    To first order, a choice on a step can change the cost by no more than its prices differ. A piece at an end of an
    interval that is worth less than `least` of the cost is no piece: a diffuse start has steps of 1e-11 of an interval.
    In `coarse` intervals the pieces make room for steps, whatever they are worth.
    """
    mesh, g = on.half.mesh, on.half.by_step
    starts, owner = float(problem.edges[0]) + mesh.starts, mesh.owner
    usable = feasible_set(problem).upper[owner] > 0
    worth = np.max(np.where(usable, g, -np.inf), axis=1) - np.min(np.where(usable, g, np.inf), axis=1)
    times: list[float] = []
    for i in order:
        own = owner == i
        inner, before = starts[own][1:], np.cumsum(worth[own])[:-1]
        if not coarse[i]:
            inner = inner[(before > least) & (np.sum(worth[own]) - before > least)]
        parts = min(PARTS, len(inner) + 1, room - len(times) + 1)
        if parts < 2:
            continue
        at = np.unique(np.round(np.arange(1, parts) * (len(inner) + 1) / parts).astype(int)) - 1
        times += [float(t) for t in inner[np.clip(at, 0, len(inner) - 1)]]
    extra = _apart(problem.edges, times)
    edges = np.union1d(problem.edges, extra)
    middle = (edges[1:] + edges[:-1]) / 2
    return extra, np.searchsorted(problem.edges, middle, side="right") - 1


def _apart(edges: np.ndarray, times: Sequence[float]) -> np.ndarray:
    """(K,) those of `times` that can be told from the `edges` (N+1,), all of which stay, and from each other."""
    least, kept = _least_apart(edges), [float(edges[0])]
    for t in sorted(times):
        after = edges[min(np.searchsorted(edges, t), len(edges) - 1)]
        before = max(kept[-1], float(edges[max(np.searchsorted(edges, t) - 1, 0)]))
        if t - before > least and after - t > least:
            kept.append(t)
    return np.array(kept[1:])
