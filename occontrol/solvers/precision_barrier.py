"""Interior-point method on the precisions alone: the fast route for larger matrix inequalities.

Unknowns: values (m,); Z = constant + sum_i values_i f_i f_i' and its dual matrix X (r, r) follow. Newton's matrix is

    (F X F') o (F Z^-1 F') + diag(z / values + w / room)        (o: entry by entry)

which for X = mu Z^-1 is the Hessian of the logarithmic barrier, mu (f_i'Z^-1 f_j)^2; the primal-dual scaling (Helmberg,
Rendl, Vanderbei & Wolkowicz 1996; Mehrotra's corrector) needs a dozen steps instead of fifty. Every iterate is strictly
feasible and every X proves a lower bound, so the method can be stopped at any time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from occontrol.core.monitor import Monitor
from occontrol.solvers.precision_normal import NormalForm


@dataclass(frozen=True, eq=False)
class Iterate:
    """What a route hands back, before anything is believed.

    Parameters
    ----------
    values : (m,) in the normal form's units; None when there is none
    dual : (r, r) positive semidefinite, for `NormalForm.lower_bound`
    slack : (m,) multipliers of values >= 0
    iterations : int
    note : the back end's own words
    """

    values: np.ndarray | None
    dual: np.ndarray | None
    slack: np.ndarray | None
    iterations: int
    note: str


def interior_point(form: NormalForm) -> np.ndarray | None:
    """A strictly feasible point, all sensors alike as far as the caps allow; None if none was found."""
    for exponent in range(-2, 60):
        level = 4.0**exponent
        values = _level(form.upper, level)
        try:
            np.linalg.cholesky(form.matrix(values) - 1e-14 * level / (1 + level) * np.eye(form.rows))
        except np.linalg.LinAlgError:
            continue
        # one step further in: start well away from the boundary
        return _level(form.upper, 4 * level)
    return None


def _level(upper: np.ndarray, level: float) -> np.ndarray:
    """`level` for every sensor, bent down smoothly below the caps."""
    return level / (1.0 + level / upper)


def _to_boundary(lower: np.ndarray, direction: np.ndarray) -> float:
    """The largest step a <= 1 (shortened by a safety factor) with C + a D > 0, C = lower lower'."""
    half = solve_triangular(lower, direction, lower=True, check_finite=False)
    scaled = solve_triangular(lower, half.T, lower=True, check_finite=False)
    least = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0])
    return -1.0 / least if least < 0 else np.inf


def _ratio(value: np.ndarray, direction: np.ndarray) -> float:
    falling = direction < 0
    return float(np.min(-value[falling] / direction[falling], initial=np.inf))


def barrier(form: NormalForm, tolerance: float = 1e-12, max_iterations: int = 100, monitor: Monitor | None = None) -> Iterate:
    """Minimise costs' values over the normal form to a relative gap of `tolerance`.

    Parameters
    ----------
    form : NormalForm with r rows and m sensors
    tolerance : relative gap between objective and proven bound at which to stop
    monitor : sees objective and bound in the user's units; its `stop` returns the best so far
    """
    monitor = monitor or Monitor()
    values = interior_point(form)
    if values is None:
        return Iterate(None, None, None, 0, "no strictly feasible start")
    F, c, upper, r = form.factors, form.costs, form.upper, form.rows
    capped = np.isfinite(upper)
    count = r + len(c) + int(np.sum(capped))
    room = np.where(capped, upper - values, np.inf)
    matrix = form.matrix(values)
    mu = float(c @ values) / count
    lower = np.linalg.cholesky(matrix)
    inverse_half = solve_triangular(lower, np.eye(r), lower=True)
    X = mu * inverse_half.T @ inverse_half
    z, w = mu / values, np.where(capped, mu / room, 0.0)
    best = (np.inf, values, X, z)
    best_bound, best_dual, note, stuck = 0.0, X, "iteration limit", 0
    idle, least_gap = 0, np.inf
    iteration = 0
    for iteration in range(1, max_iterations + 1):
        bound = form.lower_bound(X)
        if bound > best_bound:
            best_bound, best_dual = bound, X
        cost = float(c @ values)
        if cost < best[0]:
            best = (cost, values, X, z)
        monitor.report(iteration, form.unit * cost, form.unit * best_bound)
        gap = (best[0] - best_bound) / best[0]
        if gap <= tolerance:
            note = "solved"
            break
        idle = idle + 1 if gap > 0.9 * least_gap else 0
        least_gap = min(gap, least_gap)
        if idle >= 4 and gap < 1e-8:
            note = "solved to rounding"
            break
        if monitor.stop:
            note = "stopped"
            break
        try:
            lower = np.linalg.cholesky(matrix)
            lower_dual = np.linalg.cholesky(X)
        except np.linalg.LinAlgError:
            note = "rounding"
            break
        inverse_half = solve_triangular(lower, np.eye(r), lower=True, check_finite=False)
        inverse = inverse_half.T @ inverse_half
        FX, FZ = F @ X, F @ inverse
        hessian = (FX @ F.T) * (FZ @ F.T)
        hessian[np.diag_indices_from(hessian)] += z / values + np.where(capped, w / room, 0.0)
        scale = 1.0 / np.sqrt(np.diag(hessian))
        hessian = (hessian + hessian.T) / 2 * scale * scale[:, None]
        try:
            newton = np.linalg.cholesky(hessian + 1e-15 * np.eye(len(c)))
        except np.linalg.LinAlgError:
            note = "rounding"
            break
        mu = (float(np.sum(X * matrix)) + float(z @ values) + float(w[capped] @ room[capped])) / count
        diagonal = np.sum(FZ * F, axis=1) + 1 / values - np.where(capped, 1 / room, 0.0)

        def direction(target: float, bend: np.ndarray, bend_matrix: np.ndarray | float, bend_z, bend_w):
            right = scale * (target * diagonal - c - bend)
            half = solve_triangular(newton, right, lower=True, check_finite=False)
            step = scale * solve_triangular(newton, half, lower=True, trans=1, check_finite=False)
            dZ = F.T @ (step[:, None] * F)
            mixed = X @ dZ @ inverse
            dX = target * inverse - X - (mixed + mixed.T) / 2 - bend_matrix
            dz = (target - z * step - bend_z) / values - z
            dw = np.where(capped, (target + w * step + bend_w) / room - w, 0.0)
            primal = min(_to_boundary(lower, dZ), _ratio(values, step), _ratio(room[capped], -step[capped]))
            dual = min(_to_boundary(lower_dual, dX), _ratio(z, dz), _ratio(w[capped], dw[capped]))
            return step, dZ, dX, dz, dw, primal, dual

        zero = np.zeros(len(c))
        step, dZ, dX, dz, dw, primal, dual = direction(0.0, zero, 0.0, zero, zero)
        primal, dual = min(primal, 1.0), min(dual, 1.0)
        after = float(np.sum((X + dual * dX) * (matrix + primal * dZ))) + float((z + dual * dz) @ (values + primal * step))
        after += float((w + dual * dw)[capped] @ (room - primal * step)[capped])
        centring = min(1.0, max(after / count / mu, 1e-8)) ** (3 if min(primal, dual) > 0.5 else 2)
        bent = dX @ dZ @ inverse
        bent = (bent + bent.T) / 2
        bend_w = np.where(capped, step * dw, 0.0)
        bend = np.sum((F @ bent) * F, axis=1) + step * dz / values + np.where(capped, bend_w / room, 0.0)
        step, dZ, dX, dz, dw, primal, dual = direction(centring * mu, bend, bent, step * dz, bend_w)
        safety = 0.9 + 0.08 * min(primal, dual, 1.0)
        primal, dual = min(1.0, safety * primal), min(1.0, safety * dual)
        values, z, w = values + primal * step, z + dual * dz, w + dual * dw
        room = np.where(capped, upper - values, np.inf)
        X = X + dual * (dX + dX.T) / 2
        matrix = form.matrix(values)
        stuck = stuck + 1 if max(primal, dual) < 1e-3 else 0
        if stuck >= 5 or not np.all(np.isfinite(values)):
            note = "no progress"
            break
    return Iterate(best[1], best_dual, best[3], iteration, note)
