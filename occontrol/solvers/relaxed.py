"""The convex relaxation, v in the simplex instead of its corners, to a certified gap.

Projected Newton: at each iterate the quadratic model with exact Hessian products (numerics/tangent.py; limited-memory
BFGS where those are not to be had) is minimised over V, and a line search on the way there takes the step. The global
lower bound J(v) - sum_k excess_k comes with every gradient; the best one over the iterations is kept, and it alone
decides when to stop.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.numerics.polytope import excess, uniform
from occontrol.numerics.quasi_newton import CompactBFGS
from occontrol.numerics.simplex_qp import minimise_quadratic
from occontrol.numerics.sweep import Sweep


@dataclass(frozen=True)
class RelaxedOptions:
    """Knobs of the relaxation.

    Parameters
    ----------
    relative_gap : target of (J - bound)/|J|
    max_iterations : Newton steps
    max_products : Hessian products per step
    """

    relative_gap: float = 1e-4
    max_iterations: int = 500
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
    iterations : Newton steps
    status : certified, limit or interrupted
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
    exact = sweep.has_hessian
    if exact:
        sweep.prepare_hessian()
    memory = None if exact else CompactBFGS()
    J, g = sweep.cost_and_gradient(v)
    gap = float(np.sum(excess(v, g, upper, select)))
    bound = J - gap
    iteration, stalled = 0, 0
    step = _first_step(v, g, upper)
    status = Status.LIMIT
    while True:
        monitor.report(iteration, J, bound)
        if J - bound <= options.relative_gap * abs(J):
            status = Status.CERTIFIED
            break
        if monitor.interrupted:
            status = Status.INTERRUPTED
            break
        if iteration >= options.max_iterations or monitor.timed_out or stalled >= 5:
            break
        iteration += 1
        product = (lambda d, v=v: sweep.hessian_product(v, d)) if memory is None else memory.product
        target = max(0.1 * gap, 0.2 * options.relative_gap * abs(J))
        w, _, _ = minimise_quadratic(product, g, v, upper, select, target, options.max_products, step)
        d = w - v
        slope = float(np.vdot(g, d))
        if not slope < 0:
            d = _fallback(v, g, upper, select)
            slope = float(np.vdot(g, d))
        length, J_new, g_new = _line_search(sweep, v, J, d, slope)
        if g_new is None:
            stalled += 1
            if memory is not None:
                memory.reset()
            continue
        stalled = 0
        v_new = v + length * d
        if memory is not None:
            memory.update(v_new - v, g_new - g)
        v, J, g = v_new, J_new, g_new
        gap = float(np.sum(excess(v, g, upper, select)))
        bound = max(bound, J - gap)
    sweeps = {"gradients": sweep.backward_count, "costs": sweep.forward_count, "products": sweep.hessian_count}
    return RelaxedOutcome(v, J, bound, g, iteration, status, sweeps)


def _first_step(v: np.ndarray, g: np.ndarray, upper: np.ndarray) -> float:
    """A projected gradient step that moves weights by about their own size."""
    spread = np.where(upper > 0, g, np.nan)
    width = float(np.nanmax(np.nanmax(spread, axis=1) - np.nanmin(spread, axis=1)))
    return 1.0 / width if width > 0 else 1.0


def _fallback(v: np.ndarray, g: np.ndarray, upper: np.ndarray, select: int) -> np.ndarray:
    """The conditional-gradient direction: always downhill unless v is optimal."""
    from occontrol.numerics.polytope import vertex

    return vertex(np.where(upper > 0, g, 0.0), upper, select) - v


def _line_search(sweep: Sweep, v: np.ndarray, J: float, d: np.ndarray, slope: float):
    """Armijo along the feasible direction; each trial is a full gradient because the first one nearly always holds."""
    length = 1.0
    for _ in range(12):
        J_new, g_new = sweep.cost_and_gradient(v + length * d)
        if J_new <= J + 1e-4 * length * slope or (abs(J_new - J) <= 1e-14 * abs(J) and np.vdot(g_new, d) <= 0):
            return length, J_new, g_new
        new_slope = float(np.vdot(g_new, d))
        # convex in length: secant on the slopes
        guess = length * slope / (slope - new_slope) if new_slope > slope else 0.5 * length
        length = float(np.clip(guess, 0.1 * length, 0.7 * length))
    return 0.0, J, None
