"""The matched filter: over a list of measurements (sampled), and in continuous time (3.2) with its precomputed gain.

    dx/dt = A x + B u + sum_j v_j Sigma C_j' Theta_j^-1 (z_j - C_j x),   G_j = Sigma C_j' Theta_j^-1

The continuous form integrates Sigma(t) first, on its own (a Riccati equation, adaptive steps, broken at the edges),
keeps G(t), and then integrates x alone. It shares no numerics with the sampled filters, which converge to it as h^2.
Athans (1971), equations (3.2), (3.4), (7.3)-(7.5); (7.5) lost the transpose of C.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.schedule import Schedule
from occontrol.core.trajectory import Trajectory
from occontrol.families.athans.filter.consistency import expected_nees
from occontrol.families.athans.filter.gains import USED
from occontrol.families.athans.filter.online import MatchedFilter, Step
from occontrol.families.athans.filter.sampled_model import SampledModel
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.consistency import average_band

TIME_SLACK = 0.01  # of an interval's length: times may be rounded, but not ambiguous
MOST_MISTAKES = 20
COARSE = 1.2  # expected NEES per state above which the split filter is called too coarse


def run_filter(
    problem: SchedulingProblem,
    schedule: Schedule,
    measurements: Sequence[Measurement],
    model: str | SampledModel = "split",
) -> Estimate:
    """Estimate the state and predict w(Tp) from measurements along a schedule.

    Parameters
    ----------
    problem : SchedulingProblem with n states
    schedule : Schedule with N intervals
    measurements : each the average of one sensor over the interval that ends at its time, in any order
    model : "split" or "exact" (see online.py)

    Returns an Estimate with one row per edge, the first being the initial one; its notes tell of missing samples and
    of the average NIS with its 99 % band. Raises ProblemError naming line and sensor of every measurement that does
    not belong to the schedule.
    """
    matched = MatchedFilter(problem, schedule, model)
    samples = sort_samples(matched.model, measurements)
    steps = [matched.state()]
    for sample in samples:
        steps.append(matched.step(sample))
    notes = _notes(matched.model, steps)
    if model == "split":
        worst = float(np.max(expected_nees(problem, schedule)))
        if worst > COARSE:
            notes += (
                f"the grid is coarse for this filter: against the continuous plant its NEES per state is expected to "
                f"reach {worst:.3g} instead of 1; the exact model (model: exact) has no such error",
            )
    deviation = np.array([_deviation(s.covariance) for s in steps])
    output = _present_output(problem, steps)
    return Estimate(
        times=matched.model.edges,
        mean=np.array([s.estimate for s in steps]),
        standard_deviation=deviation,
        predicted=np.array([s.prediction for s in steps]),
        predicted_deviation=np.array([_deviation(s.prediction_covariance) for s in steps]),
        nis=np.array([s.nis for s in steps]),
        dimension=np.array([s.dimension for s in steps]),
        covariance=np.array([s.covariance for s in steps]),
        notes=notes,
        output=output[0],
        output_deviation=output[1],
    )


def _deviation(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _present_output(problem: SchedulingProblem, steps: Sequence[Step]) -> tuple[np.ndarray, np.ndarray]:
    """w(t) = D(t) x(t) and its standard deviation at every node."""
    D = problem.output.sample(np.array([s.time for s in steps]))
    with np.errstate(invalid="ignore"):  # only D(Tp) has to be finite; elsewhere the fields stay empty
        mean = np.array([d @ s.estimate for d, s in zip(D, steps, strict=True)])
        deviation = np.array([_deviation(d @ s.covariance @ d.T) for d, s in zip(D, steps, strict=True)])
    return mean, deviation


def _notes(model: SampledModel, steps: Sequence[Step]) -> tuple[str, ...]:
    notes = []
    arrived = np.array([s.dimension for s in steps[1:]])
    missing = np.flatnonzero(arrived < model.dimension)
    if len(missing):
        lost, planned, first = int(np.sum(model.dimension - arrived)), int(np.sum(model.dimension)), missing[0]
        notes.append(
            f"{lost} of {planned} planned values are missing, the first over [{model.edges[first]:g}, "
            f"{model.edges[first + 1]:g}]: the precomputed gains and covariances do not hold from there, "
            "they were computed anew"
        )
    values = int(sum(s.dimension for s in steps))
    if values:
        total = float(np.nansum([s.nis for s in steps]))
        low, high = average_band(values)
        verdict = "inside" if low <= total / values <= high else "OUTSIDE"
        notes.append(f"NIS: {total / values:.4g} per value on average, {verdict} its 99 % band [{low:.4g}, {high:.4g}]")
    return tuple(notes)


def sort_samples(model: SampledModel, measurements: Sequence[Measurement]) -> list[dict[str, np.ndarray]]:
    """{sensor: values} of every interval; an empty one where nothing arrived.

    Parameters
    ----------
    model : SampledModel with N intervals
    measurements : in any order

    Raises ProblemError: outside the horizon, not at the end of an interval, a sensor that is unknown or not in use
    then, twice the same, a wrong number of values, infinite values.
    """
    samples: list[dict[str, np.ndarray]] = [{} for _ in range(model.intervals)]
    found: list[Mistake] = []
    for measurement in measurements:
        place = f"line {measurement.line}" if measurement.line else ""
        try:
            k = _interval(model, measurement)
            _check(model, k, measurement, samples[k])
        except ProblemError as error:
            found += [Mistake((), m.what, m.hint, place=place) for m in error.mistakes]
            if len(found) >= MOST_MISTAKES:
                break
            continue
        samples[k][measurement.sensor] = np.asarray(measurement.values, dtype=float)
    if found:
        raise ProblemError(found)
    return samples


def _interval(model: SampledModel, measurement: Measurement) -> int:
    edges, t, name = model.edges, float(measurement.time), measurement.sensor
    if not np.isfinite(t):
        raise ProblemError(f"the sample of sensor '{name}' has no finite time")
    if measurement.sensor not in model.names:
        raise ProblemError(f"there is no sensor '{name}'", "sensors: " + ", ".join(model.names))
    k = int(np.clip(np.searchsorted(edges[1:], t), 0, model.intervals - 1))
    nearest = k - 1 if k and abs(edges[k] - t) < abs(edges[k + 1] - t) else k
    slack = TIME_SLACK * float(edges[nearest + 1] - edges[nearest])
    if abs(edges[nearest + 1] - t) <= slack:
        return nearest
    if not edges[0] < t <= edges[-1] + slack:
        raise ProblemError(
            f"the sample of sensor '{name}' at t = {t:.9g} lies outside the horizon [{edges[0]:g}, {edges[-1]:g}]",
            "t is the end of the interval that the sample averages",
        )
    raise ProblemError(
        f"the sample of sensor '{name}' at t = {t:.9g} is not at the end of an interval",
        f"the nearest ends are {edges[k]:.9g} and {edges[k + 1]:.9g}",
    )


def _check(model: SampledModel, k: int, measurement: Measurement, already: dict) -> None:
    name, values = measurement.sensor, np.asarray(measurement.values, dtype=float)
    j = model.names.index(name)
    if j not in model.active[k]:
        used = ", ".join(model.names[i] for i in model.active[k]) or "no sensor"
        raise ProblemError(
            f"sensor '{name}' is not in use over [{model.edges[k]:g}, {model.edges[k + 1]:g}]", f"in use: {used}"
        )
    if name in already:
        raise ProblemError(f"sensor '{name}' has a second sample at t = {measurement.time:.9g}")
    if values.shape != (model.rows[j],):
        raise ProblemError(
            f"the sample of sensor '{name}' has {values.size} values, its C has {model.rows[j]} rows",
            "leave the line of a missing sample out, or its missing value empty",
        )
    if np.any(np.isinf(values)):
        raise ProblemError(f"the sample of sensor '{name}' is infinite")


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
    order = [schedule.names.index(name) for name in problem.sensors.names]
    for k, v in enumerate(schedule.weights[:, order]):
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
    order = [schedule.names.index(name) for name in sensors.names]
    state, states = plant.mean, [plant.mean]

    def rate(weights: np.ndarray, t: float, x: np.ndarray) -> np.ndarray:
        change = plant.A.at(t) @ x
        if plant.B is not None:
            change = change + (plant.B.at(t) @ plant.input.at(t)).ravel()
        for j in np.flatnonzero(weights > USED):
            if sensors[j].rows:
                C = sensors[j].C.at(t)
                error = np.linalg.solve(sensors[j].noise.at(t), np.asarray(readings(t, sensors[j].name)) - C @ x)
                change = change + weights[j] * covariance(t) @ C.T @ error
        return change

    for k, v in enumerate(schedule.weights[:, order]):
        span = (float(schedule.edges[k]), float(schedule.edges[k + 1]))
        path = solve_ivp(partial(rate, v), span, state, "LSODA", rtol=rtol, atol=rtol * 1e-3)
        state = path.y[:, -1]
        states.append(state)
    return Trajectory(schedule.edges, np.array(states))
