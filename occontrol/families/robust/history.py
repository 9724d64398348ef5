"""The set of possible states over time along a sequence: its shape, and the largest that measurements can make it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.game import center_weight
from occontrol.families.robust.scattering import Flow, advance, star

PARTS = 12  # of a slot


@dataclass(frozen=True, eq=False)
class History:
    """Along a sequence, at finely spaced times.

    Parameters
    ----------
    times : (K,)
    shape : (K, n, n) P
    level : (K,) the largest d + rho that measurements up to then can bring
    size : (K,) the size with that level
    """

    times: np.ndarray
    shape: np.ndarray
    level: np.ndarray
    size: np.ndarray


def history(
    flow: Flow,
    edges: np.ndarray,
    sequence: Sequence[int],
    weight: np.ndarray,
    center: np.ndarray,
    level: float,
    size: Size,
    parts: int = 0,
) -> History:
    """Shape, level and size over time.

    Parameters
    ----------
    flow : Flow
    edges : (N+1,) slot edges
    sequence : (N,) sensors
    weight, center, level : X0 (n, n), x0 (n,), d
    size : Size
    parts : times per slot; 0 chooses
    """
    count = len(sequence)
    parts = parts or max(1, min(PARTS, 2000 // count))
    share = np.linspace(0, 1, parts + 1)[:-1]
    times = np.append((edges[:-1, None] + np.diff(edges)[:, None] * share).ravel(), edges[-1])
    chosen = np.zeros((len(times) - 1, len(flow.rows)))
    chosen[np.arange(len(chosen)), np.repeat(np.asarray(sequence, dtype=int), parts)] = 1.0
    game = flow.elements(times[:-1], times[1:], chosen)
    free = flow.elements(times[:-1], times[1:])
    start = np.linalg.inv(weight)
    shapes, levels = [start], [float(level)]
    total = None
    for k in range(len(times) - 1):
        shapes.append(advance(shapes[-1], tuple(part[k] for part in game)))  # type: ignore[arg-type]
        span = tuple(part[k] for part in free)
        total = span if total is None else star(total, span)  # type: ignore[arg-type]
        levels.append(float(level + center @ center_weight(-total[2], start) @ center))
    shape, top = np.array(shapes), np.array(levels)
    return History(times, shape, top, size.value(shape, top))
