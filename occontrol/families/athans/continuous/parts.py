"""Parts of a plant that nothing couples, each with the flow of its own, and what they say together.

Where A, Xi, Sigma0 and every C_j' Theta_j^-1 C_j are block diagonal, so is the covariance, and only the diagonal blocks
of the costate matter: tr(L_j Sigma P Sigma) = sum_b tr(L_jb Sigma_b P_b Sigma_b). A formula of time that is no number
counts as something that couples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.polynomial import legendre

from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor, SensorSuite
from occontrol.core.signal import ConstantSignal, ExpressionSignal, Signal, TableSignal
from occontrol.families.athans.continuous.panels import Panels, PolicyData
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.gauss import NODES, legendre_coefficients

SPLIT = 12  # states from which parts are looked for
SAME = 1e-14  # of the diagonal: an entry of C' Theta^-1 C that is rounding
TOGETHER = 1e-13  # of the horizon: ends of panels that are the same


@dataclass(frozen=True, eq=False)
class PartProblem:
    """As much of a problem as the flow of some of its states needs; its sensors cost nothing.

    Parameters
    ----------
    plant : LinearPlant of these states
    sensors : that see them
    output : D at `predict_at`, their columns
    predict_at, running, select, cost_weight : as in the problem
    """

    plant: LinearPlant
    sensors: SensorSuite
    output: Signal
    predict_at: float | None
    running: Signal | None
    select: int
    cost_weight: float = 0.0

    @property
    def states(self) -> int:
        """n"""
        return self.plant.states

    @cached_property
    def signals(self) -> dict[tuple[str | int, ...], Signal]:
        """Every time function by its place."""
        named: dict[tuple[str | int, ...], Signal] = {("plant", k): s for k, s in self.plant.signals.items()}
        for j, sensor in enumerate(self.sensors):
            named |= {("sensors", j, k): s for k, s in sensor.signals.items()}
        if self.running is not None:
            named[("objective", "running")] = self.running
        return named


@dataclass(frozen=True, eq=False)
class Part:
    """Some states of a problem along a policy.

    Parameters
    ----------
    data : PolicyData of them
    states : (n,) which states of the whole
    columns : (M,) which sensors of the whole
    """

    data: PolicyData
    states: np.ndarray
    columns: np.ndarray


def parts_of(problem: SchedulingProblem, schedule: Schedule) -> list[Part]:
    """The parts of a problem of many states along a policy; empty where it does not fall into small ones.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule of its sensors
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    n = problem.states
    if n < SPLIT:
        return []
    seen = [_seen(sensor) for sensor in problem.sensors]
    pattern = np.any([_pattern(problem.plant.A), _pattern(problem.plant.noise), problem.plant.covariance != 0], axis=0)
    for information in seen:
        pattern = pattern | information
    count, label = connected_components(csr_array(pattern | pattern.T), directed=False)
    if count < 2 or 2 * int(np.max(np.bincount(label))) > n:
        return []
    found = []
    for b in range(count):
        states = np.flatnonzero(label == b)
        columns = np.array([j for j, x in enumerate(seen) if np.any(x[states])] or [0])
        part = _part(problem, states, columns, seen)
        found.append(Part(PolicyData.of(cast(SchedulingProblem, part), schedule), states, columns))
    return found


def _part(
    problem: SchedulingProblem, states: np.ndarray, columns: np.ndarray, seen: Sequence[np.ndarray]
) -> PartProblem:
    plant, n = problem.plant, len(states)
    sensors = []
    for j in columns:
        sensor = problem.sensors[j]
        rows = np.arange(sensor.rows) if np.any(seen[j][states]) else np.zeros(0, dtype=np.int64)
        C, noise = _cut(sensor.C, rows, states), _cut(sensor.noise, rows, rows)
        if not len(rows):
            C, noise = ConstantSignal(np.zeros((0, n))), ConstantSignal(np.zeros((0, 0)))
        sensors.append(Sensor(sensor.name, C, noise, windows=sensor.windows))
    D = problem.output.at(float(problem.predict_at or 0.0))[:, states]
    D = D[np.any(D != 0, axis=1)]
    return PartProblem(
        LinearPlant(_cut(plant.A, states, states), _cut(plant.noise, states, states),
                    plant.covariance[np.ix_(states, states)]),
        SensorSuite(tuple(sensors)), ConstantSignal(D if len(D) else np.zeros((1, n))), problem.predict_at,
        None if problem.running is None else _cut(problem.running, states, states), problem.select,
    )  # fmt: skip


def _pattern(signal: Signal) -> np.ndarray:
    """Where a signal may be other than zero."""
    if isinstance(signal, ConstantSignal):
        return signal.value != 0
    if isinstance(signal, TableSignal):
        return np.any(signal.values != 0, axis=0)
    if isinstance(signal, ExpressionSignal):
        found = np.array([[isinstance(e, str) or e != 0 for e in row] for row in signal.entries], dtype=bool)
        return found.reshape(signal.shape)
    return np.ones(signal.shape, dtype=bool)


def _seen(sensor: Sensor) -> np.ndarray:
    """(n, n) which states a sensor tells about, and couples."""
    if sensor.C.constant and sensor.noise.constant:
        C = sensor.C.at(0.0)
        information = C.T @ np.linalg.solve(sensor.noise.at(0.0), C) if len(C) else np.zeros((C.shape[1], C.shape[1]))
        size = np.sqrt(np.maximum(np.diag(information), 0.0))
        return np.abs(information) > SAME * np.outer(size, size)
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    rows, label = _pattern(sensor.C), connected_components(csr_array(_pattern(sensor.noise)), directed=False)[1]
    together = label[:, None] == label
    return (rows.T.astype(float) @ together @ rows) > 0


def _cut(signal: Signal, rows: np.ndarray, columns: np.ndarray) -> Signal:
    """Some rows and columns of a signal."""
    if isinstance(signal, TableSignal):
        return TableSignal(signal.times, signal.values[:, rows[:, None], columns], signal.interpolation)
    if isinstance(signal, ExpressionSignal):
        return ExpressionSignal(tuple(tuple(signal.entries[i][j] for j in columns) for i in rows), signal.variable)
    return ConstantSignal(signal.at(0.0)[np.ix_(rows, columns)])


def together(
    edges: np.ndarray, sensors: int, given: Sequence[tuple[Panels, np.ndarray, np.ndarray]]
) -> tuple[Panels, np.ndarray]:
    """The sum (P, NODES, M) of polynomials on several divisions of time, on panels that respect them all.

    Parameters
    ----------
    edges : (K+1,) of the policy, ends of panels in every division
    sensors : M
    given : panels, values (p, NODES, m) at their nodes, and columns (m,) of every division
    """
    end = float(edges[-1])
    points = np.sort(np.concatenate([np.append(panels.starts, end) for panels, _, _ in given]))
    points = points[np.append(True, np.diff(points) > TOGETHER * (end - edges[0]))]
    points[-1] = end
    middles = (points[1:] + points[:-1]) / 2
    common = Panels(points[:-1], np.diff(points), np.searchsorted(edges, middles) - 1)
    found = np.zeros((len(common), NODES, sensors))
    for panels, values, columns in given:
        owner = np.searchsorted(panels.starts, middles, side="right") - 1
        x = (common.node_times - panels.starts[owner, None]) / panels.lengths[owner, None]
        found[:, :, columns] += legendre.legvander(2 * x - 1, NODES - 1) @ legendre_coefficients(values)[owner]
    return common, found
