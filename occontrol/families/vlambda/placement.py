"""Where to put a movable sensor: the location that maximises a function of its information matrix, in a box.

Unknown: the location p (d,). A grid of the box (with its corners) gives starts. The best few are refined, by ever
finer grids on a line, by a bounded quasi-Newton method in more coordinates (SLSQP with constraints). The result is
checked: it lies inside the box, is allowed, and is at least as good as every point that was looked at.
Oshman (1994), remark 5.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from occontrol.core.errors import InfeasibleError
from occontrol.families.vlambda.sensor import Region

STARTS = 5  # points that are refined
MOST_POINTS = 4096
ROUNDING = 1e-14  # relative, of a merit
STEP = 1e-5  # of the central differences, in units of the box
_FINE = {"ftol": 1e-14}


def grid_of(region: Region, per_coordinate: int) -> np.ndarray:
    """Points (N, d) of an even grid of the box, corners included, in lexicographic order; at most MOST_POINTS.

    Parameters
    ----------
    region : Region
    per_coordinate : points along each coordinate, fewer where there are many coordinates
    """
    count = max(2, min(per_coordinate, int(MOST_POINTS ** (1 / region.coordinates))))
    axes = [np.array([low]) if low == high else np.linspace(low, high, count) for low, high in region.bounds]
    return np.array(list(itertools.product(*axes)), dtype=float)


def allowed_points(region: Region, step: int, name: str = "") -> np.ndarray:
    """Points (N, d) of a grid of the box that satisfy the constraints; one point that does where the grid meets none.

    Parameters
    ----------
    region : Region with bounds (d, 2) and constraints
    step : k, for constraints that depend on it
    name : of the sensor, for the message

    Raises InfeasibleError when no location satisfies the constraints.
    """
    points = grid_of(region, 65 if region.coordinates == 1 else 17)
    allowed = points[region.allowed(step, points)]
    return allowed if len(allowed) else _find_allowed(region, step, points, name)


def _project(points: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    return np.clip(points, bounds[:, 0], bounds[:, 1])


def place(
    region: Region, step: int, merit: Callable[[np.ndarray], np.ndarray], name: str = ""
) -> tuple[np.ndarray, float]:
    """The best location of one sensor at one step.

    Parameters
    ----------
    region : Region with bounds (d, 2) and constraints
    step : k, for constraints that depend on it
    merit : (N, d) -> (N,), to be maximised; not finite where the location is useless
    name : of the sensor, for the message

    Returns
    -------
    Location (d,) and its merit. Of equally good ones (1e-9 relative) the lexicographically first start wins.
    Raises InfeasibleError when no location satisfies the constraints.
    """
    allowed = allowed_points(region, step, name)
    values = _finite(merit(allowed))
    refined, heights = [allowed], [values]
    for start in _peaks(allowed, values):
        refine = _zoom if region.coordinates == 1 else _refine
        better = refine(region, step, merit, start)
        if better is not None:
            refined.append(better[None])
            heights.append(_finite(merit(better[None])))
    candidates, merits = np.concatenate(refined), np.concatenate(heights)
    if not np.isfinite(np.max(merits)):
        raise InfeasibleError(
            f"at k = {step} sensor '{name}' measures nothing finite anywhere in its box\n"
            "  hint: H must be finite and R positive definite inside the bounds"
        )
    top = float(np.max(merits))
    # a point of the grid that nothing beats is exact, and the same whatever the refinement rounds
    good = np.flatnonzero(values >= top - ROUNDING * abs(top))
    if not len(good):
        good = np.flatnonzero(merits >= top - 1e-9 * abs(top))
    refined_first = good[good >= len(allowed)] if np.any(good >= len(allowed)) else good
    order = np.lexsort(np.round(candidates[refined_first], 9).T[::-1])
    chosen = refined_first[order[0]]
    return candidates[chosen], float(merits[chosen])


def _finite(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, -np.inf)


def _peaks(points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The best points that are apart from each other by more than a few percent of the box."""
    order = np.argsort(-values, kind="stable")
    span = np.maximum(np.ptp(points, axis=0), 1e-300)
    chosen: list[np.ndarray] = []
    for i in order[:400]:
        if all(np.max(np.abs(points[i] - c) / span) > 0.05 for c in chosen):
            chosen.append(points[i])
        if len(chosen) == STARTS:
            break
    return np.array(chosen)


def _zoom(region: Region, step: int, merit: Callable[[np.ndarray], np.ndarray], start: np.ndarray) -> np.ndarray | None:
    """One coordinate: around the best point so far, an even grid over its neighbours, again and again."""
    (low, high), best = region.bounds[0], float(start[0])
    half = (high - low) / 64
    while half > 1e-10 * (high - low):
        points = np.clip(best + half * np.linspace(-1, 1, 33), low, high)[:, None]
        values = np.where(region.allowed(step, points), _finite(merit(points)), -np.inf)
        if not np.isfinite(np.max(values)):
            return None
        best = float(points[int(np.argmax(values)), 0])
        half /= 12
    return np.array([best])


def _refine(
    region: Region, step: int, merit: Callable[[np.ndarray], np.ndarray], start: np.ndarray
) -> np.ndarray | None:
    from scipy.optimize import minimize

    bounds = region.bounds
    span = bounds[:, 1] - bounds[:, 0]
    free = np.flatnonzero(span > 0)
    scale = abs(float(merit(start[None])[0])) or 1.0
    if not len(free):
        return None

    def at(q: np.ndarray) -> np.ndarray:
        points = np.tile(bounds[:, 0], (len(q), 1))
        points[:, free] = bounds[free, 0] + q * span[free]
        return points

    def objective(q: np.ndarray) -> tuple[float, np.ndarray]:
        """Value and central-difference gradient from one batch of points, one-sided at the walls."""
        up, down = np.minimum(q + STEP, 1.0) - q, q - np.maximum(q - STEP, 0.0)
        points = np.concatenate([q[None], q + np.diag(up), q - np.diag(down)])
        values = -_finite(merit(at(points))) / scale
        values = np.where(np.isfinite(values), values, 1e10)
        d = len(q)
        return float(values[0]), (values[1 : d + 1] - values[d + 1 :]) / (up + down)

    q0 = (start - bounds[:, 0])[free] / span[free]
    box = [(0.0, 1.0)] * len(q0)
    if region.constraints:
        limits = {"type": "ineq", "fun": lambda q: -region.limits.sample(np.array([step]), at(q[None]))[0, :, 0]}
        found = minimize(objective, q0, jac=True, bounds=box, constraints=[limits], method="SLSQP", options=_FINE)
    else:
        found = minimize(objective, q0, jac=True, bounds=box, method="L-BFGS-B", options={"ftol": 1e-15, "gtol": 1e-9})
    place_found = _project(at(np.asarray(found.x)[None])[0], bounds)
    # the solver may end a hair outside of a curved constraint
    return place_found if region.allowed(step, place_found[None], 1e-9)[0] else None


def _find_allowed(region: Region, step: int, points: np.ndarray, name: str) -> np.ndarray:
    """One allowed location by minimising the violation, when the grid meets none."""
    from scipy.optimize import minimize

    def limits(p: np.ndarray) -> np.ndarray:
        return region.limits.sample(np.array([step]), p[None])[0, :, 0]

    def violation(p: np.ndarray) -> float:
        values = limits(p)
        return float(np.sum(np.maximum(values, 0.0) ** 2)) if np.all(np.isfinite(values)) else 1e10

    box = [tuple(b) for b in region.bounds]
    starts = sorted(points, key=violation)[:STARTS]
    # first a hair inside of the limits; a set without an inside is met to the solver's accuracy only
    for margin, slack in ((1e-9, 0.0), (0.0, 0.0), (0.0, 1e-7)):
        for start in starts:
            # the nearest allowed point
            found = minimize(
                lambda p, start=start: float(np.sum((p - start) ** 2)),
                start,
                bounds=box,
                constraints=[{"type": "ineq", "fun": lambda p, margin=margin: -limits(p) - margin}],
                method="SLSQP",
                options=_FINE,
            )
            p = _project(np.asarray(found.x), region.bounds)
            if region.allowed(step, p[None], slack)[0]:
                return p[None]
    raise InfeasibleError(
        f"at k = {step} no location of sensor '{name}' satisfies its constraints\n"
        "  hint: widen the bounds or a constraint"
    )
