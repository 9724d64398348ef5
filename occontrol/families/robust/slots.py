"""The scheduling problem of robust switching as a table: one span element per slot and sensor.

Unknown: a sequence of sensors, (N,) integers. In the coordinates N = (P^-1 - X)^-1 every slot is an ordinary,
monotone and concave Kalman flow, and N(T) = P(T): the whole search works on this table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.escape import free_weights, smallest
from occontrol.families.robust.game import center_weight, from_ordinary, ordinary_elements, ordinary_start
from occontrol.families.robust.prepared_spans import PreparedSpans
from occontrol.families.robust.scattering import Element, Flow, advance

if TYPE_CHECKING:
    from occontrol.families.robust.problem import Problem


@dataclass(frozen=True, eq=False)
class Slots:
    """Every slot with every sensor, and what is to be minimised.

    Parameters
    ----------
    flow : Flow
    edges : (N+1,) slot edges
    free : (N+1, n, n) X at the edges, zero at the last
    start : (n, n) N at edges[0]
    element : arrays (N, M, n, n): F, Q, R of N over each slot with each sensor
    size : Size
    level : d + x0'Y(0)x0
    """

    flow: Flow
    edges: np.ndarray
    free: np.ndarray
    start: np.ndarray
    element: Element
    size: Size
    level: float

    @cached_property
    def spans(self) -> PreparedSpans:
        """The slots, ready to be walked with many mixtures of sensors."""
        return PreparedSpans(self.flow, self.edges[:-1], self.edges[1:])

    @property
    def count(self) -> int:
        """The number N of slots."""
        return len(self.edges) - 1

    @property
    def sensors(self) -> int:
        """The number M of sensors."""
        return self.element[0].shape[1]

    def of(self, slot: int, sensors: np.ndarray | int) -> Element:
        """The elements of one slot with the given sensors. `sensors` is one position or (k,) positions."""
        return tuple(part[slot, sensors] for part in self.element)  # type: ignore[return-value]

    def tail(self, slot: int, start: np.ndarray, level: float) -> Slots:
        """The problem from `slot` on, with another N there and another level. `start` is that N (n, n)."""
        element = tuple(part[slot:] for part in self.element)
        return Slots(self.flow, self.edges[slot:], self.free[slot:], start, element, self.size, level)  # type: ignore[arg-type]

    def ordinary(self, sequence: Sequence[int]) -> np.ndarray:
        """N (N+1, n, n) at the edges along a sequence."""
        N = [self.start]
        for slot, sensor in enumerate(sequence):
            N.append(advance(N[-1], self.of(slot, sensor)))
        return np.array(N)

    def shapes(self, sequence: Sequence[int]) -> np.ndarray:
        """P (N+1, n, n) at the edges along a sequence."""
        return from_ordinary(self.ordinary(sequence), self.free)

    def costs(self, sequences: np.ndarray) -> np.ndarray:
        """(R,) sizes at the end of R sequences (R, N)."""
        N = np.broadcast_to(self.start, (len(sequences), *self.start.shape))
        for slot in range(self.count):
            N = advance(N, self.of(slot, sequences[:, slot]))
        return self.size.value(N, self.level)

    def cost(self, sequence: Sequence[int] | np.ndarray) -> float:
        """The size at the end of one sequence. `sequence` (N,)."""
        return float(self.costs(np.asarray(sequence, dtype=int).reshape(1, -1))[0])


def slot_table(
    flow: Flow, edges: np.ndarray, weight: np.ndarray, center: np.ndarray, level: float, size: Size
) -> Slots | None:
    """The table, or None when the plant is not uniformly robustly observable on [edges[0], edges[-1]].

    Parameters
    ----------
    flow : Flow with M sensors
    edges : (N+1,) slot edges
    weight, center, level : X0 (n, n), x0 (n,), d
    size : Size
    """
    free = free_weights(flow, edges)
    if free is None or smallest(weight - free[0]) <= 0:
        return None
    N, M = len(edges) - 1, len(flow.rows)
    starts, ends = np.repeat(edges[:-1], M), np.repeat(edges[1:], M)
    game = flow.elements(starts, ends, np.tile(np.eye(M), (N, 1)))
    ordinary = ordinary_elements(game, np.repeat(free[:-1], M, axis=0), np.repeat(free[1:], M, axis=0))
    F, Q, R = (np.ascontiguousarray(part.reshape(N, M, flow.n, flow.n)) for part in ordinary)
    Y = center_weight(free[0], np.linalg.inv(weight))
    return Slots(
        flow,
        np.asarray(edges, dtype=float),
        free,
        ordinary_start(weight, free[0]),
        (F, Q, R),
        size,
        float(level + center @ Y @ center),
    )


def table_of(problem: Problem) -> Slots | None:
    """Every slot of a problem with every sensor; None when the plant is not uniformly robustly observable.

    Parameters
    ----------
    problem : Problem
    """
    plant = problem.plant
    return slot_table(problem.flow, problem.edges, plant.weight, plant.center, plant.level, problem.measure)


def one_step(slots: Slots, weight: np.ndarray, center: np.ndarray, level: float) -> list[int]:
    """The one-step-ahead rule: at each edge the sensor whose set is smallest at the next edge.

    c_i = size(P^i(t_{j+1}), d + x0'Y(0)x0) with Y(t_{j+1}) = 0, so the level grows with j.
    Savkin, Evans & Skafidas, theorem 4.1.

    `weight` X0 (n, n), `center` x0 (n,).
    """
    P, picked = np.linalg.inv(weight), []
    everything = np.tile(np.eye(slots.sensors), (slots.count, 1))
    starts, ends = np.repeat(slots.edges[:-1], slots.sensors), np.repeat(slots.edges[1:], slots.sensors)
    game = tuple(p.reshape(slots.count, slots.sensors, *P.shape) for p in slots.flow.elements(starts, ends, everything))
    for j in range(slots.count):
        X = free_weights(slots.flow, slots.edges[: j + 2])
        assert X is not None  # it exists up to T
        Y = center_weight(X[0], np.linalg.inv(weight))
        after = advance(P, tuple(part[j] for part in game))  # type: ignore[arg-type]
        sizes = slots.size.value(after, float(level + center @ Y @ center))
        picked.append(int(np.argmin(sizes)))
        P = after[picked[-1]]
    return picked


def exchange(slots: Slots, sequence: Sequence[int], rounds: int = 50) -> tuple[list[int], float]:
    """Change one slot at a time, or swap two neighbours, while the size falls: an upper bound that is hard to beat."""
    best = np.array(sequence, dtype=int)
    cost = slots.cost(best)
    for _ in range(rounds):
        trials = []
        for slot in range(slots.count):
            for sensor in range(slots.sensors):
                if sensor != best[slot]:
                    trial = best.copy()
                    trial[slot] = sensor
                    trials.append(trial)
            for other in range(slot + 1, min(slot + 4, slots.count)):
                if best[other] != best[slot]:
                    trial = best.copy()
                    trial[[slot, other]] = trial[[other, slot]]
                    trials.append(trial)
        if not trials:
            break
        costs = slots.costs(np.array(trials))
        k = int(np.argmin(costs))
        if not costs[k] < cost * (1 - 1e-14):
            break
        best, cost = trials[k], float(costs[k])
    return [int(i) for i in best], cost
