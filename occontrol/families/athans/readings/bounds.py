"""Lower bounds for readings that are tighter than the plain relaxation's: noise extraction, and first choices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.families.athans.found import Found
from occontrol.scheduling.extraction import ExtractedSweep, extraction
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.first_choices import TreeLimits, branch, choices
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed
from occontrol.scheduling.single_readings import branch_singly
from occontrol.scheduling.sweep import Sweep

PAYS = 1e-3  # of the cost: a gap below which nothing more is tried
WORK = 1.5e9  # operations that the tree may take
ROUGH, FINE = 1e-3, 1e-4  # gap of the relaxation of a node, and where the optimum is to be proven
MOST_GRADIENTS = 10**9  # of a search whose nodes and seconds are limited
PATIENCE = 12
COARSE, MOST_ROUGH = 0.02, 5e-3  # of the gap, for the nodes of a tree of single readings; and at most


def tighten(
    sweep: Sweep, allowed: IntervalPolytopes, found: Found, method: Method | None, monitor: Monitor, keep: bool = False
) -> Found:
    """What a method found, with a better bound where one can be had for a little work, and any better schedule.

    Parameters
    ----------
    sweep : of the recursion
    allowed : FeasibleSet of its policies
    found : by the method, with the relaxation beside it
    method : its options `branch_first` and `strengthen` are followed where it has them
    monitor : Monitor
    keep : leave the policy as it is, whatever is met
    """
    relaxed = found.relaxed
    whole = bool(np.all(np.abs(found.weights - np.round(found.weights)) < 1e-9))
    if relaxed is None or not whole or monitor.stop:
        return found
    cost = sweep.cost(found.weights)
    exact = getattr(method, "exact_options", None)
    target = max(PAYS, getattr(method, "relative_gap", found.target)) if exact is None else exact.relative_gap
    if exact is not None:
        found.extra["proven_optimal"] = cost - relaxed.lower_bound <= target * abs(cost)
    if cost - relaxed.lower_bound <= target * abs(cost):
        return found
    root, objective = relaxed, sweep
    if getattr(method, "strengthen", None) is not False:
        monitor.stage = "noise extraction"
        rho = extraction(sweep.recursion)
        if rho > 1.0:
            objective = ExtractedSweep(sweep, rho)
            options = RelaxedOptions(ROUGH, 500)
            root = minimise_relaxed(objective, allowed, relaxed.weights, options, monitor.silent())
            found.extra["extraction"] = rho
            root = _with_bound(root, max(root.lower_bound, relaxed.lower_bound))
    bound = root.lower_bound
    if (exact is not None or getattr(method, "branch_first", None) is not False) and not monitor.stop:
        monitor.stage = "first choices"
        limits = TreeLimits(
            relative_gap=getattr(method, "relative_gap", 1e-4),
            gradients=int(np.clip(WORK / operations(sweep), 20, 20_000)),
            node_gap=ROUGH,
            patience=PATIENCE,
        )
        watch = monitor
        if exact is not None:
            limits = TreeLimits(exact.relative_gap, MOST_GRADIENTS, FINE, None, nodes=exact.max_nodes)
            watch = monitor.child(exact.time_limit)
        many = choices(allowed.upper[0], allowed.places) is None
        if many:  # thousands of nodes: digits of one are worth less than further ones
            wide = COARSE * (cost - root.lower_bound) / abs(cost)
            limits = replace(limits, node_gap=float(np.clip(wide, FINE, MOST_ROUGH)))
        tree = (branch_singly if many else branch)(objective, allowed, root, cost, limits, watch)
        bound, found.extra["nodes"] = max(bound, tree.lower_bound), tree.nodes
        if exact is not None:
            found.extra["proven_optimal"] = tree.closed
        if tree.weights is not None and not keep:
            better = polish(sweep, allowed, tree.weights, 50, monitor.silent())
            found.weights = better.weights if better.cost <= tree.cost else tree.weights
    found.bound = max(found.bound, bound)
    return found


def _with_bound(found: RelaxedOutcome, bound: float) -> RelaxedOutcome:
    found.lower_bound = bound
    return found


def operations(sweep: Sweep) -> float:
    """Floating-point operations of one gradient, roughly."""
    r = sweep.recursion
    n, rows = r.states, r.rows.shape[1]
    return len(r.steps) * (8.0 * n**3 + 8.0 * rows * n * n + 500.0)
