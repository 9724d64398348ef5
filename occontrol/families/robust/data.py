"""Simulated data that the uncertainty description admits, and measurement files through the set-membership estimator.

Samples lie on a grid, `samples` to a slot; a value is held since the grid time before it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.arrange import arrange
from occontrol.core.errors import SolveFailed
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.trajectory import Trajectory
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.scattering import Flow
from occontrol.families.robust.set_membership import initial_states, propagate

SUBSTEPS = 8  # Runge-Kutta steps between two samples


def sample_grid(edges: np.ndarray, samples: int) -> np.ndarray:
    """The `edges` (N+1,) and, in between, equally spaced sampling times: (N*samples + 1,)."""
    share = np.arange(samples) / samples
    return np.append((edges[:-1, None] + np.diff(edges)[:, None] * share).ravel(), edges[-1])


def simulate_admissible(
    flow: Flow,
    plant: UncertainPlant,
    names: Sequence[str],
    edges: np.ndarray,
    sequence: Sequence[int],
    samples: int,
    seed: int,
) -> tuple[list[Measurement], Trajectory]:
    """A truth with a random norm-bounded uncertainty, and held samples that stay within its energy.

    dx/dt = (A + B D1 K) x, samples of (C + D2 K) x averaged over their interval, |[D1; D2]| <= 1, drawn anew in every
    interval. Holding a sample costs energy too; where that exceeds what is left, the uncertainty is drawn smaller.

    Parameters
    ----------
    flow, plant : the plant, its sensors and its energy
    names : sensor names
    edges, sequence : (N+1,) slot edges, (N,) their sensors
    samples : per slot
    seed : of the generator

    Raises SolveFailed where held samples differ from the output by more energy than the level allows.
    """
    grid = sample_grid(edges, samples)
    factor = 1.0
    for _ in range(60):
        values, x, spent = _draw(flow, plant, grid, np.repeat(np.asarray(sequence), samples), seed, factor)
        if np.all(spent <= plant.level):
            found = [
                Measurement(float(t), names[int(j)], y)
                for t, y, j in zip(grid[1:], values, np.repeat(sequence, samples), strict=True)
                if len(y)
            ]
            return found, Trajectory(grid, x)
        factor *= 0.85
    raise SolveFailed(
        "held samples differ from the output by more energy than the level allows\n"
        "  hint: raise horizon.samples: the output moves too much between two samples"
    )


def _draw(flow: Flow, plant: UncertainPlant, grid: np.ndarray, sensors: np.ndarray, seed: int, factor: float):
    """Samples, states at the grid (K+1, n) and the energy spent (K+1,), everything uncertain scaled by `factor`."""
    rng = np.random.default_rng(seed)
    n, p = flow.n, flow.B.shape[1]
    q = flow.K.shape[0]
    direction = rng.normal(size=n)
    root = np.linalg.cholesky(np.linalg.inv(plant.weight))
    radius = np.sqrt(plant.level) * rng.uniform() ** (1 / n) * factor
    x = plant.center + root @ direction / max(np.linalg.norm(direction), 1e-300) * radius
    states, values, spent = [x], [], [radius**2]
    for a, b, j in zip(grid[:-1], grid[1:], sensors, strict=True):
        C = flow.rows[j]
        m = C.shape[0]
        delta = rng.normal(size=(p + m, q))
        delta *= factor * rng.uniform() ** 0.3 / max(np.linalg.norm(delta, 2), 1e-300)
        h = (b - a) / SUBSTEPS
        times = a + h / 2 * np.arange(2 * SUBSTEPS + 1)
        times[-1] -= 1e-12 * (b - a)  # a table may jump at b
        A, B, K, Cs = (s.sample(times) for s in (flow.A, flow.B, flow.K, C))
        A = A + B @ delta[:p] @ K
        out = Cs + delta[p:] @ K
        # unknowns: x, int out x, int C x, int |C x|^2, int |w|^2 - |z|^2
        z = np.concatenate([x, np.zeros(2 * m + 2)])

        def rate(k: int, z: np.ndarray, A=A, K=K, Cs=Cs, out=out, delta=delta, m=m) -> np.ndarray:
            x = z[:n]
            seen, unseen = Cs[k] @ x, K[k] @ x
            w = delta[:p] @ unseen
            return np.concatenate([A[k] @ x, out[k] @ x, seen, [seen @ seen, w @ w - unseen @ unseen]])

        for s in range(SUBSTEPS):
            k1 = rate(2 * s, z)
            k2 = rate(2 * s + 1, z + h / 2 * k1)
            k3 = rate(2 * s + 1, z + h / 2 * k2)
            k4 = rate(2 * s + 2, z + h * k3)
            z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        x = z[:n]
        y = z[n : n + m] / (b - a)
        held = y @ y * (b - a) - 2 * y @ z[n + m : n + 2 * m] + z[-2]
        values.append(y)
        states.append(x)
        spent.append(spent[-1] + float(held + z[-1]))
    return values, np.array(states), np.array(spent)


def filter_samples(
    flow: Flow,
    plant: UncertainPlant,
    names: Sequence[str],
    edges: np.ndarray,
    sequence: Sequence[int],
    samples: int,
    measurements: Sequence[Measurement],
) -> Estimate:
    """The set of possible states at every sampling time.

    Parameters
    ----------
    flow, plant, names, samples : as in `simulate_admissible`
    edges, sequence : (N+1,) slot edges, (N,) their sensors
    measurements : in any order; a missing one leaves its interval without information

    Returns Estimate: mean is the center, standard_deviation the half width of the set along every state, covariance the
    shape times the level. Raises ProblemError naming line and mistake.
    """
    grid = sample_grid(edges, samples)
    used = np.repeat(np.asarray(sequence), samples)
    rows = [row.shape[0] for row in flow.rows]
    arrived = arrange(grid, names, rows, [(int(j),) for j in used], measurements)
    states = initial_states(float(grid[0]), plant.center, plant.weight, plant.level)
    path, missing, empty = [states], 0, None
    for k, j in enumerate(used):
        y = arrived[k].get(names[int(j)])
        if y is not None and np.any(np.isnan(y)):
            y = None
        missing += y is None and rows[j] > 0
        states = propagate(flow, states, float(grid[k + 1]), int(j), y)
        if states.level < 0 and empty is None:
            empty = states.time
        path.append(states)
    n, K = flow.n, len(path)
    notes = ["sd_x are half widths of the set of possible states, not standard deviations"]
    if missing:
        notes.append(f"{missing} of {len(used)} samples are missing: their intervals add no information")
    if empty is not None:
        notes.append(f"from t = {empty:g} on no admissible uncertainty explains the measurements: the set is empty")
    shapes = np.array([s.shape * max(s.level, 0.0) for s in path])
    half = np.array([s.half_widths for s in path])
    return Estimate(
        times=grid,
        mean=np.array([s.center for s in path]),
        standard_deviation=half,
        predicted=np.zeros((K, 0)),
        predicted_deviation=np.zeros((K, 0)),
        nis=np.full(K, np.nan),
        dimension=np.zeros(K, dtype=int),
        covariance=shapes.reshape(K, n, n),
        notes=tuple(notes),
    )
