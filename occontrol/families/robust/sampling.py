"""Many admissible truths at once, each with the center and level that its own measurements give.

Unknowns, R samples: x (R, n), center (R, n), spent energy rho (R,). The uncertainty of each sample is norm-bounded,
w = D1 z, v = D2 z with |[D1; D2]| <= 1: drawn anew in every part of a slot, constant, or pushing x away from its center
as hard as it may (the worst case, which depends on x and so on the time). A fourth kind starts at the center and spends
its whole energy on a push during one slot. Measurements are continuous here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.history import history
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.scattering import Flow


@dataclass(frozen=True, eq=False)
class Truths:
    """R admissible truths over time.

    Parameters
    ----------
    times : (K,)
    shape : (K, n, n) P
    states, centers : (K, R, n)
    level : (K, R) d + rho of the sample's own measurements
    """

    times: np.ndarray
    shape: np.ndarray
    states: np.ndarray
    centers: np.ndarray
    level: np.ndarray

    @property
    def share(self) -> np.ndarray:
        """(K, R) (x - center)' P^-1 (x - center)/level: at most 1."""
        away = self.states - self.centers
        return np.einsum("kri,kij,krj->kr", away, np.linalg.inv(self.shape), away) / self.level


def sample_truths(
    flow: Flow,
    plant: UncertainPlant,
    edges: np.ndarray,
    sequence: Sequence[int],
    count: int,
    seed: int = 0,
    steps: int = 20,
) -> Truths:
    """Integrate `count` admissible truths and their estimators along a sequence of sensors.

    Parameters
    ----------
    flow, plant : the plant and its sensors, its energy
    edges, sequence : (N+1,) slot edges, (N,) their sensors
    count : R
    seed : of the generator
    steps : Runge-Kutta steps per slot
    """
    rng = np.random.default_rng(seed)
    n, p, q = flow.n, flow.B.shape[1], flow.K.shape[0]
    along = history(flow, edges, sequence, plant.weight, plant.center, plant.level, Size.of("trace"), 2 * steps)
    inverse = np.linalg.inv(along.shape)
    root = np.linalg.cholesky(np.linalg.inv(plant.weight))
    direction = rng.normal(size=(count, n))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    radius = np.where(rng.uniform(size=count) < 0.5, 1.0, rng.uniform(size=count) ** (1 / n))
    kind = np.arange(count) % 4
    radius = np.where(kind == 3, 0.0, radius)
    pushed = rng.integers(len(sequence), size=count)
    push_along = rng.normal(size=(count, p))
    push_along /= np.maximum(np.linalg.norm(push_along, axis=1, keepdims=True), 1e-300)
    push_along *= np.sqrt(plant.level / np.diff(edges)[pushed])[:, None]
    x = plant.center + np.sqrt(plant.level) * (direction * radius[:, None]) @ root.T
    z = np.concatenate([x, np.tile(plant.center, (count, 1)), np.zeros((count, 1))], axis=1)
    widest = max(row.shape[0] for row in flow.rows) if flow.rows else 0
    delta = _draw(rng, count, p + widest, q)
    path = [z]
    for k in range(0, len(along.times) - 1, 2):
        sensor = sequence[k // (2 * steps)]
        row = flow.rows[sensor]
        times = along.times[k : k + 3].copy()
        times[2] -= 1e-12 * (times[2] - times[0])  # a table may jump at the end
        A, B, K, C = (s.sample(times) for s in (flow.A, flow.B, flow.K, row))
        if (k // 2) % max(1, steps // 4) == 0:
            fresh = _draw(rng, count, p + widest, q)
            delta = np.where((kind == 0)[:, None, None], fresh, delta)
        m, blow = row.shape[0], np.where((pushed == k // (2 * steps))[:, None], push_along, 0.0)

        def rate(s: int, z: np.ndarray, A=A, B=B, K=K, C=C, k=k, m=m, delta=delta, blow=blow) -> np.ndarray:
            P, inv = along.shape[k + s], inverse[k + s]
            x, c = z[:, :n], z[:, n : 2 * n]
            unseen = x @ K[s].T
            w = np.einsum("rij,rj->ri", delta[:, :p], unseen)
            v = np.einsum("rij,rj->ri", delta[:, p : p + m], unseen)
            push = (x - c) @ inv @ B[s]
            push *= (np.linalg.norm(unseen, axis=1) / np.maximum(np.linalg.norm(push, axis=1), 1e-300))[:, None]
            w = np.where((kind == 2)[:, None], push, w)
            w = np.where((kind == 3)[:, None], blow, w)
            v = np.where((kind >= 2)[:, None], 0.0, v)
            y = x @ C[s].T + v
            miss, seen = c @ C[s].T - y, c @ K[s].T
            dc = c @ A[s].T + (seen @ K[s] - miss @ C[s]) @ P
            rho = np.sum(seen**2, axis=1) - np.sum(miss**2, axis=1)
            return np.concatenate([x @ A[s].T + w @ B[s].T, dc, rho[:, None]], axis=1)

        h = along.times[k + 2] - along.times[k]
        k1 = rate(0, z)
        k2 = rate(1, z + h / 2 * k1)
        k3 = rate(1, z + h / 2 * k2)
        z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(2, z + h * k3))
        path.append(z)
    whole = np.array(path)
    return Truths(
        along.times[::2], along.shape[::2], whole[:, :, :n], whole[:, :, n : 2 * n], plant.level + whole[:, :, 2 * n]
    )


def _draw(rng: np.random.Generator, count: int, rows: int, columns: int) -> np.ndarray:
    """(count, rows, columns) of spectral norm 1."""
    raw = rng.normal(size=(count, rows, columns))
    return raw / np.linalg.norm(raw, 2, axis=(1, 2))[:, None, None]
