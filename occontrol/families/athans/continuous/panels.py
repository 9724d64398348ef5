"""The data of a scheduling problem along a policy, on Gauss panels that respect every break of it.

Panels break at the edges of the schedule, the ends of the windows and the breakpoints of tables; inside them the data
is smooth, or the panels are halved until it is smooth enough. The state is balanced (see `balancing`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from occontrol.core.clock import elapsed, nearest_edge
from occontrol.core.errors import SolveFailed
from occontrol.core.schedule import Schedule
from occontrol.core.signal import Signal
from occontrol.families.athans.integration.features import features
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.balance import balancing
from occontrol.numerics.gauss import gauss_nodes, legendre_coefficients, legendre_powers, tail
from occontrol.numerics.riccati_flow import fractional, hamiltonian_matrices, norms, transitions

SMALLEST = 1e-13
MOST_PANELS = 1_000_000
SAME_BITS = 36
LEAST_WEIGHT = 0.01
NOISE = 3e-14


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
        """Panel p cut into `counts`[p] equal parts; counts is (P,) integers."""
        index = np.repeat(np.arange(len(self)), counts)
        place = np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)
        lengths = self.lengths[index] / counts[index]
        return Panels(self.starts[index] + place * lengths, lengths, self.interval[index])

    @classmethod
    def joined(cls, parts: list[Panels]) -> Panels:
        """Panels of several lists in the order of time."""
        whole = cls(*[np.concatenate([getattr(p, f) for p in parts]) for f in ("starts", "lengths", "interval")])
        return whole[np.argsort(whole.starts, kind="stable")]


@dataclass(frozen=True, eq=False)
class PolicyData:
    """A problem along a policy, in balanced coordinates x/d.

    Parameters
    ----------
    problem : SchedulingProblem
    edges : (K+1,) of the policy, counted from the origin, as all times here
    weights : (K, M) in the problem's order of sensors
    scale : (n,) d
    origin : time at which the horizon starts
    """

    problem: SchedulingProblem
    edges: np.ndarray
    weights: np.ndarray
    scale: np.ndarray
    origin: float

    @classmethod
    def of(cls, problem: SchedulingProblem, schedule: Schedule) -> PolicyData:
        """Columns in the problem's order; the scale from the largest data along the policy."""
        order = [schedule.names.index(name) for name in problem.sensors.names]
        edges, origin = elapsed(schedule.edges), float(schedule.edges[0])
        plain = cls(problem, edges, schedule.weights[:, order], np.ones(problem.states), origin)
        # every sensor counts with the largest weight that it has anywhere, and a little if it is never used: a state
        # that seems unmeasured where the data is probed would be scaled by far too much
        weights = np.maximum(np.max(plain.weights, axis=0), LEAST_WEIGHT)
        probe = plain.breaks()
        probe = probe[:1] if plain.constant else probe[:: max(1, len(probe) // 200)]
        constant = replace(plain, weights=np.broadcast_to(weights, plain.weights.shape))
        span = plain.edges[-1] - plain.edges[0]
        n, largest = problem.states, span * np.max(np.abs(constant.matrices(probe)), axis=(0, 1))
        # without the initial covariance and the weights: here the rates of the flow are to be small
        return replace(plain, scale=balancing(largest[n:, n:], largest[n:, :n], largest[:n, n:], power=2))

    @cached_property
    def constant(self) -> bool:
        """Whether nothing but the weights depends on time."""
        plant, sensors = self.problem.plant, self.problem.sensors
        return plant.A.constant and plant.noise.constant and all(s.C.constant and s.noise.constant for s in sensors)

    def breaks(self) -> Panels:
        """One panel between any two neighbouring breaks."""
        start, end = self.edges[0], self.edges[-1]
        ends = self.origin, self.origin + float(end)
        inner = [s.breaks(*ends) for p, s in self.problem.signals.items() if p != ("objective", "output")]
        inner += [np.ravel(np.asarray(s.windows)) for s in self.problem.sensors if s.windows]
        # what a formula does between the nodes would be missed: Gauss points are few
        signals = [s for s in self.problem.signals.values() if s.shape[0]]
        inner += [self.origin + features(s, self.origin, float(end)) for s in signals]
        candidates = np.unique(np.concatenate([*inner, np.empty(0)]))
        _, same = nearest_edge(candidates, self.origin + self.edges)
        candidates = candidates[~same] - self.origin
        points = np.unique(np.concatenate([self.edges, candidates[(candidates > start) & (candidates < end)]]))
        middles = (points[1:] + points[:-1]) / 2
        return Panels(points[:-1], np.diff(points), np.searchsorted(self.edges, middles) - 1)

    def sampled(self, signal: Signal, times: np.ndarray) -> np.ndarray:
        """(K, rows, columns) a signal at `times` (K,) counted from the origin."""
        return signal.sample(times + self.origin)

    @cached_property
    def fixed(self) -> dict[int, np.ndarray]:
        """Theta^-1/2 C (m, n) of the sensors of which it is constant, by their places."""
        sensors = enumerate(self.problem.sensors)
        return {j: self.whitened(j, np.zeros(1))[0] for j, s in sensors if s.C.constant and s.noise.constant}

    def whitened(self, j: int, times: np.ndarray) -> np.ndarray:
        """Theta^-1/2 C of sensor j at `times` (K,), (K, m, n)."""
        sensor = self.problem.sensors[j]
        if sensor.is_idle:
            return np.zeros((len(times), 0, len(self.scale)))
        root = np.linalg.cholesky(self.sampled(sensor.noise, times[:1] if sensor.noise.constant else times))
        return np.linalg.inv(root) @ (self.sampled(sensor.C, times) * self.scale)

    def matrices(self, panels: Panels) -> np.ndarray:
        """The Hamiltonian matrices at the nodes (P, NODES, 2n, 2n); (P, 1, 2n, 2n) for constant data."""
        times = panels.node_times[:, :1] if self.constant else panels.node_times
        n, plant, d = len(self.scale), self.problem.plant, self.scale
        A = self.sampled(plant.A, times.ravel()).reshape(*times.shape, n, n) * (d / d[:, None])
        noise = self.sampled(plant.noise, times.ravel()).reshape(*times.shape, n, n) / (d * d[:, None])
        information = np.zeros((*times.shape, n, n))
        for j in range(len(self.problem.sensors)):
            weight = self.weights[panels.interval, j]
            used = np.flatnonzero(weight)
            if len(used):
                white = self.fixed[j] if j in self.fixed else self.whitened(j, times[used].ravel())
                rate = (np.swapaxes(white, -1, -2) @ white).reshape(-1, 1 if j in self.fixed else times.shape[1], n, n)
                information[used] += weight[used, None, None, None] * rate
        return hamiltonian_matrices(A, noise, information)

    def information_roots(self, panels: Panels) -> np.ndarray:
        """W with W' W = L at the nodes, (P, NODES, rows, n): all sensors' rows, times the roots of their weights."""
        times = panels.node_times
        found = []
        for j in range(len(self.problem.sensors)):
            white = self.fixed[j] if j in self.fixed else self.whitened(j, times.ravel())
            white = np.broadcast_to(white, (times.size, *white.shape[-2:])).reshape(*times.shape, *white.shape[-2:])
            found.append(np.sqrt(self.weights[panels.interval, j])[:, None, None, None] * white)
        return np.concatenate(found, axis=2)

    def distinct(self, panels: Panels) -> tuple[Panels, np.ndarray]:
        """Panels no two of which have the same data, and which of them stands for each panel, (P,).

        Lengths that differ by rounding only count as the same and are replaced by their mean.
        """
        if not self.constant:
            return panels, np.arange(len(panels))
        mantissa, exponent = np.frexp(panels.lengths)
        key = np.column_stack([np.rint(np.ldexp(mantissa, SAME_BITS)), exponent, self.weights[panels.interval]])
        _, first, place = np.unique(key, axis=0, return_index=True, return_inverse=True)
        place = place.ravel()
        chosen = panels[first]
        return replace(chosen, lengths=np.bincount(place, panels.lengths) / np.bincount(place)), place

    def polynomials(self, panels: Panels) -> np.ndarray:
        """length * H as polynomials on [0, 1], in powers of t: (P, degree + 1, 2n, 2n)."""
        values = self.matrices(panels) * panels.lengths[:, None, None, None]
        if self.constant:
            return values
        coefficients = legendre_coefficients(values)
        sizes = np.max(np.abs(coefficients), axis=(0, 2, 3), initial=0.0)
        count = 1 + int(np.max(np.flatnonzero(sizes > NOISE * np.max(sizes)), initial=0))
        flat = coefficients[:, :count].reshape(len(panels), count, -1)
        powers = np.ascontiguousarray(legendre_powers()[:count, :count].T)
        return (powers @ flat).reshape(len(panels), count, *values.shape[2:])

    def cost_rates(self, times: np.ndarray) -> np.ndarray:
        """q_j at `times`, (..., M)."""
        rates = [self.sampled(s.cost, times.ravel()).reshape(times.shape) for s in self.problem.sensors]
        return np.stack(rates, axis=-1)

    def running(self, times: np.ndarray) -> np.ndarray:
        """R at `times`, (..., n, n)."""
        n, d = len(self.scale), self.scale
        assert self.problem.running is not None
        return self.sampled(self.problem.running, times.ravel()).reshape(*times.shape, n, n) * (d * d[:, None])

    def room(self, panels: Panels) -> np.ndarray:
        """(P, M) largest weights in continuous time: 1 inside the windows, `select` for idle, or the policy's own."""
        middles = self.origin + panels.starts + panels.lengths / 2
        room = np.ones((len(panels), len(self.problem.sensors)))
        for j, sensor in enumerate(self.problem.sensors):
            if sensor.is_idle:
                room[:, j] = self.problem.select
            elif sensor.windows is not None:
                room[:, j] = np.any([(a <= middles) & (middles <= b) for a, b in sensor.windows], axis=0)
        return np.maximum(room, self.weights[panels.interval])

    def gains(self, panels: Panels, open_to: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """tr(C_j' Theta_j^-1 C_j left right') at the nodes, (P, NODES, M); 0 where `open_to` (P, M) says no to j.

        left, right : (P, NODES, n, c)
        """
        found = np.zeros((*left.shape[:2], open_to.shape[1]))
        rows = [len(white) for white in self.fixed.values()]
        if sum(rows):
            owner = np.repeat(list(self.fixed), rows)
            white = np.concatenate(list(self.fixed.values())).T
            seen = np.swapaxes(left, -1, -2) @ white
            seen = np.sum(seen * (seen if right is left else np.swapaxes(right, -1, -2) @ white), axis=2)
            found += seen @ (owner[:, None] == np.arange(open_to.shape[1]))
        for j in range(open_to.shape[1]):
            used = np.flatnonzero(open_to[:, j])
            if j not in self.fixed and len(used):
                times = panels.node_times[used]
                white = self.whitened(j, times.ravel())
                white = white.reshape(*times.shape, *white.shape[1:])
                found[used, :, j] = np.sum((white @ left[used]) * (white @ right[used]), axis=(2, 3))
        return found

    def resolve(self, panels: Panels, rtol: float) -> Panels:
        """Divide panels until length * norm <= 1 and the data over each is known to rtol.

        Raises SolveFailed where that takes more than MOST_PANELS panels.
        """
        shortest = SMALLEST * (self.edges[-1] - self.edges[0])
        finished: list[Panels] = []
        settled = 0  # panels in `finished`, counted as they come: there may be thousands of lists
        while len(panels):
            unfinished, waiting = [], 0
            for first in range(0, len(panels), 256):
                part = panels[first : first + 256]
                chosen, place = self.distinct(part)
                matrices = self.matrices(chosen)
                size = np.max(norms(matrices), axis=1)[place] * part.lengths
                if not settled + waiting + np.sum(size) <= MOST_PANELS:
                    raise SolveFailed(
                        f"the check in continuous time would need more than {MOST_PANELS} panels: the horizon is far "
                        "too long for the fastest rate of plant and sensors\n  hint: look at the units of A and noise"
                    )
                counts = np.maximum(np.ceil(size).astype(int), 1)
                if not self.constant:
                    largest = np.max(np.abs(matrices), axis=(1, 2, 3))
                    ripple = np.max(tail(matrices), axis=(1, 2)) / np.where(largest > 0, largest, 1.0)
                    rough = (ripple * size > 0.01 * rtol) & (part.lengths >= shortest)
                    counts = np.where((counts == 1) & rough, 2, counts)
                finished.append(part[counts == 1])
                unfinished.append(part[counts > 1].divide(counts[counts > 1]))
                settled, waiting = settled + len(finished[-1]), waiting + len(unfinished[-1])
            panels = Panels.joined(unfinished)
        return Panels.joined(finished)

    def prediction(self, rtol: float) -> tuple[np.ndarray, float]:
        """D Phi(Tp, T) (p, n), balanced, and tr(D int Phi(Tp, t) Xi Phi(Tp, t)' dt D') over (T, Tp]."""
        problem = self.problem
        end, predict_at = float(self.edges[-1]), float(problem.predict_at or 0.0) - self.origin
        output, gathered = problem.output.at(float(problem.predict_at or 0.0)) * self.scale, 0.0
        if predict_at > end:
            nothing = np.zeros((1, self.weights.shape[1]))
            after = replace(self, edges=np.array([end, predict_at]), weights=nothing)
            panels = after.resolve(after.breaks(), rtol)
            for first in reversed(range(0, len(panels), 256)):
                chosen, place = after.distinct(panels[first : first + 256])
                F, _, Q = fractional(transitions(after.polynomials(chosen)))
                for p in reversed(place):
                    gathered += float(np.sum((output @ Q[p]) * output))
                    output = output @ F[p]
        return output, gathered
