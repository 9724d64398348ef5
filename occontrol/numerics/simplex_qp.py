"""min over w in V of  g.(w - v) + 1/2 (w - v)' H (w - v),   V a product of capped simplices, H known by its products.

Active-set conjugate gradients with projected search (More & Toraldo 1991, carried over from a box to V): a projected
gradient step finds which weights are at a bound, conjugate gradients move the others inside the plane sum_j w_j = select,
and the step is projected back. The model's own conditional-gradient gap decides when it is good enough.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from occontrol.numerics.polytope import excess, project

EDGE = 1e-12


def _free(w: np.ndarray, gradient: np.ndarray, upper: np.ndarray, step: float, select: int) -> np.ndarray:
    """Which weights a short projected gradient step leaves between their bounds."""
    moved = project(w - step * gradient, upper, select)
    return (upper > 0) & (((moved > EDGE) & (moved < upper - EDGE)) | ((w > EDGE) & (w < upper - EDGE) & (moved > 0)))


def _plane(x: np.ndarray, free: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Project onto {d: d = 0 where not free, sum_j d_j = 0} on every interval."""
    y = np.where(free, x, 0.0)
    return np.where(free, y - (np.sum(y, axis=1) / count)[:, None], 0.0)


def minimise_quadratic(
    product: Callable[[np.ndarray], np.ndarray],
    gradient: np.ndarray,
    start: np.ndarray,
    upper: np.ndarray,
    select: int,
    target: float,
    max_products: int,
    step: float,
) -> tuple[np.ndarray, float, int]:
    """Approximate minimiser of the quadratic model over V.

    Parameters
    ----------
    product : d (N, M) -> H d, H symmetric positive semidefinite
    gradient : (N, M) at `start`
    start : (N, M) in V
    upper, select : the set V
    target : stop when the model's gap sum excess(w, model gradient) is below this
    max_products : budget of calls of `product`
    step : length of the projected gradient step that identifies the active bounds

    Returns w (N, M), the predicted change of the objective (<= 0) and the number of products.
    """
    w, model, g = start.copy(), 0.0, gradient.copy()
    used = 0
    while used < max_products:
        if np.sum(excess(w, g, upper, select)) <= target:
            break
        # a projected gradient step with exact length along the feasible direction
        d = project(w - step * g, upper, select) - w
        Hd = product(d)
        used += 1
        slope, curvature = float(np.vdot(g, d)), float(np.vdot(d, Hd))
        if slope >= 0:
            step *= 10.0
            if step > 1e12:
                break
            continue
        length = 1.0 if curvature <= 0 else min(1.0, -slope / curvature)
        w, g, model = w + length * d, g + length * Hd, model + length * slope + 0.5 * length**2 * curvature
        if curvature > 0:
            step = float(np.clip(np.vdot(d, d) / curvature, step * 0.1, step * 10.0))
        free = _free(w, g, upper, step, select)
        count = np.maximum(np.sum(free, axis=1), 1)
        w, g, model, products = _conjugate_gradients(
            product, w, g, model, free, count, upper, select, target, max_products - used
        )
        used += products
    return w, model, used


def _conjugate_gradients(product, w, g, model, free, count, upper, select, target, budget):
    """CG on the free weights from w, then a projected search; returns the new w, gradient, model value, products."""
    x, r = np.zeros_like(w), -_plane(g, free, count)
    d, rr = r.copy(), float(np.vdot(r, r))
    Hx = np.zeros_like(w)
    first, used, q = rr, 0, 0.0
    while used < budget and rr > 0:
        Hd = product(d)
        used += 1
        curvature = float(np.vdot(d, Hd))
        if curvature <= 1e-300:
            break
        a = rr / curvature
        x, Hx = x + a * d, Hx + a * Hd
        gain = 0.5 * a * rr
        q -= gain
        r = r - a * _plane(Hd, free, count)
        new = float(np.vdot(r, r))
        if new <= 1e-4 * first or gain < 0.02 * -q:
            break
        d, rr = r + (new / rr) * d, new
    if not used:
        return w, g, model, used
    # the whole step if it stays inside, otherwise bent back into V
    inside = w + x
    if np.all(inside >= -EDGE) and np.all(inside <= upper + EDGE):
        return np.clip(inside, 0.0, upper), g + Hx, model + q, used
    length = 1.0
    for _ in range(4):
        if used >= budget:
            break
        step = project(w + length * x, upper, select) - w
        Hs = product(step)
        used += 1
        change = float(np.vdot(g, step)) + 0.5 * float(np.vdot(step, Hs))
        if change < 0:
            # exact length along this feasible direction
            slope, curvature = float(np.vdot(g, step)), float(np.vdot(step, Hs))
            best = 1.0 if curvature <= 0 else min(1.0, -slope / curvature)
            return w + best * step, g + best * Hs, model + best * slope + 0.5 * best**2 * curvature, used
        length *= 0.25
    return w, g, model, used
