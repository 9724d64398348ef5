"""The relaxation on finer steps than decisions: corrected prices on the recursion with one step an interval.

    price_kj += dJ/dv_kj - dJ_one/dv_kj   at the last policy

A linear term is added, so the corrected problem is convex, and everything that needs one step an interval (exact single
exchanges above all) works on it as it is. At a fixed point its gradient is that of J. Every round is judged by the
policy's own bound under J; where rounds gain too little, J itself is minimised.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.integration.folded import Extrapolated, Folded
from occontrol.families.athans.integration.integrator import ROOT_SHARE, Integrator
from occontrol.families.athans.integration.priced import Judged, PricedSweep
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, memory_for, minimise_relaxed
from occontrol.scheduling.sweep import Sweep

ROUNDS = 8
INNER_SHARE_OF_GAP = 0.6  # of the gap: what the corrected problem is solved to
SWEEPS_OF_POLISH = 2  # times the sweeps that a mixture of cuts would have taken: by those the shaken polish is budgeted
SLOW_SHARE = 0.5  # a round that leaves more than this share of the excess is too slow
ROUGH_FACTOR = 10.0  # times the gap: where the recursion with one step an interval only shows the way
FAR_SHARE = 0.3  # one step an interval is that far off: its optimum is no place to start from


def relax(
    integrator: Integrator, limits: RelaxedOptions, monitor: Monitor, start: np.ndarray | None = None
) -> PricedSweep:
    """Minimise J over the relaxed policies to a relative gap.

    Parameters
    ----------
    integrator : Integrator of the problem
    limits : RelaxedOptions, of which relative_gap and max_iterations count
    monitor : Monitor
    start : (N, M) policy, or None
    """
    base, gap, allowed = integrator.recursion, limits.relative_gap, feasible_set(integrator.problem)
    sweep = integrator.sweep
    if integrator.plain:
        found = minimise_relaxed(sweep, allowed, start, limits, monitor)
        return PricedSweep(base, base, found, found, None)
    # prices are a linear term, so what is known of the curvature stays right from round to round
    spent, curvature = _Spent(), memory_for(sweep, sweep.recursion.cost.size)
    v = allowed.uniform() if start is None else start
    shown = None
    if start is None:
        off = _off(integrator, v)
        if off <= integrator.accuracy:
            inner = spent.add(minimise_relaxed(sweep, allowed, None, limits, monitor, curvature))
            v = inner.weights
            if integrator.evaluate(v).on is None:
                return PricedSweep(base, base, inner, inner, None)
        elif off <= FAR_SHARE:
            rough = replace(limits, relative_gap=ROUGH_FACTOR * gap)
            v = shown = spent.add(minimise_relaxed(sweep, allowed, None, rough, monitor, curvature)).weights
    mesh = None if integrator.options.substeps else integrator.first
    J = own = last = np.inf
    share, tried = ROOT_SHARE, 0
    direct = False
    inner = None
    for _ in range(ROUNDS):
        if mesh is None:
            on: Folded | Extrapolated = integrator.fixed
            J, g = on.cost_and_gradient(v)
        else:
            on, J, g = integrator.refined(v, mesh, share)
            tried, mesh = len(mesh), on.mesh
        own = J - allowed.bound(J, v, g)
        _, g_one = integrator.sweep.cost_and_gradient(v)
        sweep = Sweep(replace(base, cost=base.cost + (g - g_one)))
        status = Status.CERTIFIED if own <= gap * abs(J) else Status.LIMIT
        monitor.report(spent.iterations, J, J - own)
        if monitor.stop or spent.iterations >= limits.max_iterations:
            break
        if status is Status.CERTIFIED:
            if not _inaccurate(on, v, integrator.accuracy * abs(J)) or (share < ROOT_SHARE and len(on.mesh) == tried):
                break
            # extrapolated costs are convex but for their error: a bound from a policy that errs more is none
            share /= 4
            continue
        target = INNER_SHARE_OF_GAP * gap * abs(J)
        left = max(limits.max_iterations - spent.iterations, 1)
        if direct or own > SLOW_SHARE * last:
            objective, watch, direct = Judged(on, base), monitor, True
        else:
            objective, watch = sweep, monitor.child(silent=True)
        options = RelaxedOptions(gap, left, None, target, True)
        inner = spent.add(minimise_relaxed(objective, allowed, v, options, watch, curvature))
        if inner.stalled and np.array_equal(v, inner.weights):
            if shown is None:
                break
            # the way that was shown ends where rounding hides any descent (a diffuse start): once more, all the way
            memory = memory_for(sweep, sweep.recursion.cost.size)
            v = spent.add(minimise_relaxed(integrator.sweep, allowed, shown, limits, monitor, memory)).weights
            shown, direct, last = None, False, np.inf
            continue
        v, last = inner.weights, own
    if monitor.interrupted:
        status = Status.INTERRUPTED
    J_one, g_one = sweep.cost_and_gradient(v)
    error = 0.0 if isinstance(on, Folded) else on.error(v)
    outcome = RelaxedOutcome(v, J, J - own - error, g, spent.iterations, status, spent.sweeps, spent.stalled)
    bound = allowed.bound(J_one, v, g_one)
    counted = {name: count // SWEEPS_OF_POLISH for name, count in spent.sweeps.items()}
    inner = RelaxedOutcome(v, J_one, bound, g_one, spent.iterations, status, counted)
    return PricedSweep(sweep.recursion, base, outcome, inner, on)


class _Spent:
    """Iterations and sweeps of several minimisations."""

    def __init__(self) -> None:
        self.iterations, self.sweeps, self.stalled = 0, {"gradients": 0, "costs": 0}, False

    def add(self, found: RelaxedOutcome) -> RelaxedOutcome:
        self.iterations += found.iterations
        self.stalled = found.stalled
        for name, count in found.sweeps.items():
            self.sweeps[name] = self.sweeps.get(name, 0) + count
        return found


def _inaccurate(on: Folded | Extrapolated, v: np.ndarray, allowed: float) -> bool:
    """Whether the extrapolated cost of a policy (N, M) is off by more than allowed."""
    return isinstance(on, Extrapolated) and on.error(v) > allowed


def _off(integrator: Integrator, v: np.ndarray) -> float:
    """The relative error of one step an interval on a policy; infinite where the number of steps is stated."""
    if integrator.options.substeps is not None:
        return np.inf
    J = integrator.extrapolated(integrator.first).cost(v)
    return abs(integrator.sweep.cost(v) - J) / abs(J) if J else 0.0


def interval_loss(on: Folded | Extrapolated, allowed: IntervalPolytopes) -> np.ndarray:
    """(N,) what one choice an interval costs to first order, min w.g_i - sum over its steps of min w.g_step.

    Parameters
    ----------
    on : whose gradient was computed last at the policy in question
    allowed : the set of the weights
    """
    folded = on.half if isinstance(on, Extrapolated) else on
    g = folded.by_step
    fine = IntervalPolytopes(allowed.upper[folded.mesh.owner], allowed.select)
    cheapest = np.sum(fine.vertex(g) * g, axis=1)
    whole = folded.gathered(g)
    once = np.sum(allowed.vertex(whole) * whole, axis=1)
    return np.maximum(once - folded.gathered(cheapest), 0.0)
