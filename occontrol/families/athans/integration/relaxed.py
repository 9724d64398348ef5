"""The relaxation on finer steps than decisions: corrected prices on the recursion with one step an interval.

    price_kj += dJ/dv_kj - dJ_one/dv_kj   at the last policy

A linear term is added, so the corrected problem is convex, and everything that needs one step an interval (exact single
exchanges above all) works on it as it is. At a fixed point its gradient is that of J. Every round is judged by the
policy's own bound under J; where rounds gain too little, J itself is minimised.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.athans.discretise import Recursion
from occontrol.families.athans.integration.folded import Extrapolated, Folded
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.scheduling.polytope import excess, uniform, vertex
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed
from occontrol.scheduling.sweep import Sweep

ROUNDS = 8
INNER = 0.6  # of the gap: what the corrected problem is solved to
SLOW = 0.5  # a round that leaves more than this share of the excess is too slow
ROUGH = 10.0  # times the gap: where the recursion with one step an interval only shows the way
FAR = 0.3  # one step an interval is that far off: its optimum is no place to start from


@dataclass(eq=False)
class Relaxed:
    """The relaxation of a problem, and what the search for a schedule goes on with.

    Parameters
    ----------
    outcome : in terms of J
    inner : the same in terms of `sweep`, whose costs differ by a constant and by less than the gap
    sweep : one step an interval, prices corrected
    base : one step an interval, prices as they are
    on : what J was computed with; None where one step an interval is accurate enough
    """

    outcome: RelaxedOutcome
    inner: RelaxedOutcome
    sweep: Sweep
    base: Recursion
    on: Folded | Extrapolated | None

    @property
    def judge(self) -> Judged | Sweep:
        """J, or `sweep` where one step an interval is accurate enough."""
        return self.sweep if self.on is None else Judged(self.on, self.base)


def relax(
    integrator: Integrator, limits: RelaxedOptions, monitor: Monitor, start: np.ndarray | None = None
) -> Relaxed:
    """Minimise J over the relaxed policies to a relative gap.

    Parameters
    ----------
    integrator : Integrator of the problem
    limits : RelaxedOptions, of which relative_gap and max_iterations count
    monitor : Monitor
    start : (N, M) policy, or None
    """
    base, gap = integrator.recursion, limits.relative_gap
    sweep = integrator.sweep
    if integrator.plain:
        found = minimise_relaxed(sweep, start, limits, monitor)
        return Relaxed(found, found, sweep, base, None)
    spent = _Spent()
    v = start
    if start is None:
        v = uniform(base.upper, base.select)
        off = _off(integrator, v)
        if off <= integrator.accuracy:
            inner = spent.add(minimise_relaxed(sweep, None, limits, monitor))
            v = inner.weights
            if integrator.evaluate(v).on is None:
                return Relaxed(inner, inner, sweep, base, None)
        elif off <= FAR:
            rough = replace(limits, relative_gap=ROUGH * gap)
            v = spent.add(minimise_relaxed(sweep, None, rough, monitor)).weights
    mesh = None if integrator.options.substeps else integrator.first
    last, direct = np.inf, False
    inner = None
    for _ in range(ROUNDS):
        if mesh is None:
            on: Folded | Extrapolated = integrator.fixed
            J, g = on.cost_and_gradient(v)
        else:
            on, J, g = integrator.refined(v, mesh)
            mesh = on.mesh
        own = float(np.sum(excess(v, g, base.upper, base.select)))
        _, g_one = integrator.sweep.cost_and_gradient(v)
        sweep = Sweep(replace(base, cost=base.cost + (g - g_one)))
        status = Status.CERTIFIED if own <= gap * abs(J) else Status.LIMIT
        monitor.report(spent.iterations, J, J - own)
        if status is Status.CERTIFIED or monitor.stop or spent.iterations >= limits.max_iterations:
            break
        target = INNER * gap * abs(J)
        left = max(limits.max_iterations - spent.iterations, 1)
        if direct or own > SLOW * last:
            judge, direct = Judged(on, base), True
            inner = spent.add(minimise_relaxed(judge, v, RelaxedOptions(gap, left, None, target, True), monitor))
        else:
            options = RelaxedOptions(gap, left, None, target, True)
            inner = spent.add(minimise_relaxed(sweep, v, options, monitor.silent()))
        if inner.stalled and np.array_equal(v, inner.weights):
            break
        v, last = inner.weights, own
    if monitor.interrupted:
        status = Status.INTERRUPTED
    J_one, g_one = sweep.cost_and_gradient(v)
    own_one = float(np.sum(excess(v, g_one, base.upper, base.select)))
    error = 0.0 if isinstance(on, Folded) else on.error(v)
    outcome = RelaxedOutcome(v, J, J - own - error, g, spent.iterations, status, spent.sweeps, spent.stalled)
    inner = RelaxedOutcome(v, J_one, J_one - own_one, g_one, spent.iterations, status, spent.sweeps)
    return Relaxed(outcome, inner, sweep, base, on)


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


class Judged:
    """J itself as something to minimise over policies on the decisions.

    Parameters
    ----------
    on : what J is computed with
    base : Recursion with one step an interval
    """

    def __init__(self, on: Folded | Extrapolated, base: Recursion):
        self.on, self.recursion = on, base
        self.forward_count = self.backward_count = 0

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy (N, M)."""
        self.forward_count += 1
        self.backward_count += 1
        return self.on.cost_and_gradient(weights)

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy (N, M)."""
        self.forward_count += 1
        return self.on.cost(weights)

    def repriced(self, weights: np.ndarray) -> Sweep:
        """One step an interval, with prices that make its gradient at a policy (N, M) that of J."""
        difference = self.on.cost_and_gradient(weights)[1] - Sweep(self.recursion).cost_and_gradient(weights)[1]
        return Sweep(replace(self.recursion, cost=self.recursion.cost + difference))


def _off(integrator: Integrator, v: np.ndarray) -> float:
    """The relative error of one step an interval on a policy; infinite where the number of steps is stated."""
    if integrator.options.substeps is not None:
        return np.inf
    J = integrator.extrapolated(integrator.first).cost(v)
    return abs(integrator.sweep.cost(v) - J) / abs(J) if J else 0.0


def interval_loss(on: Folded | Extrapolated, upper: np.ndarray, select: int) -> np.ndarray:
    """(N,) what one choice an interval costs to first order: min w.g_i - sum over its steps of min w.g_step, not negative.

    Parameters
    ----------
    on : whose gradient was computed last at the policy in question
    upper : (N, M);  select : sum of the weights
    """
    folded = on.half if isinstance(on, Extrapolated) else on
    g = folded.by_step
    fine = upper[folded.mesh.owner]
    cheapest = np.sum(vertex(np.where(fine > 0, g, 0.0), fine, select) * g, axis=1)
    whole = folded.gathered(g)
    once = np.sum(vertex(np.where(upper > 0, whole, 0.0), upper, select) * whole, axis=1)
    return np.maximum(once - folded.gathered(cheapest), 0.0)
