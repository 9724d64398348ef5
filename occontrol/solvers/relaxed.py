"""The convex relaxation, v in the simplex instead of its corners, to a certified gap.

Limited-memory BFGS on the face of V, projected back into V (numerics/quasi_newton.py); where exact Hessian products cost
far less than a gradient (many states, few predicted outputs), projected Newton on them takes over. Every gradient is a
cut; the best bound that the cuts prove, alone or mixed (numerics/cuts.py), is kept, and it alone decides when to stop.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.numerics.cuts import Cuts
from occontrol.numerics.polytope import excess, project, uniform, vertex
from occontrol.numerics.quasi_newton import FaceBFGS
from occontrol.numerics.simplex_qp import minimise_quadratic
from occontrol.numerics.sweep import Sweep


@dataclass(frozen=True)
class RelaxedOptions:
    """Knobs of the relaxation.

    Parameters
    ----------
    relative_gap : target of (J - bound)/|J|
    max_iterations : steps
    engine : "auto", "bfgs" or "newton"
    memory : pairs of the quasi-Newton method
    max_products : Hessian products per Newton step
    """

    relative_gap: float = 1e-4
    max_iterations: int = 3000
    engine: str = "auto"
    memory: int = 20
    max_products: int = 200


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
    status : certified, limit or interrupted
    sweeps : how many gradients, costs and Hessian products it took
    """

    weights: np.ndarray
    cost: float
    lower_bound: float
    gradient: np.ndarray
    iterations: int
    status: Status
    sweeps: dict = field(default_factory=dict)


def minimise_relaxed(
    sweep: Sweep, start: np.ndarray | None = None, options: RelaxedOptions | None = None, monitor: Monitor | None = None
) -> RelaxedOutcome:
    """Minimise J over the relaxed policies of one recursion.

    Parameters
    ----------
    sweep : Sweep
    start : (N, M) a policy in V, or None for equal shares
    options : RelaxedOptions
    monitor : Monitor

    Returns RelaxedOutcome; status is `certified` exactly when the bound proves the target gap.
    """
    options, monitor = options or RelaxedOptions(), monitor or Monitor()
    r = sweep.recursion
    upper, select = r.upper, r.select
    v = uniform(upper, select) if start is None else start
    newton = options.engine == "newton" or (options.engine == "auto" and _products_are_cheap(sweep))
    newton = newton and sweep.has_hessian
    if newton:
        sweep.prepare_hessian()
    memory = FaceBFGS(v.shape, options.memory)
    cuts = Cuts(v.shape, upper, select)
    before = (sweep.backward_count, sweep.forward_count, sweep.hessian_count)
    J, g = sweep.cost_and_gradient(v)
    gap = float(np.sum(excess(v, g, upper, select)))
    bound = J - gap
    cuts.add(J, g, v)
    step = _first_step(g, upper)
    iteration = stalled = 0
    while True:
        monitor.report(iteration, J, bound)
        target = options.relative_gap * abs(J)
        if J - bound > target and J - bound < 3.0 * target:
            bound = max(bound, cuts.bound())
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
        if newton and gap < 0.05 * abs(J):
            aim = max(0.1 * gap, 0.2 * target)
            w, _, _ = minimise_quadratic(
                lambda d, v=v: sweep.hessian_product(v, d), g, v, upper, select, aim, options.max_products, step
            )
            found = _along(sweep, v, J, g, w - v)
        else:
            found = _bent(sweep, v, J, g, memory.direction(v, g, upper))
        if found is None:
            # no descent: drop the curvature and take the conditional-gradient direction, downhill unless v is optimal
            memory.reset()
            found = _along(sweep, v, J, g, vertex(np.where(upper > 0, g, 0.0), upper, select) - v)
            if found is None:
                stalled += 1
                bound = max(bound, cuts.bound(200))
                continue
        stalled = 0
        w, J_new, g_new = found
        memory.update(w - v, g_new - g)
        v, J, g = w, J_new, g_new
        gap = float(np.sum(excess(v, g, upper, select)))
        bound = max(bound, J - gap)
        cuts.add(J, g, v)
    names = ("gradients", "costs", "products")
    after = (sweep.backward_count, sweep.forward_count, sweep.hessian_count)
    spent = {name: b - a for name, a, b in zip(names, before, after, strict=True)}
    return RelaxedOutcome(v, J, min(bound, J), g, iteration, status, spent)


def _products_are_cheap(sweep: Sweep) -> bool:
    """Whether a Hessian product costs less than an eighth of a gradient, by operation count."""
    if not sweep.has_hessian:
        return False
    n, p, rows = sweep.recursion.states, sweep.outputs, sweep.recursion.rows.shape[1]
    product = 8 * n * n * p + 8 * rows * n * p
    gradient = 4 * n**3 + 4 * n * n * p + 2 * rows * n * p
    return product < gradient / 8


def _first_step(g: np.ndarray, upper: np.ndarray) -> float:
    """A projected gradient step that moves weights by about their own size."""
    spread = np.where(upper > 0, g, np.nan)
    width = float(np.nanmax(np.nanmax(spread, axis=1) - np.nanmin(spread, axis=1)))
    return 1.0 / width if width > 0 else 1.0


def _bent(sweep: Sweep, v: np.ndarray, J: float, g: np.ndarray, d: np.ndarray):
    """Armijo along the path of v + t d projected into V; None if it never falls."""
    r, t = sweep.recursion, 1.0
    for _ in range(8):
        w = project(v + t * d, r.upper, r.select)
        slope = float(np.vdot(g, w - v))
        if slope < 0:
            J_new, g_new = sweep.cost_and_gradient(w)
            if J_new <= J + 1e-4 * slope:
                return w, J_new, g_new
        t *= 0.35
    return None


def _along(sweep: Sweep, v: np.ndarray, J: float, g: np.ndarray, d: np.ndarray):
    """Armijo along a feasible direction, with the secant of the slopes; None if it never falls."""
    slope, t = float(np.vdot(g, d)), 1.0
    if not slope < 0:
        return None
    for _ in range(20):
        J_new, g_new = sweep.cost_and_gradient(v + t * d)
        if J_new <= J + 1e-4 * t * slope:
            return v + t * d, J_new, g_new
        new_slope = float(np.vdot(g_new, d))
        # convex in t
        guess = t * slope / (slope - new_slope) if new_slope > slope else 0.5 * t
        t = float(np.clip(guess, 0.1 * t, 0.7 * t))
    return None
