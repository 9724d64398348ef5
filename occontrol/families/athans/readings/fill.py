"""A problem of readings becomes a Recursion, exactly: one step for every reading, charged before or after it.

Discrete time: predict 0 is the identity, predict k is (F_{k-1}, G Q G'), the last one (F_{N-1}, G Q G'), or nothing
where the weight acts on the posterior. Samples: the exact flow of the plant between readings, from the start to the
first one and from the last one to the end; a running integral becomes the charge of span_charges.py and a constant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from occontrol.core.signal import Signal
from occontrol.families.athans.discretise import scaled_rows
from occontrol.families.athans.readings.clock import SampleTimes
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.readings.span_charges import charged_spans
from occontrol.numerics.balance import StateUnits, balancing
from occontrol.numerics.transition import transitions
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.recursion import Recursion


@dataclass(frozen=True, eq=False)
class Filled:
    """A problem as arrays.

    Parameters
    ----------
    recursion : Recursion in balanced states, one step a reading, one decision an epoch
    constant : what the running integral charges whatever is chosen, in cost units
    units : of the balanced states
    after : (n, n) noise of the plant between the end and predict_at, seen through the output: its trace is what no
        schedule changes
    """

    recursion: Recursion
    constant: float
    units: StateUnits
    after: float


def fill(problem: ReadingsProblem) -> Filled:
    """The Recursion of a problem of readings, and what is constant beside it.

    Parameters
    ----------
    problem : ReadingsProblem with n states, N readings and E epochs
    """
    n, N = problem.states, problem.readings
    times, owner = problem.clock.times, problem.clock.owner
    S0 = (problem.plant.covariance + problem.plant.covariance.T) / 2
    F, Q, charge, constant = (_steps if problem.discrete else _samples)(problem, S0)
    transition, noise, predict = _distinct(F, Q)
    rows, row_set, offsets = scaled_rows(problem.sensors, times)
    prices = np.column_stack([s.cost.sample(times)[:, 0, 0] for s in problem.sensors]) * problem.cost_weight
    W, after = terminal_weight(problem)
    if problem.running is None:
        running, running_set = np.zeros((0, n, n)), np.zeros(N, dtype=np.int64)
    else:
        running, running_set = _distinct_matrices(charge)
    before = problem.running_at == "prior"
    recursion = Recursion(
        initial=S0,
        transition=transition,
        noise=noise,
        predict=predict,
        rows=rows,
        row_set=row_set,
        offsets=offsets,
        steps=np.ones(N),
        cost=np.ascontiguousarray(prices),
        running=running,
        running_set=running_set,
        terminal=W,
        available=problem.upper,
        owner=owner,
        charge=np.tile([1.0, 0.0] if before else [0.0, 1.0], (N, 1)),
    )
    recursion, units = balanced_recursion(recursion)
    return Filled(recursion, constant, units, after)


def _steps(problem: ReadingsProblem, S0: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """F, Q (N+1, n, n) of the predicts in discrete time, the running weights (N, n, n), 0."""
    n, N, k = problem.states, problem.readings, problem.clock.times
    F, Q = np.array(problem.plant.F.sample(k)), np.array(problem.plant.Q.sample(k))
    if problem.plant.G is not None:
        G = problem.plant.G.sample(k)
        Q = G @ Q @ np.swapaxes(G, 1, 2)
    F, Q = np.concatenate([np.eye(n)[None], F]), np.concatenate([np.zeros((1, n, n)), Q])
    if problem.at == "posterior":
        F[N], Q[N] = np.eye(n), 0.0
    return F, (Q + np.swapaxes(Q, 1, 2)) / 2, _symmetric(problem.running, k, n), 0.0


def _samples(problem: ReadingsProblem, S0: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """F, Q (N+1, n, n) between readings, the charges (N, n, n) of the running weight, and its constant."""
    n, since, start = problem.states, cast(SampleTimes, problem.clock).since, problem.clock.start
    a, b = since[:-1], since[1:]
    if (known := problem.gaps) is not None:  # of a linearised plant
        F, Q = known.transition, known.noise
        if problem.running is None or problem.running_at != "integral":
            return F, Q, _symmetric(problem.running, problem.clock.times, n), 0.0
        M, c = known.charges(problem.running)
        return F, Q, M[1:], float(np.sum(M[0] * S0)) + float(np.sum(c))
    if problem.running is None or problem.running_at != "integral":
        F, Q = transitions(problem.plant.A, problem.plant.noise, a, b, start)
        return F, Q, _symmetric(problem.running, problem.clock.times, n), 0.0
    spans = charged_spans(problem.plant, problem.running, a, b, start)
    before = float(np.sum(spans.charge[0] * S0)) + float(np.sum(spans.constant))
    return spans.transition, spans.noise, spans.charge[1:], before


def terminal_output(problem: ReadingsProblem) -> tuple[np.ndarray, float]:
    """The outputs (p, n) of the recursion's last covariance, and what the noise until predict_at adds to their trace.

    Parameters
    ----------
    problem : ReadingsProblem
    """
    D = problem.output.at(problem.output_at)
    if problem.discrete:
        return D, 0.0
    if (known := problem.gaps) is not None:
        return D @ known.beyond[0], float(np.trace(D @ known.beyond[1] @ D.T))
    start, last = problem.clock.start, cast(SampleTimes, problem.clock).since[-1:]
    at = np.array([float(problem.predict_at or 0.0) - start])
    F, Q = transitions(problem.plant.A, problem.plant.noise, np.minimum(last, at), at, start)
    return D @ F[0], float(np.trace(D @ Q[0] @ D.T))


def terminal_weight(problem: ReadingsProblem) -> tuple[np.ndarray, float]:
    """W (n, n) on the last covariance of the recursion, and what the noise until predict_at adds through the output.

    Parameters
    ----------
    problem : ReadingsProblem
    """
    output, after = terminal_output(problem)
    return output.T @ output, after


def feasible_set(problem: ReadingsProblem) -> IntervalPolytopes:
    """What schedules of readings are allowed: decision by decision, or coupled by a budget.

    Parameters
    ----------
    problem : ReadingsProblem
    """
    names = tuple(problem.sensors.names)
    if problem.budget is None:
        return IntervalPolytopes(problem.upper, problem.places, None, names)
    return BudgetSet(problem.upper, problem.places, None, names, budget=problem.budget)


def _symmetric(signal: Signal | None, times: np.ndarray, n: int) -> np.ndarray:
    if signal is None:
        return np.zeros((len(times), n, n))
    values = np.array(signal.sample(times))
    return (values + np.swapaxes(values, 1, 2)) / 2


def _distinct(F: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The distinct pairs of F and Q (U, n, n), and which one each predict (K,) has."""
    both, index = _distinct_matrices(np.concatenate([F, Q], axis=2))
    n = F.shape[1]
    return np.ascontiguousarray(both[:, :, :n]), np.ascontiguousarray(both[:, :, n:]), index


def _distinct_matrices(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct of (K, ...) and the index (K,) into them."""
    seen: dict[bytes, int] = {}
    index = np.array([seen.setdefault(m.tobytes(), len(seen)) for m in matrices], dtype=np.int64)
    first = np.unique(index, return_index=True)[1]
    return np.ascontiguousarray(matrices[first]), index


def balanced_recursion(recursion: Recursion) -> tuple[Recursion, StateUnits]:
    """The same recursion in well-scaled states, and the units that lead there.

    Parameters
    ----------
    recursion : Recursion in the user's states
    """
    units = _units(recursion)
    return in_units(recursion, units), units


def _units(r: Recursion) -> StateUnits:
    """One diagonal of powers of two in which what drives a state and what it drives are alike, over all steps."""
    n = r.states
    observed = np.max(np.swapaxes(np.abs(r.rows), 1, 2) @ np.abs(r.rows), axis=0) + np.abs(r.terminal)
    if len(r.running):
        observed = observed + np.max(np.abs(r.running), axis=0)
    driven = np.max(np.abs(r.noise), axis=0) + np.abs(r.initial)
    return StateUnits(balancing(np.max(np.abs(r.transition), axis=0), driven, observed.reshape(n, n)))


def in_units(r: Recursion, units: StateUnits) -> Recursion:
    """The same recursion in other units of its states.

    Parameters
    ----------
    r : Recursion in the user's states
    units : StateUnits
    """
    return replace(
        r,
        initial=units.covariance(r.initial),
        transition=units.map(r.transition),
        noise=units.covariance(r.noise),
        rows=np.ascontiguousarray(units.out_of(r.rows)),
        running=units.weight(r.running),
        terminal=units.weight(r.terminal),
    )
