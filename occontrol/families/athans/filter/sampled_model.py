"""A plant that is read once per interval: the discrete-time model behind the sampled filters and the simulation.

Interval k of length h ends with the readings z (stacked over the sensors in use, each the average over the interval):

    x+ = F x + g + w,    z = H x + d + v,    cov [w; v] = [[Q, S], [S', R]]

* `exact_model`: the continuous plant, exactly. The averages (1/h) int C x dt are extra states; van Loan's (or Magnus)
  flow of the augmented plant gives F, H, g, d and the correlated noise. Good for any h.
* `split_model`: the model of the schedule's own recursion: half a step, a reading of C x at the midpoint, half a step.
  Its covariance is the schedule's to rounding; against the continuous plant it is wrong by O(h^2).

A sensor used with weight v_j has reading noise Theta_j/(h v_j). Readings are stacked in the order of the sensors.
Athans (1971), equations (2.1), (2.9), (2.20); van Loan (1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from occontrol.core.clock import elapsed, lengths
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor
from occontrol.core.signal import Signal
from occontrol.families.athans.discretise import half_predicts
from occontrol.families.athans.filter.gains import USED
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.linalg import square_root
from occontrol.numerics.transition import transitions


@dataclass(frozen=True, eq=False)
class SampledModel:
    """F, g, Q, H, d, R, S of every interval, in the notation of this file's header.

    Parameters
    ----------
    edges : (N+1,) times
    names : the M sensor names
    rows : (M,) values of one reading of each sensor
    active : N tuples of the positions of the sensors in use ('idle' is left out)
    transition, input, noise : F (N, n, n), g (N, n), Q (N, n, n)
    observe, offset, reading_noise, cross : N arrays H (m, n), d (m,), R (m, m), S (n, m), m differing by interval
    mean, covariance : (n,), (n, n) at edges[0]
    """

    edges: np.ndarray
    names: tuple[str, ...]
    rows: tuple[int, ...]
    active: tuple[tuple[int, ...], ...]
    transition: np.ndarray
    input: np.ndarray
    noise: np.ndarray
    observe: Sequence[np.ndarray]
    offset: Sequence[np.ndarray]
    reading_noise: Sequence[np.ndarray]
    cross: Sequence[np.ndarray]
    mean: np.ndarray
    covariance: np.ndarray

    @property
    def intervals(self) -> int:
        """The number N of intervals."""
        return len(self.edges) - 1

    @property
    def states(self) -> int:
        """The number n of states."""
        return len(self.mean)

    @property
    def dimension(self) -> np.ndarray:
        """(N,) number m of values that arrive at the end of each interval."""
        return np.array([len(d) for d in self.offset])

    @cached_property
    def noise_roots(self) -> list[np.ndarray]:
        """N arrays N_k (n + m, n + m), the rows of w first: N_k N_k' = [[Q, S], [S', R]]."""
        roots: list[np.ndarray] = [np.zeros((0, 0))] * self.intervals
        for m in np.unique(self.dimension):
            which = np.flatnonzero(self.dimension == m)
            joint = np.empty((len(which), self.states + m, self.states + m))
            n = self.states
            for block, k in zip(joint, which.tolist(), strict=True):
                block[:n, :n], block[:n, n:] = self.noise[k], self.cross[k]
                block[n:, :n], block[n:, n:] = self.cross[k].T, self.reading_noise[k]
            # in units of the standard deviations, so that blocks of very different units keep their digits
            for k, root in zip(which.tolist(), square_root(joint, floor=0.0), strict=True):
                roots[k] = root
        return roots

    def places(self, k: int) -> dict[int, slice]:
        """Where the reading of each sensor in use stands among the stacked values of interval k."""
        found, at = {}, 0
        for j in self.active[k]:
            found[j] = slice(at, at + self.rows[j])
            at += self.rows[j]
        return found


class _Augmented(Signal):
    """[[A, B u, 0], [0, 0, 0], [C, 0, 0]]: the plant with its known input, and int C x dt of some sensors."""

    def __init__(self, plant: LinearPlant, sensors: Sequence[Sensor] = ()):
        self.plant, self.sensors = plant, tuple(sensors)
        self._signals = [plant.A, *(s for s in (plant.B, plant.input) if s is not None), *(s.C for s in self.sensors)]
        size = plant.states + 1 + sum(s.rows for s in self.sensors)
        self.shape = (size, size)
        self.constant = all(s.constant for s in self._signals)

    def sample(self, times: np.ndarray) -> np.ndarray:
        n, plant = self.plant.states, self.plant
        value = np.zeros((len(times), *self.shape))
        value[:, :n, :n] = plant.A.sample(times)
        if plant.B is not None and plant.input is not None:
            value[:, :n, n] = (plant.B.sample(times) @ plant.input.sample(times))[..., 0]
        row = n + 1
        for sensor in self.sensors:
            value[:, row : row + sensor.rows, :n] = sensor.C.sample(times)
            row += sensor.rows
        return value

    def breaks(self, start: float, end: float) -> np.ndarray:
        return np.unique(np.concatenate([s.breaks(start, end) for s in self._signals]))


class _Padded(Signal):
    """The plant's noise intensity, with zeros for the extra states."""

    def __init__(self, noise: Signal, size: int):
        self.noise, self.shape, self.constant = noise, (size, size), noise.constant

    def sample(self, times: np.ndarray) -> np.ndarray:
        n = self.noise.shape[0]
        value = np.zeros((len(times), *self.shape))
        value[:, :n, :n] = self.noise.sample(times)
        return value

    def breaks(self, start: float, end: float) -> np.ndarray:
        return self.noise.breaks(start, end)


def driven_transitions(
    plant: LinearPlant, starts: np.ndarray, ends: np.ndarray, origin: float = 0.0
) -> tuple[np.ndarray, ...]:
    """Phi (K, n, n), int Phi B u dt (K, n) and int Phi Xi Phi' dt (K, n, n) of K spans.

    Parameters
    ----------
    plant : LinearPlant with n states
    starts, ends : (K,) spans, counted from `origin` so that they keep their digits
    origin : a time
    """
    n = plant.states
    F, Q = transitions(_Augmented(plant), _Padded(plant.noise, n + 1), starts, ends, origin)
    return F[:, :n, :n], F[:, :n, n], Q[:, :n, :n]


def exact_model(problem: SchedulingProblem, schedule: Schedule, driven: bool = True) -> SampledModel:
    """The continuous plant, read by averages over the intervals of a schedule; no approximation.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule over its horizon; weights may be fractional
    driven : False leaves the known input out, which moves means only: enough for gains and covariances
    """
    schedule.require_horizon(problem.edges)
    plant, n, h, since = problem.plant, problem.states, lengths(schedule.edges), elapsed(schedule.edges)
    if not driven:
        plant = replace(plant, B=None, input=None)
    origin = float(schedule.edges[0])
    active, theta = _in_use(problem, schedule)
    N = len(h)
    F, g, Q = np.empty((N, n, n)), np.empty((N, n)), np.empty((N, n, n))
    parts: list[tuple] = [()] * N
    for together in sorted(set(active)):
        which = np.array([k for k in range(N) if active[k] == together])
        signal = _Augmented(plant, [problem.sensors[j] for j in together])
        noise = _Padded(plant.noise, signal.shape[0])
        phi, gram = transitions(signal, noise, since[which], since[which + 1], origin)
        F[which], g[which], Q[which] = phi[:, :n, :n], phi[:, :n, n], gram[:, :n, :n]
        for k, f, q in zip(which, phi, gram, strict=True):
            reading_noise = q[n + 1 :, n + 1 :] / h[k] ** 2 + theta[k]
            parts[k] = (f[n + 1 :, :n] / h[k], f[n + 1 :, n] / h[k], reading_noise, q[:n, n + 1 :] / h[k])
    return _assemble(problem, schedule, active, (F, g, Q), parts)


def split_model(problem: SchedulingProblem, schedule: Schedule) -> SampledModel:
    """The model that the schedule's recursion is exact for: half a step, a reading at the midpoint, half a step.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule over its horizon; weights may be fractional
    """
    schedule.require_horizon(problem.edges)
    if not np.array_equal(problem.edges, schedule.edges):
        problem = replace(problem, edges=schedule.edges)
    plant, n, N = problem.plant, problem.states, problem.intervals
    halves = half_predicts(problem)
    F, Q = halves.transition[halves.index], halves.noise[halves.index]
    push = np.zeros((2 * N, n))
    if plant.B is not None:
        since = problem.elapsed
        nodes = np.column_stack([since[:-1], (since[1:] + since[:-1]) / 2, since[1:]])
        push = driven_transitions(plant, nodes[:, :2].ravel(), nodes[:, 1:].ravel(), float(problem.edges[0]))[1]
    active, theta = _in_use(problem, schedule)
    Fa, Fb, Qa, Qb, ga, gb = F[0::2], F[1::2], Q[0::2], Q[1::2], push[0::2], push[1::2]
    flow = Fb @ Fa, (Fb @ ga[:, :, None])[..., 0] + gb, Fb @ Qa @ np.swapaxes(Fb, 1, 2) + Qb
    samples = [sensor.C.sample(problem.midpoints) for sensor in problem.sensors]
    parts = []
    for k in range(N):
        C = np.concatenate([np.zeros((0, n)), *(samples[j][k] for j in active[k])])
        parts.append((C @ Fa[k], C @ ga[k], C @ Qa[k] @ C.T + theta[k], Fb[k] @ Qa[k] @ C.T))
    return _assemble(problem, schedule, active, flow, parts)


def _in_use(problem: SchedulingProblem, schedule: Schedule) -> tuple[list[tuple[int, ...]], list[np.ndarray]]:
    """Sensors in use on each interval, and the block diagonal of their Theta/(h v) at the midpoint."""
    edges = schedule.edges
    weights = schedule.on_grid(edges, problem.sensors.names)
    samples = [sensor.noise.sample((edges[1:] + edges[:-1]) / 2) for sensor in problem.sensors]
    active, blocks = [], []
    for k, h in enumerate(lengths(edges)):
        used = tuple(j for j, s in enumerate(problem.sensors) if s.rows and weights[k, j] > USED)
        block = np.zeros((sum(problem.sensors[j].rows for j in used),) * 2)
        at = 0
        for j in used:
            m = problem.sensors[j].rows
            block[at : at + m, at : at + m] = samples[j][k] / (h * weights[k, j])
            at += m
        active.append(used)
        blocks.append(block)
    return active, blocks


def _assemble(problem: SchedulingProblem, schedule: Schedule, active, flow, parts) -> SampledModel:
    observe, offset, reading_noise, cross = zip(*parts, strict=True)
    return SampledModel(
        edges=schedule.edges,
        names=tuple(problem.sensors.names),
        rows=tuple(s.rows for s in problem.sensors),
        active=tuple(active),
        transition=flow[0],
        input=flow[1],
        noise=flow[2],
        observe=observe,
        offset=offset,
        reading_noise=reading_noise,
        cross=cross,
        mean=problem.plant.mean,
        covariance=(problem.plant.covariance + problem.plant.covariance.T) / 2,
    )
