"""What several sensors report together of a nonlinear plant: at an instant, or averaged over an interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from occontrol.families.athans.nonlinear.path import evaluate
from occontrol.families.athans.nonlinear.plant import FormulaPlant
from occontrol.families.athans.nonlinear.sensor import FormulaSensor
from occontrol.numerics.flow import Flow


@dataclass(frozen=True, eq=False)
class Readout:
    """Sensors that are read together, their values stacked.

    Parameters
    ----------
    plant : FormulaPlant with n states
    sensors : of it
    shares : one per sensor; its noise is divided by its share
    """

    plant: FormulaPlant
    sensors: Sequence[FormulaSensor]
    shares: Sequence[float]

    @cached_property
    def places(self) -> list[slice]:
        """Where the values of each sensor stand."""
        ends = np.cumsum([0, *(s.rows for s in self.sensors)])
        return [slice(a, b) for a, b in pairwise(ends.tolist())]

    @cached_property
    def rows(self) -> int:
        """The number m of values."""
        return sum(s.rows for s in self.sensors)

    @cached_property
    def angles(self) -> np.ndarray:
        """(m,) which values are angles."""
        return np.array([a for s in self.sensors for a in s.angles], dtype=bool)

    def values(self, points: np.ndarray, time: float) -> np.ndarray:
        """(K, m) h at K states `points` (K, n), in state units, at one time."""
        t = np.full(len(points), time)
        parts = [evaluate(s.values(), points, t)[:, :, 0] for s in self.sensors]
        return np.hstack([np.zeros((len(points), 0)), *parts])

    def slope(self, x: np.ndarray, time: float) -> np.ndarray:
        """(m, n) dh/dx at the state `x` (n,), in state units."""
        t = np.array([time])
        return np.vstack([np.zeros((0, len(x))), *(evaluate(s.slope(), x[None], t)[0] for s in self.sensors)])

    def covariance(self, x: np.ndarray, time: float) -> np.ndarray:
        """(m, m) of the readings' noise at the state `x` (n,), in state units."""
        R, t = np.zeros((self.rows, self.rows)), np.array([time])
        for sensor, place, share in zip(self.sensors, self.places, self.shares, strict=True):
            R[place, place] = evaluate(sensor.covariance(), x[None], t)[0] / share
        return R

    def seen(self, x: np.ndarray, time: float) -> list[bool]:
        """Which of the sensors see the state `x` (n,), in state units."""
        functions = [s.seen() for s in self.sensors]
        return [f is None or bool(evaluate(f, x[None], np.array([time]))[0, 0, 0] > 0) for f in functions]

    @cached_property
    def integrated(self) -> Flow:
        """The plant with int h dt as m further states: what averages over intervals are made of."""
        import casadi

        n, m = len(self.plant.names), self.rows
        x, t = casadi.SX.sym("x", n + m), casadi.SX.sym("t")
        state = x[:n]
        right = casadi.vertcat(self.plant.right(state, t), *(s.values()(state, t) for s in self.sensors))
        noise = casadi.diagcat(self.plant.flow.noise(state, t), casadi.SX.zeros(m, m))
        return Flow(
            casadi.Function("right", [x, t], [casadi.densify(right)]),
            casadi.Function("noise", [x, t], [casadi.densify(noise)]),
            n + m,
        )
