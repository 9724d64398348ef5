"""The convex relaxation, v in the simplex instead of its corners, to a certified gap.

Limited-memory BFGS on the face of V, projected back into V (quasi_newton.py). Every gradient is a cut; the
best bound that the cuts prove, alone or mixed (cuts.py), is kept, and it alone decides when to stop. What else
was tried, with its figures, stands in docs/solver.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Certificate, Status
from occontrol.scheduling.cuts import Cuts
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.objective import Objective
from occontrol.scheduling.quasi_newton import FaceBFGS

PAIR_BYTES = 300_000_000


@dataclass(frozen=True)
class RelaxedOptions:
    """Knobs of the relaxation.

    Parameters
    ----------
    relative_gap : target of (J - bound)/|J|
    max_iterations : steps
    absolute_gap : target of J - bound in its place, for a J that holds an arbitrary constant
    own : whether only the policy's own bound counts, not a mixture of cuts
    memory : pairs of the quasi-Newton method; 4 n, between 80 and 120, if None (the curvature's rank grows with the
        states); fewer where they would take more than PAIR_BYTES
    """

    relative_gap: float = 1e-4
    max_iterations: int = 3000
    memory: int | None = None
    absolute_gap: float | None = None
    own: bool = False


@dataclass
class RelaxedOutcome:
    """What the relaxation found.

    Parameters
    ----------
    weights : (N, M) the best policy
    cost : its J
    lower_bound : the best bound of all iterations
    gradient : (N, M) at `weights`
    iterations : steps
    status : certified, limit, interrupted or disagrees
    sweeps : how many gradients and costs it took
    stalled : no step lowered J any more, though the gap was still open
    """

    weights: np.ndarray
    cost: float
    lower_bound: float
    gradient: np.ndarray
    iterations: int
    status: Status
    sweeps: dict = field(default_factory=dict)
    stalled: bool = False


def minimise_relaxed(
    objective: Objective,
    feasible_set: FeasibleSet,
    start: np.ndarray | None = None,
    options: RelaxedOptions | None = None,
    monitor: Monitor | None = None,
    curvature: FaceBFGS | None = None,
) -> RelaxedOutcome:
    """Minimise a convex J over the relaxed policies of a feasible set.

    Parameters
    ----------
    objective : Objective, such as a Sweep
    feasible_set : FeasibleSet of the policies
    start : (N, M) a policy in V, or None for equal shares
    options : RelaxedOptions
    monitor : Monitor
    curvature : pairs of an objective that differs by a linear term, which are pairs of this one, too; those found here
        are added

    Returns RelaxedOutcome; status is `certified` exactly when the bound proves the target gap, `disagrees` when it lies
    above the cost by more than rounding.
    """
    options, monitor = options or RelaxedOptions(), monitor or Monitor()
    v = feasible_set.uniform() if start is None else start
    memory = curvature or memory_for(objective, v.size, options.memory)
    cuts = Cuts(feasible_set)
    before = (objective.backward_count, objective.forward_count)
    J, g = objective.cost_and_gradient(v)
    bound = feasible_set.bound(J, v, g)
    cuts.add(J, g, v)
    iteration = stalled = 0
    while True:
        monitor.report(iteration, J, bound)
        target = options.relative_gap * abs(J) if options.absolute_gap is None else options.absolute_gap
        if not options.own and J - bound > target and J - bound < 3.0 * target:
            bound = max(bound, cuts.bound(wanted=J - target))
        if J - bound <= target:
            status = Status.CERTIFIED
            break
        if monitor.interrupted:
            status = Status.INTERRUPTED
            break
        if iteration >= options.max_iterations or monitor.timed_out or stalled >= 3:
            status = Status.LIMIT
            break
        iteration += 1
        found = _bent(objective, feasible_set, v, J, g, memory.direction(v, g, feasible_set), bound)
        if found is None:
            # no descent: drop the curvature and take the conditional-gradient direction, downhill unless v is optimal
            memory.reset()
            found = _along(objective, v, J, g, feasible_set.vertex(g) - v, bound)
            if found is None:
                stalled += 1
                bound = bound if options.own else max(bound, cuts.bound(200))
                continue
        stalled = 0
        w, J_new, g_new = found
        memory.update(w - v, g_new - g)
        v, J, g = w, J_new, g_new
        bound = feasible_set.bound(J, v, g) if options.own else max(bound, feasible_set.bound(J, v, g))
        cuts.add(J, g, v)
    names = ("gradients", "costs")
    after = (objective.backward_count, objective.forward_count)
    spent = {name: b - a for name, a, b in zip(names, before, after, strict=True)}
    certificate = Certificate(J, bound)
    if certificate.contradicts:
        status = Status.DISAGREES
    return RelaxedOutcome(v, J, certificate.lower_bound, g, iteration, status, spent, stalled >= 3)


def memory_for(objective: Objective, size: int, pairs: int | None = None) -> FaceBFGS:
    """An empty memory of pairs for policies of `size` weights; `pairs` as in RelaxedOptions.memory."""
    pairs = pairs or min(max(4 * objective.states, 80), 120)
    return FaceBFGS(size, max(5, min(pairs, PAIR_BYTES // (16 * size))))


def _wanted(J: float, slope: float, bound: float) -> float:
    """The cost that a step must reach: Armijo's share of the slope, or of all that there is left to save.

    Where an unstable plant is unobserved for long, the gradient is valid only for steps smaller than rounding.
    """
    return J + 1e-4 * max(slope, bound - J)


def _bent(
    objective: Objective,
    feasible_set: FeasibleSet,
    v: np.ndarray,
    J: float,
    g: np.ndarray,
    d: np.ndarray,
    bound: float,
):
    """Armijo along the path of v + t d projected into V; None if it never falls."""
    t = 1.0
    for _ in range(8):
        w = feasible_set.project(v + t * d)
        slope = float(np.vdot(g, w - v))
        shorter = 0.35
        if slope < 0:
            J_new, g_new = objective.cost_and_gradient(w)
            if J_new <= _wanted(J, slope, bound):
                return w, J_new, g_new
            # where the secant of the slopes along the chord vanishes
            new_slope = float(np.vdot(g_new, w - v))
            if new_slope > slope:
                shorter = float(np.clip(slope / (slope - new_slope), 1e-3, 0.5))
        t *= shorter
    return None


def _along(objective: Objective, v: np.ndarray, J: float, g: np.ndarray, d: np.ndarray, bound: float):
    """Armijo along a feasible direction, with the secant of the slopes; None if it never falls."""
    slope, t = float(np.vdot(g, d)), 1.0
    if not slope < 0:
        return None
    for _ in range(20):
        J_new, g_new = objective.cost_and_gradient(v + t * d)
        if J_new <= _wanted(J, t * slope, bound):
            return v + t * d, J_new, g_new
        new_slope = float(np.vdot(g_new, d))
        # convex in t
        guess = t * slope / (slope - new_slope) if new_slope > slope else 0.5 * t
        t = float(np.clip(guess, 0.1 * t, 0.7 * t))
    return None
