"""The data of a scheduling problem along a policy, on Gauss panels that respect every break of it.

Panels break at the edges of the schedule, the ends of the windows and the breakpoints of tables; inside them the data
is smooth, or the panels are halved until it is smooth enough. The state is balanced (see `balancing`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from occontrol.core.schedule import Schedule
from occontrol.core.scheduling import SchedulingProblem
from occontrol.numerics.gauss import gauss_nodes, tail
from occontrol.numerics.riccati_flow import (
    balancing,
    constant_transitions,
    fractional_factors,
    hamiltonian_matrices,
    norms,
    varying_transitions,
)

SNAP = 1e-9
SMALLEST = 1e-13


@dataclass(frozen=True, eq=False)
class Panels:
    """Panels of time and the interval of the policy that each lies in.

    starts, lengths : (P,);  interval : (P,) indices into the policy's weights
    """

    starts: np.ndarray
    lengths: np.ndarray
    interval: np.ndarray

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, part) -> Panels:
        return Panels(self.starts[part], self.lengths[part], self.interval[part])

    @property
    def node_times(self) -> np.ndarray:
        """(P, NODES) times of the Gauss nodes."""
        return self.starts[:, None] + self.lengths[:, None] * gauss_nodes()[0]

    def divide(self, counts: np.ndarray) -> Panels:
        """Panel p cut into counts[p] equal parts."""
        index = np.repeat(np.arange(len(self)), counts)
        place = np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)
        lengths = self.lengths[index] / counts[index]
        return Panels(self.starts[index] + place * lengths, lengths, self.interval[index])


@dataclass(frozen=True, eq=False)
class PolicyData:
    """A problem along a policy, in balanced coordinates x/d.

    Parameters
    ----------
    problem : SchedulingProblem
    edges : (K+1,) of the policy;  weights : (K, M) in the problem's order of sensors
    scale : (n,) d
    """

    problem: SchedulingProblem
    edges: np.ndarray
    weights: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, problem: SchedulingProblem, schedule: Schedule) -> PolicyData:
        """Columns in the problem's order; the scale from the largest data along the policy."""
        order = [schedule.names.index(name) for name in problem.sensors.names]
        plain = cls(problem, schedule.edges, schedule.weights[:, order], np.ones(problem.states))
        step = max(1, len(plain.weights) // 200)
        probe = plain.breaks()[::step]
        largest = np.max(np.abs(plain.matrices(probe)), axis=(0, 1))
        return replace(plain, scale=balancing(largest))

    @cached_property
    def constant(self) -> bool:
        """Whether nothing but the weights depends on time."""
        plant, sensors = self.problem.plant, self.problem.sensors
        return plant.A.constant and plant.noise.constant and all(s.C.constant and s.noise.constant for s in sensors)

    def breaks(self) -> Panels:
        """One panel between any two neighbouring breaks."""
        start, end = self.edges[0], self.edges[-1]
        slack = SNAP * max(abs(start), abs(end), end - start)
        inner = [s.breakpoints for s in self.problem.signals.values()]
        inner += [np.ravel(np.asarray(s.windows)) for s in self.problem.sensors if s.windows]
        candidates = np.unique(np.concatenate([*inner, np.empty(0)]))
        candidates = candidates[(candidates > start) & (candidates < end)]
        nearest = np.clip(np.searchsorted(self.edges, candidates), 1, len(self.edges) - 1)
        distance = np.minimum(candidates - self.edges[nearest - 1], self.edges[nearest] - candidates)
        points = np.unique(np.concatenate([self.edges, candidates[distance > slack]]))
        middles = (points[1:] + points[:-1]) / 2
        return Panels(points[:-1], np.diff(points), np.searchsorted(self.edges, middles) - 1)

    def whitened(self, j: int, times: np.ndarray) -> np.ndarray:
        """Theta^-1/2 C of sensor j at `times` (any shape), (..., m, n)."""
        sensor = self.problem.sensors[j]
        if sensor.is_idle:
            return np.zeros((*times.shape, 0, len(self.scale)))
        once = sensor.C.constant and sensor.noise.constant
        at = times.ravel()[:1] if once else times.ravel()
        white = np.linalg.solve(np.linalg.cholesky(sensor.noise.sample(at)), sensor.C.sample(at) * self.scale)
        shape = (*times.shape, *white.shape[1:])
        return np.broadcast_to(white[0], shape) if once else white.reshape(shape)

    def matrices(self, panels: Panels) -> np.ndarray:
        """The Hamiltonian matrices at the nodes (P, NODES, 2n, 2n); (P, 1, 2n, 2n) for constant data."""
        times = panels.node_times[:, :1] if self.constant else panels.node_times
        n, plant, d = len(self.scale), self.problem.plant, self.scale
        A = plant.A.sample(times.ravel()).reshape(*times.shape, n, n) * (d / d[:, None])
        noise = plant.noise.sample(times.ravel()).reshape(*times.shape, n, n) / (d * d[:, None])
        information = np.zeros((*times.shape, n, n))
        for j in range(len(self.problem.sensors)):
            weight = self.weights[panels.interval, j]
            used = np.flatnonzero(weight)
            if len(used):
                white = self.whitened(j, times[used])
                information[used] += weight[used, None, None, None] * (np.swapaxes(white, -1, -2) @ white)
        return hamiltonian_matrices(A, noise, information)

    def cost_rates(self, times: np.ndarray) -> np.ndarray:
        """q_j at `times`, (..., M)."""
        rates = [s.cost.sample(times.ravel()).reshape(times.shape) for s in self.problem.sensors]
        return np.stack(rates, axis=-1)

    def running(self, times: np.ndarray) -> np.ndarray:
        """R at `times`, (..., n, n)."""
        n, d = len(self.scale), self.scale
        assert self.problem.running is not None
        return self.problem.running.sample(times.ravel()).reshape(*times.shape, n, n) * (d * d[:, None])

    def room(self, panels: Panels) -> np.ndarray:
        """(P, M) largest weights in continuous time: 1 inside the windows, `select` for idle, or the policy's own."""
        middles = panels.starts + panels.lengths / 2
        room = np.ones((len(panels), len(self.problem.sensors)))
        for j, sensor in enumerate(self.problem.sensors):
            if sensor.is_idle:
                room[:, j] = self.problem.select
            elif sensor.windows is not None:
                room[:, j] = np.any([(a <= middles) & (middles <= b) for a, b in sensor.windows], axis=0)
        return np.maximum(room, self.weights[panels.interval])

    def resolve(self, panels: Panels, rtol: float) -> Panels:
        """Divide panels until every transition over a panel is accurate to rtol."""
        shortest = SMALLEST * (self.edges[-1] - self.edges[0])
        finished: list[Panels] = []
        while len(panels):
            unfinished = []
            for first in range(0, len(panels), 256):
                part = panels[first : first + 256]
                matrices = self.matrices(part)
                size = np.max(norms(matrices), axis=1)
                counts = np.ceil(part.lengths * size / (1.0 if self.constant else 0.5)).astype(int)
                counts = np.maximum(counts, 1)
                if not self.constant:
                    largest = np.max(np.abs(matrices), axis=(1, 2, 3))
                    ripple = np.max(tail(matrices), axis=(1, 2)) / np.where(largest > 0, largest, 1.0)
                    rough = ripple * part.lengths * size > 0.01 * rtol
                    counts = np.where((counts == 1) & rough, 2, counts)
                good = (counts == 1) | (part.lengths < shortest)
                finished.append(part[good])
                unfinished.append(part[~good].divide(counts[~good]))
            panels = Panels(
                *[np.concatenate([getattr(p, f) for p in unfinished]) for f in ("starts", "lengths", "interval")]
            )
        joined = Panels(*[np.concatenate([getattr(p, f) for p in finished]) for f in ("starts", "lengths", "interval")])
        return joined[np.argsort(joined.starts, kind="stable")]

    def factors(self, panels: Panels) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F, Gamma and B of all NODES + 1 steps of each panel, (P, NODES + 1, n, n) each."""
        matrices = self.matrices(panels)
        if self.constant:
            return fractional_factors(constant_transitions(panels.lengths, matrices[:, 0]))
        return fractional_factors(varying_transitions(panels.lengths, matrices))

    def prediction(self, rtol: float) -> tuple[np.ndarray, float]:
        """D Phi(Tp, T) (p, n), balanced, and tr(D int Phi(Tp, t) Xi Phi(Tp, t)' dt D') over (T, Tp]."""
        problem, n, d = self.problem, len(self.scale), self.scale
        transition, gathered = np.eye(n), np.zeros((n, n))
        end, predict_at = float(self.edges[-1]), float(problem.predict_at or 0.0)
        if predict_at > end:
            nothing = np.zeros((1, self.weights.shape[1]))
            after = replace(self, edges=np.array([end, predict_at]), weights=nothing)
            panels = after.resolve(after.breaks(), rtol)
            for k in range(len(panels)):
                F, _, driven = after.factors(panels[k : k + 1])
                for step, B in zip(F[0], driven[0], strict=True):
                    transition = step @ transition
                    gathered = step @ gathered @ step.T + B @ B.T
        output = problem.output.at(predict_at) * d
        return output @ transition, float(np.trace(output @ gathered @ output.T))
