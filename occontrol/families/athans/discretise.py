"""A plant, sensors and a grid become a Recursion: Strang splitting that keeps the covariance positive semidefinite.

Per interval k of length h_k:   half predict,  update with information h_k sum_j v_kj L_j,  half predict,
    predict  S <- F S F' + Q          update  S+ = (S^-1 + h L)^-1
Neighbouring half predicts are merged, so the recursion is: predict 0, update 0, predict 1, ..., update N-1, predict N.
L, Theta, q and R are sampled at the midpoints. A running weight is charged there as h/2 [tr(R S-) + tr(R S+)].
Second order in h, convex in v exactly, and its adjoint gives the certificate of the discretised problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from occontrol.core.sensor import SensorSuite
from occontrol.core.signal import ConstantSignal
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.linalg import whiten
from occontrol.numerics.transition import transitions, unique_spans
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.recursion import Recursion

NEGLIGIBLE = 1e-100
_predicted: WeakKeyDictionary[SchedulingProblem, tuple[np.ndarray, float]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class HalfPredicts:
    """F and Q of the 2N half intervals: node k -> midpoint k is 2k, midpoint k -> node k+1 is 2k+1."""

    transition: np.ndarray
    noise: np.ndarray
    index: np.ndarray


def half_predicts(problem: SchedulingProblem) -> HalfPredicts:
    """Transition and noise of every half interval of the problem's grid."""
    plant = problem.plant
    if plant.A.constant and plant.noise.constant:
        spans, index = unique_spans(np.repeat(problem.steps / 2, 2))
        F, Q = transitions(plant.A, plant.noise, np.zeros(len(spans)), spans)
    else:
        edges = problem.elapsed
        middle = (edges[1:] + edges[:-1]) / 2
        starts, ends = np.column_stack([edges[:-1], middle]).ravel(), np.column_stack([middle, edges[1:]]).ravel()
        F, Q = transitions(plant.A, plant.noise, starts, ends, float(problem.edges[0]))
        index = np.arange(2 * problem.intervals)
    return HalfPredicts(F, Q, index.astype(np.int64))


def _merge(halves: HalfPredicts) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F, Q and index of the N+1 merged predicts."""
    index = halves.index
    none = len(halves.transition)  # stands for 'no half predict' at the two ends
    first = np.concatenate([[none], index[1::2]])
    second = np.concatenate([index[0::2], [none]])
    pairs, which = np.unique(np.column_stack([first, second]), axis=0, return_inverse=True)
    n = halves.transition.shape[1]
    F = np.concatenate([halves.transition, np.eye(n)[None]])
    Q = np.concatenate([halves.noise, np.zeros((1, n, n))])
    a, b = pairs.T
    merged = F[b] @ F[a]
    noise = F[b] @ Q[a] @ np.swapaxes(F[b], 1, 2) + Q[b]
    noise = (noise + np.swapaxes(noise, 1, 2)) / 2
    # long chains couple their ends by entries whose products fall below the normal numbers, which are slow
    for matrices in (merged, noise):
        matrices[np.abs(matrices) < NEGLIGIBLE * np.max(np.abs(matrices), axis=(1, 2), keepdims=True)] = 0.0
    return merged, noise, which.ravel().astype(np.int64)


def scaled_rows(sensors: SensorSuite, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows X C with X'X = Theta^-1 at the given times.

    Returns rows (S, r, n) for the distinct times, the (N,) index into them, and the (M+1,) offsets.
    """
    offsets = np.concatenate([[0], np.cumsum([s.rows for s in sensors])]).astype(np.int64)
    constant = all(s.C.constant and s.noise.constant for s in sensors)
    at = times[:1] if constant else times
    blocks = []
    for sensor in sensors:
        C, theta = sensor.C.sample(at), sensor.noise.sample(at)
        if sensor.rows:
            # Theta = G G' gives X = G^-1, and then X'X = Theta^-1
            (C,) = whiten(theta, C)
        blocks.append(C)
    rows = np.ascontiguousarray(np.concatenate(blocks, axis=1))
    index = np.zeros(len(times)) if constant else np.arange(len(times))
    return rows, index.astype(np.int64), offsets


def prediction_weight(problem: SchedulingProblem) -> tuple[np.ndarray, float]:
    """W = Phi(Tp,T)' D'D Phi(Tp,T) and the noise term tr(D int_T^Tp Phi Xi Phi' dt D'), which no schedule changes.

    Athans (1971), equations (3.12) and (5.6); the noise term is missing in (3.12).
    """
    if problem in _predicted:
        return _predicted[problem]
    start, at = float(problem.edges[0]), float(problem.predict_at or 0.0)
    F, Q = transitions(problem.plant.A, problem.plant.noise, problem.elapsed[-1:], np.array([at - start]), start)
    D = problem.output.at(at)
    predicted = D @ F[0]
    _predicted[problem] = predicted.T @ predicted, float(np.trace(D @ Q[0] @ D.T))
    return _predicted[problem]


def discretise(problem: SchedulingProblem, halves: HalfPredicts | None = None) -> Recursion:
    """The Recursion of a scheduling problem on its own grid; `halves` may be passed when they are known already."""
    return recursion_on(problem, halves or half_predicts(problem), problem.midpoints, problem.steps)


def recursion_on(
    problem: SchedulingProblem,
    halves: HalfPredicts,
    middle: np.ndarray,
    steps: np.ndarray,
    owner: np.ndarray | None = None,
) -> Recursion:
    """The Recursion of a scheduling problem on N steps of integration.

    Parameters
    ----------
    problem : SchedulingProblem
    halves : of the steps
    middle, steps : (N,) midpoints and lengths of the steps
    owner : (N,) the interval of the problem that each step lies in; None: the steps are the intervals
    """
    n, N, h = problem.states, len(steps), steps
    F, Q, predict = _merge(halves)
    rows, row_set, offsets = scaled_rows(problem.sensors, middle)
    cost = np.column_stack([s.cost.sample(middle)[:, 0, 0] for s in problem.sensors]) * h[:, None] * problem.cost_weight
    R = problem.running
    if R is None or (R.constant and not np.any(R.at(0.0))):
        running, running_set = np.zeros((0, n, n)), np.zeros(N, dtype=np.int64)
    elif isinstance(R, ConstantSignal):
        running, running_set = np.array(R.at(0.0))[None], np.zeros(N, dtype=np.int64)
    else:
        running, running_set = np.array(R.sample(middle)), np.arange(N, dtype=np.int64)
    return Recursion(
        initial=(problem.plant.covariance + problem.plant.covariance.T) / 2,
        transition=np.ascontiguousarray(F),
        noise=np.ascontiguousarray(Q),
        predict=predict,
        rows=rows,
        row_set=row_set,
        offsets=offsets,
        steps=h,
        cost=np.ascontiguousarray(cost),
        running=np.ascontiguousarray((running + np.swapaxes(running, 1, 2)) / 2),
        running_set=running_set,
        terminal=prediction_weight(problem)[0],
        available=problem.upper if owner is None else problem.upper[owner],
    )


def feasible_set(problem: SchedulingProblem) -> IntervalPolytopes:
    """What schedules the problem allows on its grid: windows, and `select` sensors at a time.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    return IntervalPolytopes(problem.upper, problem.select, problem.edges, tuple(problem.sensors.names))
