"""A problem of readings as a chain for many runs at once: span 0, reading 0, span 1, reading 1, ..., span N.

Every product is a stack of small ones, one a run, so that a run has the same numbers to the last bit whatever runs
stand beside it. Linear plants have the same maps for all runs, nonlinear ones the maps at each run's own state.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.families.athans.nonlinear.index import Stages, stages
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.families.athans.readings.fill import terminal_output
from occontrol.families.athans.readings.filter import between
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.scope import require_traces
from occontrol.numerics.many_paths import Columns, across


@dataclass(frozen=True, eq=False)
class Seen:
    """What one sensor reports of B states.

    Parameters
    ----------
    value : (B, m) without its noise, in measurement units
    slope : (B, m, n)
    noise : (B, m, m) covariance
    visible : (B,) whether the sensor sees the state
    """

    value: np.ndarray
    slope: np.ndarray
    noise: np.ndarray
    visible: np.ndarray


class Chain(Protocol):
    """Spans and readings of a problem with N readings, M sensors and n states."""

    problem: ReadingsProblem

    @property
    def rows(self) -> tuple[int, ...]:
        """How many values each sensor has."""
        ...

    def span(self, i: int, states: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where B `states` (B, n) are after span i, with F and Q (B, n, n)."""
        ...

    def seen(self, i: int, j: int, states: np.ndarray) -> Seen:
        """What sensor j reports of `states` (B, n) at reading i."""
        ...

    def angles(self, j: int) -> np.ndarray:
        """(m,) which values of sensor j are angles."""
        ...

    def output(self, states: np.ndarray) -> np.ndarray:
        """(B, p) what `states` (B, n) after the last span lead the output to be, without further noise."""
        ...


class LinearChain:
    """The chain of a linear plant.

    Parameters
    ----------
    problem : ReadingsProblem
    """

    def __init__(self, problem: ReadingsProblem):
        self.problem = problem
        self.F, self.g, self.Q = between(problem)
        times = problem.clock.times
        self.sensors = [(s.C.sample(times), s.noise.sample(times)) for s in problem.sensors]
        self._output = terminal_output(problem)[0]

    @property
    def rows(self) -> tuple[int, ...]:
        """How many values each sensor has."""
        return tuple(s.rows for s in self.problem.sensors)

    def span(self, i: int, states: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where B `states` (B, n) are after span i, with F and Q (B, n, n)."""
        B, n = states.shape
        F, Q = np.broadcast_to(self.F[i], (B, n, n)), np.broadcast_to(self.Q[i], (B, n, n))
        return product(F, states) + self.g[i], F, Q

    def seen(self, i: int, j: int, states: np.ndarray) -> Seen:
        """What sensor j reports of `states` (B, n) at reading i."""
        C, R = (part[i] for part in self.sensors[j])
        B = len(states)
        slope = np.broadcast_to(C, (B, *C.shape))
        return Seen(product(slope, states), slope, np.broadcast_to(R, (B, *R.shape)), np.ones(B, dtype=bool))

    def angles(self, j: int) -> np.ndarray:
        """(m,) none of a linear sensor's values is an angle."""
        return np.zeros(self.rows[j], dtype=bool)

    def output(self, states: np.ndarray) -> np.ndarray:
        """(B, p) what `states` (B, n) after the last span lead the output to be: its squared length is charged."""
        return product(np.broadcast_to(self._output, (len(states), *self._output.shape)), states)


class NonlinearChain:
    """The chain of a plant given by formulas, linearised at each state anew.

    Parameters
    ----------
    problem : ReadingsProblem with a linearised plant
    """

    def __init__(self, problem: ReadingsProblem):
        self.problem = problem
        self.stages: Stages = stages(problem)
        origin = self.stages.origin
        self.flow = origin.plant.flow
        self.sensors = [origin.sensors.get(s.name) for s in problem.sensors]
        self._reports: dict[int, Columns] = {}
        self.last = problem.readings + (0 if problem.discrete and problem.at == "posterior" else 1)

    @cached_property
    def rows(self) -> tuple[int, ...]:
        """How many values each sensor has."""
        return tuple(0 if s is None else s.rows for s in self.sensors)

    def span(self, i: int, states: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where B `states` (B, n) are after span i, with F and Q (B, n, n)."""
        length = float(self.stages.lengths[i]) if i < self.last else 0.0
        return across(self.flow, states, float(self.stages.since[i]), length, self.stages.substeps)

    def seen(self, i: int, j: int, states: np.ndarray) -> Seen:
        """What sensor j reports of `states` (B, n) at reading i."""
        sensor, B = self.sensors[j], len(states)
        if sensor is None:
            n = states.shape[1]
            return Seen(np.zeros((B, 0)), np.zeros((B, 0, n)), np.zeros((B, 0, 0)), np.ones(B, dtype=bool))
        n, m = states.shape[1], sensor.rows
        if j not in self._reports:
            self._reports[j] = Columns(sensor.report())
        t = np.full((B, 1), float(self.stages.times[i]))
        value, slope, noise, there = self._reports[j](states, t)
        slope = np.swapaxes(slope.reshape(B, n, m), 1, 2)
        return Seen(value, slope, np.swapaxes(noise.reshape(B, m, m), 1, 2), there[:, 0] > 0)

    def angles(self, j: int) -> np.ndarray:
        """(m,) which values of sensor j are angles."""
        sensor = self.sensors[j]
        return np.zeros(0, dtype=bool) if sensor is None else np.array(sensor.angles, dtype=bool)

    def output(self, states: np.ndarray) -> np.ndarray:
        """(B, p) D x at the time that is predicted, from `states` (B, n) after the last span."""
        D = self.problem.output.at(self.problem.output_at)
        lengths, N = self.stages.lengths, self.problem.readings
        for i in range(N + 1, 0 if self.problem.discrete else len(lengths)):
            states = self.flow.advance(states.T, float(self.stages.since[i]), float(lengths[i]), self.stages.substeps).T
        return product(np.broadcast_to(D, (len(states), *D.shape)), states)


def chain_of(problem: ReadingsProblem) -> LinearChain | NonlinearChain:
    """The chain of a problem of readings.

    Parameters
    ----------
    problem : ReadingsProblem

    Raises UsageError for continuous sensing, other criteria than the trace, and what has no prior or no end.
    """
    require_traces(problem, "simulated runs in closed loop")
    if not problem.takes_readings:
        hint = "horizon: {steps: ..}, or sensing: samples"
        raise UsageError(f"runs are simulated of readings at instants, not of continuous sensing\n  hint: {hint}")
    return LinearChain(problem) if linearisation_of(problem) is None else NonlinearChain(problem)


def product(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(B, r) products of B matrices (B, r, n) with B vectors (B, n), each by itself."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
