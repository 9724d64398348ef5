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
from scipy.linalg.blas import dtrsm  # type: ignore[attr-defined]

from occontrol.core.monitor import Monitor
from occontrol.families.precision.normal_form import NormalForm
from occontrol.numerics.linalg import solve_lower


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
    half = solve_lower(lower, direction)
    scaled = solve_lower(lower, half.T)
    least = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0])
    return -1.0 / least if least < 0 else np.inf


def _ratio(value: np.ndarray, direction: np.ndarray) -> float:
    falling = direction < 0
    return float(np.min(-value[falling] / direction[falling], initial=np.inf))


@dataclass(frozen=True, eq=False)
class _Point:
    """A strictly feasible primal-dual point; room = upper - values, infinite where there is no cap."""

    values: np.ndarray
    X: np.ndarray
    z: np.ndarray
    w: np.ndarray
    room: np.ndarray
    matrix: np.ndarray

    @property
    def complementarity(self) -> float:
        """tr(XZ) + z'values + w'room, the duality gap of a dual feasible point."""
        capped = np.isfinite(self.room)
        return float(np.sum(self.X * self.matrix) + self.z @ self.values + self.w[capped] @ self.room[capped])


@dataclass(frozen=True, eq=False)
class _Step:
    """A Newton direction; `matrix` and `X` are those of Z and X."""

    values: np.ndarray
    matrix: np.ndarray
    X: np.ndarray
    z: np.ndarray
    w: np.ndarray
    primal: float
    dual: float

    def applied(self, form: NormalForm, point: _Point, primal: float, dual: float, exact: bool = True) -> _Point:
        """The point after steps of these lengths; Z is formed anew when `exact`."""
        values = point.values + primal * self.values
        matrix = form.matrix(values) if exact else point.matrix + primal * self.matrix
        room = point.room - primal * self.values
        return _Point(values, point.X + dual * self.X, point.z + dual * self.z, point.w + dual * self.w, room, matrix)


class _Newton:
    """Newton's equations at one point, factored once for predictor and corrector; LinAlgError where rounding wins."""

    def __init__(self, form: NormalForm, point: _Point):
        self.form, self.point = form, point
        F, v, room = form.factors, point.values, point.room
        self.lower = np.linalg.cholesky(point.matrix)
        self.lower_dual = np.linalg.cholesky(point.X)
        half = solve_lower(self.lower, np.eye(form.rows))
        self.inverse = half.T @ half
        FZ = F @ self.inverse
        hessian = ((F @ point.X) @ F.T) * (FZ @ F.T)
        hessian[np.diag_indices_from(hessian)] += point.z / v + point.w / room
        diagonal = np.diag(hessian)
        if not (np.all(np.isfinite(diagonal)) and np.all(diagonal > 0)):
            raise np.linalg.LinAlgError("Newton's matrix is lost in rounding")
        self.scale = 1.0 / np.sqrt(diagonal)
        hessian = (hessian + hessian.T) / 2 * self.scale * self.scale[:, None]
        self.factor = np.linalg.cholesky(hessian + 1e-15 * np.eye(len(v)))
        self.pull = np.sum(FZ * F, axis=1) + 1 / v - 1 / room

    def direction(self, target: float, before: _Step | None = None) -> _Step:
        """Towards complementarity `target`, with the second-order terms of a step `before` (Mehrotra's corrector)."""
        form, p, F = self.form, self.point, self.form.factors
        bent, bend_z, bend_w = np.zeros_like(p.X), 0.0 * p.z, 0.0 * p.w
        if before is not None:
            bent = before.X @ before.matrix @ self.inverse
            bent = (bent + bent.T) / 2
            bend_z, bend_w = before.values * before.z, before.values * before.w
        bend = np.sum((F @ bent) * F, axis=1) + bend_z / p.values + bend_w / p.room
        right = self.scale * (target * self.pull - form.costs - bend)
        half = solve_lower(self.factor, right[:, None])
        step = self.scale * dtrsm(1.0, self.factor.T, half, lower=0)[:, 0]
        dZ = F.T @ (step[:, None] * F)
        mixed = p.X @ dZ @ self.inverse
        dX = target * self.inverse - p.X - (mixed + mixed.T) / 2 - bent
        dz = (target - p.z * step - bend_z) / p.values - p.z
        dw = (target + p.w * step + bend_w) / p.room - p.w
        primal = min(_to_boundary(self.lower, dZ), _ratio(p.values, step), _ratio(p.room, -step))
        dual = min(_to_boundary(self.lower_dual, dX), _ratio(p.z, dz), _ratio(p.w, dw))
        return _Step(step, dZ, (dX + dX.T) / 2, dz, dw, primal, dual)


def barrier(
    form: NormalForm, tolerance: float = 1e-12, max_iterations: int = 100, monitor: Monitor | None = None
) -> Iterate:
    """Minimise costs' values over the normal form to a relative gap of `tolerance`.

    Parameters
    ----------
    form : NormalForm with r rows and m sensors
    tolerance : relative gap between objective and proven bound at which to stop
    max_iterations : Newton steps
    monitor : sees objective and bound in the user's units; its `stop` returns the best so far
    """
    monitor = monitor or Monitor()
    values = interior_point(form)
    if values is None:
        return Iterate(None, None, None, 0, "no strictly feasible start")
    c, r = form.costs, form.rows
    count = r + len(c) + int(np.sum(np.isfinite(form.upper)))
    mu = float(c @ values) / count
    matrix, room = form.matrix(values), form.upper - values
    half = solve_lower(np.linalg.cholesky(matrix), np.eye(r))
    point = _Point(values, mu * half.T @ half, mu / values, mu / room, room, matrix)
    best, best_cost, dual, bound = point, np.inf, point.X, 0.0
    note, stuck, idle, least_gap, iteration = "iteration limit", 0, 0, np.inf, 0
    for iteration in range(1, max_iterations + 1):
        proven, cost = form.lower_bound(point.X), float(c @ point.values)
        if proven > bound:
            bound, dual = proven, point.X
        if cost < best_cost:
            best, best_cost = point, cost
        monitor.report(iteration, form.unit * best_cost, form.unit * bound)
        gap = (best_cost - bound) / best_cost
        idle = idle + 1 if gap > 0.5 * least_gap else 0
        least_gap = min(gap, least_gap)
        if gap <= tolerance or (idle >= 2 and gap < 1e-9) or (idle >= 5 and gap < 1e-8):
            note = "solved" if gap <= tolerance else "solved to rounding"
            break
        if monitor.stop or stuck >= 5:
            note = "stopped" if monitor.stop else "no progress"
            break
        try:
            newton = _Newton(form, point)
            mu = point.complementarity / count
            predicted = newton.direction(0.0)
            lengths = min(1.0, predicted.primal), min(1.0, predicted.dual)
            after = predicted.applied(form, point, *lengths, exact=False).complementarity / count
            centring = min(1.0, max(after / mu, 1e-4)) ** (3 if min(lengths) > 0.5 else 2)
            step = newton.direction(centring * mu, predicted)
        except np.linalg.LinAlgError:
            note = "rounding"
            break
        safety = 0.9 + 0.08 * min(step.primal, step.dual, 1.0)
        primal, dual_length = min(1.0, safety * step.primal), min(1.0, safety * step.dual)
        point = step.applied(form, point, primal, dual_length)
        stuck = stuck + 1 if max(primal, dual_length) < 1e-3 else 0
        if not np.all(np.isfinite(point.values)):
            note = "rounding"
            break
    return Iterate(best.values, dual, best.z, iteration, note)
