"""The matched filter: over a list of measurements (sampled), and in continuous time (3.2) with its precomputed gain.

    dx/dt = A x + B u + sum_j v_j Sigma C_j' Theta_j^-1 (z_j - C_j x),   G_j = Sigma C_j' Theta_j^-1

The continuous form integrates Sigma(t) first, on its own (a Riccati equation, adaptive steps, broken at the edges),
keeps G(t), and then integrates x alone. It shares no numerics with the sampled filters, which converge to it as h^2.
Athans (1971), equations (3.2), (3.4), (7.3)-(7.5); (7.5) lost the transpose of C.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

import numpy as np

from occontrol.core.arrange import arrange
from occontrol.core.errors import plural
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.schedule import Schedule
from occontrol.core.trajectory import Trajectory
from occontrol.families.athans.filter.consistency import expected_nees
from occontrol.families.athans.filter.gains import USED
from occontrol.families.athans.filter.online import MatchedFilter, MatchedStep
from occontrol.families.athans.filter.sampled_model import SampledModel
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.consistency import average_band

OUTLIER = 1e-6  # a consistent sample lies beyond the level that is called an outlier with this probability
COARSE_NEES = 1.2  # expected NEES per state above which the split filter is called too coarse


class Stepped(Protocol):
    """What a filter along a schedule says of its steps: edges (N+1,), and (N,) how many values each should bring."""

    edges: np.ndarray

    @property
    def dimension(self) -> np.ndarray: ...


def run_filter(
    problem: SchedulingProblem,
    schedule: Schedule,
    measurements: Sequence[Measurement],
    model: str | SampledModel = "split",
    gate: float | None = None,
) -> Estimate:
    """Estimate the state and predict w(Tp) from measurements along a schedule.

    Parameters
    ----------
    problem : SchedulingProblem with n states
    schedule : Schedule with N intervals
    measurements : each the average of one sensor over the interval that ends at its time, in any order
    model : "split" or "exact" (see online.py)
    gate : probability; samples so far off that a consistent one would be nearer with this probability are left out

    Returns an Estimate with one row per edge, the first being the initial one; its notes tell of missing samples, of
    those that the gate left out or the worst that would deserve it, and of the average NIS with its 99 % band.
    Raises ProblemError naming line and sensor of every measurement that does not belong to the schedule.
    """
    matched = MatchedFilter(problem, schedule, model, gate=gate)
    sampled = matched.model
    samples = arrange(sampled.edges, sampled.names, sampled.rows, sampled.active, measurements)
    steps = [matched.state()]
    for sample in samples:
        steps.append(matched.step(sample))
    notes = notes_of(sampled, steps, gate)
    if model == "split":
        worst = float(np.max(expected_nees(problem, schedule)))
        if worst > COARSE_NEES:
            notes += (
                f"the grid is coarse for this filter: against the continuous plant its NEES per state is expected to "
                f"reach {worst:.3g} instead of 1; the exact model (model: exact) has no such error",
            )
    deviation = np.array([deviation_of(s.covariance) for s in steps])
    output = _present_output(problem, steps)
    return Estimate(
        times=sampled.edges,
        mean=np.array([s.estimate for s in steps]),
        standard_deviation=deviation,
        predicted=np.array([s.prediction for s in steps]),
        predicted_deviation=np.array([deviation_of(s.prediction_covariance) for s in steps]),
        nis=np.array([s.nis for s in steps]),
        dimension=np.array([s.dimension for s in steps]),
        covariance=np.array([s.covariance for s in steps]),
        notes=notes,
        output=output[0],
        output_deviation=output[1],
    )


def deviation_of(covariance: np.ndarray) -> np.ndarray:
    """(n,) standard deviations of a covariance (n, n)."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _present_output(problem: SchedulingProblem, steps: Sequence[MatchedStep]) -> tuple[np.ndarray, np.ndarray]:
    """w(t) = D(t) x(t) and its standard deviation at every node."""
    D = problem.output.sample(np.array([s.time for s in steps]))
    with np.errstate(invalid="ignore"):  # only D(Tp) has to be finite; elsewhere the fields stay empty
        mean = np.array([d @ s.estimate for d, s in zip(D, steps, strict=True)])
        deviation = np.array([deviation_of(d @ s.covariance @ d.T) for d, s in zip(D, steps, strict=True)])
    return mean, deviation


def notes_of(
    model: SampledModel | Stepped,
    steps: Sequence[MatchedStep],
    gate: float | None,
    instants: bool = False,
    without: str = "the precomputed gains and covariances do not hold from there, they were computed anew",
) -> tuple[str, ...]:
    """What is worth saying after a run: outliers or what the gate left out, missing values, the average NIS.

    Parameters
    ----------
    model : that was followed, N intervals
    steps : N+1 of them, the first before any sample
    gate : as in `run_filter`
    instants : whether a sample is a reading at the end of its interval instead of an average over it
    without : what a missing value means
    """
    notes = [note for note in (_outlier(steps) if gate is None else _gated(steps, gate),) if note]
    arrived = np.array([s.dimension + s.skipped_values for s in steps[1:]])
    missing = np.flatnonzero(arrived < model.dimension)
    if len(missing):
        lost, planned, first = int(np.sum(model.dimension - arrived)), int(np.sum(model.dimension)), missing[0]
        start, end = model.edges[first], model.edges[first + 1]
        where = f"at {end:g}" if instants else f"over [{start:g}, {end:g}]"
        notes.append(
            f"{lost} of {planned} planned values are missing, the first {where}: {without}"
        )
    values = int(sum(s.dimension for s in steps))
    if values:
        total = float(np.nansum([s.nis for s in steps]))
        low, high = average_band(values)
        verdict = "inside" if low <= total / values <= high else "OUTSIDE"
        notes.append(f"NIS: {total / values:.4g} per value on average, {verdict} its 99 % band [{low:.4g}, {high:.4g}]")
    return tuple(notes)


def _outlier(steps: Sequence[MatchedStep]) -> str:
    """The sample that is least likely to belong to this plant, if it is beyond the level of an outlier."""
    from scipy.stats import chi2

    found = [
        (float(chi2.logsf(nis, degrees)), s.time, name, nis, degrees)
        for s in steps
        for name, (nis, degrees) in s.samples.items()
    ]
    beyond = [each for each in found if each[0] < np.log(OUTLIER)]
    if not beyond:
        return ""
    # far out the probability is zero to rounding: of several such samples the one with the largest NIS per value
    _, time, name, nis, degrees = min(beyond, key=lambda each: (each[0], -each[3] / each[4]))
    limit = float(chi2.isf(OUTLIER, degrees))
    others = f" (and {plural(len(beyond) - 1, 'other sample')})" if len(beyond) > 1 else ""
    return (
        f"outlier: the sample of sensor '{name}' at t = {time:.9g}{others} does not fit: its NIS is {nis:.4g}, which "
        f"exceeds {limit:.4g} once in a million for {plural(degrees, 'value')}; a gate leaves such samples out"
    )


def _gated(steps: Sequence[MatchedStep], gate: float) -> str:
    """What the gate left out."""
    found = [(s.time, name, s.samples[name][0]) for s in steps for name in s.skipped]
    if not found:
        return ""
    time, name, nis = found[0]
    first = f"sensor '{name}' at t = {time:.9g}, NIS {nis:.4g}"
    number = plural(len(found), "sample")
    return f"gate {gate:g}: {number} left out ({'it is of' if len(found) == 1 else 'the first is of'} {first})"


def continuous_gain(
    problem: SchedulingProblem, schedule: Schedule, rtol: float = 1e-9
) -> tuple[Callable[[float], np.ndarray], np.ndarray]:
    """Sigma(t) as a function, precomputed by adaptive integration, and its values at the edges.

    G_j(t) = Sigma(t) C_j(t)' Theta_j(t)^-1 is the gain of sensor j at t.

    Parameters
    ----------
    problem : SchedulingProblem with n states
    schedule : Schedule over its horizon
    rtol : relative tolerance of the integration

    Returns covariance(t) -> (n, n), and (K+1, n, n) at the schedule's edges.
    """
    from scipy.integrate import solve_ivp

    n, plant = problem.states, problem.plant
    scale = float(np.max(np.abs(plant.covariance))) or 1.0
    pieces, ends = [], []

    def rate(weights: np.ndarray, t: float, flat: np.ndarray) -> np.ndarray:
        S = flat.reshape(n, n)
        A = plant.A.at(t)
        loss = np.zeros((n, n))
        for j in np.flatnonzero(weights > USED):
            sensor = problem.sensors[j]
            if sensor.rows:
                CS = sensor.C.at(t) @ S
                loss += weights[j] * CS.T @ np.linalg.solve(sensor.noise.at(t), CS)
        return (A @ S + S @ A.T + plant.noise.at(t) - loss).ravel()

    state = plant.covariance.ravel()
    for k, v in enumerate(schedule.on_grid(schedule.edges, problem.sensors.names)):
        span = (float(schedule.edges[k]), float(schedule.edges[k + 1]))
        right = partial(rate, v)
        path = solve_ivp(right, span, state, "LSODA", dense_output=True, rtol=rtol, atol=1e-4 * rtol * scale)
        pieces.append(path.sol)
        ends.append(state.reshape(n, n))
        state = path.y[:, -1]
    ends.append(state.reshape(n, n))

    def covariance(t: float) -> np.ndarray:
        k = int(np.clip(np.searchsorted(schedule.edges, t, side="right") - 1, 0, len(pieces) - 1))
        S = pieces[k](t).reshape(n, n)
        return (S + S.T) / 2

    return covariance, np.array(ends)


def continuous_filter(
    problem: SchedulingProblem,
    schedule: Schedule,
    readings: Callable[[float, str], np.ndarray],
    rtol: float = 1e-8,
) -> Trajectory:
    """The Kalman-Bucy filter (3.2) driven by signals z_j(t).

    Parameters
    ----------
    problem : SchedulingProblem with n states
    schedule : Schedule to follow
    readings : z(t, sensor name) -> (m,); called for the sensors in use
    rtol : relative tolerance

    Returns the estimate (K+1, n) at the schedule's edges. Athans (1971), equation (3.2).
    """
    from scipy.integrate import solve_ivp

    covariance, _ = continuous_gain(problem, schedule, rtol / 10)
    plant, sensors = problem.plant, problem.sensors
    state, states = plant.mean, [plant.mean]

    def rate(weights: np.ndarray, t: float, x: np.ndarray) -> np.ndarray:
        change = plant.A.at(t) @ x
        if plant.B is not None and plant.input is not None:
            change = change + (plant.B.at(t) @ plant.input.at(t)).ravel()
        for j in np.flatnonzero(weights > USED):
            if sensors[j].rows:
                C = sensors[j].C.at(t)
                error = np.linalg.solve(sensors[j].noise.at(t), np.asarray(readings(t, sensors[j].name)) - C @ x)
                change = change + weights[j] * covariance(t) @ C.T @ error
        return change

    for k, v in enumerate(schedule.on_grid(schedule.edges, sensors.names)):
        span = (float(schedule.edges[k]), float(schedule.edges[k + 1]))
        path = solve_ivp(partial(rate, v), span, state, "LSODA", rtol=rtol, atol=rtol * 1e-3)
        state = path.y[:, -1]
        states.append(state)
    return Trajectory(schedule.edges, np.array(states))
