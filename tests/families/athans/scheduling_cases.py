"""Small problems for the filters, and policies to follow."""

from __future__ import annotations

import numpy as np

from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.families.athans.problem import SchedulingProblem


def moving(intervals: int = 40, select: int = 1, end: float = 4.0) -> SchedulingProblem:
    """Two states, everything time-varying, a known input, three sensors and idle, prediction beyond the end."""
    plant = LinearPlant(
        A=[[0, 1], ["-(1 + 0.3*sin(t))", -0.4]],
        noise=[[0.02, 0.01], [0.01, "0.3 + 0.1*cos(t)"]],
        covariance=[[2.0, 0.3], [0.3, 1.0]],
        mean=[1.0, -0.5],
        B=[[0], [1]],
        input=["0.7*sin(2*t)"],
    )
    sensors = [
        Sensor("place", [[1, 0]], 0.2, 1.0),
        Sensor("speed", [["0.2*t", 1]], "0.3 + 0.05*t", 0.5),
        Sensor("both", [[1, 0], [0.3, "cos(t)"]], [[0.5, 0.1], [0.1, 0.4]], 1.5),
        idle_sensor(2),
    ]
    edges = np.linspace(0, end, intervals + 1)
    edges[1:-1] += 0.2 * (end / intervals) * np.sin(np.arange(1, intervals))  # uneven
    return SchedulingProblem("moving", plant, sensors, edges, [[1, 0], ["t", 1]], 5.5, 0.1, None, select)


def cycling(problem: SchedulingProblem, shift: int = 0) -> Schedule:
    """Every interval the next available sensor (or the next `select` of them)."""
    weights = np.zeros((problem.intervals, len(problem.sensors)))
    for k in range(problem.intervals):
        able = np.flatnonzero(problem.upper[k] > 0)
        for i in range(problem.select):
            weights[k, able[(k + shift + i) % len(able)]] += 1
    return Schedule(problem.edges, weights, tuple(problem.sensors.names))


def blocks(problem: SchedulingProblem, edges: np.ndarray, count: int) -> Schedule:
    """The available sensors in turn, each for 1/count of the horizon, on any grid."""
    middle = (edges[1:] + edges[:-1]) / 2
    block = ((middle - edges[0]) / (edges[-1] - edges[0]) * count).astype(int)
    weights = np.eye(len(problem.sensors))[block % len(problem.sensors)]
    return Schedule(edges, weights, tuple(problem.sensors.names))
