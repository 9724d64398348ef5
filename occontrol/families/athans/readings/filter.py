"""The Kalman filter and predictor along a schedule of readings, its simulation, and its tables.

    from reading to reading   x+ = F x + g + w,   then   z = H x+ + e,   cov e = R/v

which is the model of filter/sampled_model.py with readings at the ends of the intervals: its z = (H F) x + H g + (H w +
e). The first interval leads from the start to the first reading and may be empty. Everything is exact; a share v of a
reading (relaxed schedules) has the noise R/v.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import cast

import numpy as np

from occontrol.core.arrange import arrange
from occontrol.core.errors import ProblemError
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.reading_schedule import ReadingSchedule
from occontrol.core.schedule import Schedule
from occontrol.core.target import TargetPlan
from occontrol.core.trajectory import Trajectory
from occontrol.families.athans.filter.kalman_bucy import deviation_of, notes_of
from occontrol.families.athans.filter.online import MatchedFilter
from occontrol.families.athans.filter.predictor import Predictor
from occontrol.families.athans.filter.sampled_model import SampledModel, driven_transitions
from occontrol.families.athans.filter.simulate import draw
from occontrol.families.athans.filter.tables import tables_of
from occontrol.families.athans.filter.target import plan_of
from occontrol.families.athans.readings.clock import SampleTimes
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.numerics.linalg import square_root
from occontrol.numerics.transition import transitions

USED = 1e-9


class ReadingModel(SampledModel):
    """A SampledModel whose readings stand at the ends of its intervals; `extra` is the noise (m, m) of each reading."""

    @cached_property
    def noise_roots(self) -> list[np.ndarray]:
        """N arrays (n + m, n + m): [[Q^1/2, 0], [H Q^1/2, R^1/2]], so that a small R keeps its digits beside H Q H'."""
        found = []
        for Q, (H, R) in zip(square_root(self.noise, floor=0.0), self.readings, strict=True):
            n, m = len(Q), len(R)
            root = np.zeros((n + m, n + m))
            root[:n, :n], root[n:, :n] = Q, H @ Q
            if m:
                root[n:, n:] = square_root(R, floor=0.0)
            found.append(root)
        return found

    readings: list[tuple[np.ndarray, np.ndarray]]


def reading_model(problem: ReadingsProblem, schedule: Schedule) -> ReadingModel:
    """F, g, Q from reading to reading and what the sensors in use report at each.

    Parameters
    ----------
    problem : ReadingsProblem with N readings
    schedule : of the same instants

    Raises ProblemError when the schedule has other instants than the problem.
    """
    weights = weights_on(problem, schedule)
    F, g, Q = between(problem)
    times, active, parts, readings = problem.clock.times, [], [], []
    samples = [(s.C.sample(times), s.noise.sample(times)) for s in problem.sensors]
    for k in range(len(times)):
        used = tuple(j for j, s in enumerate(problem.sensors) if s.rows and weights[k, j] > USED)
        H = np.concatenate([np.zeros((0, problem.states)), *(samples[j][0][k] for j in used)])
        R, at = np.zeros((len(H), len(H))), 0
        for j in used:
            m = problem.sensors[j].rows
            R[at : at + m, at : at + m] = samples[j][1][k] / weights[k, j]
            at += m
        active.append(used)
        readings.append((H, R))
        parts.append((H @ F[k], H @ g[k], H @ Q[k] @ H.T + R, Q[k] @ H.T))
    observe, offset, noise, cross = zip(*parts, strict=True)
    model = ReadingModel(
        edges=np.append(problem.clock.start, times),
        names=tuple(problem.sensors.names),
        rows=tuple(s.rows for s in problem.sensors),
        active=tuple(active),
        transition=F[:-1],
        input=g[:-1],
        noise=Q[:-1],
        observe=observe,
        offset=offset,
        reading_noise=noise,
        cross=cross,
        mean=problem.plant.mean,
        covariance=(problem.plant.covariance + problem.plant.covariance.T) / 2,
    )
    object.__setattr__(model, "readings", readings)
    return model


def weights_on(problem: ReadingsProblem, schedule: Schedule) -> np.ndarray:
    """The weights (N, M) of a schedule on the instants of a problem, its sensors in the problem's order.

    Parameters
    ----------
    problem : ReadingsProblem with N readings and M sensors
    schedule : of the same instants, sensors in any order

    Raises ProblemError for other instants and for sensors that the problem does not have.
    """
    times = schedule.edges[:-1]
    wanted = problem.clock.times
    if len(times) != len(wanted) or not np.allclose(times, wanted, rtol=0, atol=1e-9 * max(1.0, np.ptp(wanted))):
        shown = f"{problem.clock.variable} = {wanted[0]:g} .. {wanted[-1]:g}"
        raise ProblemError("the schedule is not one of these readings", f"{len(wanted)} readings at {shown}")
    weights = np.zeros((len(wanted), len(problem.sensors)))
    for i, name in enumerate(schedule.names):
        if name in problem.sensors.names:
            weights[:, problem.sensors.names.index(name)] = schedule.weights[:, i]
        elif np.any(schedule.weights[:, i] > USED):
            raise ProblemError(f"there is no sensor '{name}'", f"there are: {', '.join(problem.sensors.names)}")
    return weights


def between(problem: ReadingsProblem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F (N+1, n, n), g (N+1, n), Q (N+1, n, n): to the first reading, between readings, on to the end.

    Parameters
    ----------
    problem : ReadingsProblem of a linear plant with N readings and n states
    """
    n, N, plant = problem.states, problem.readings, problem.plant
    if problem.discrete:
        k = problem.clock.times
        F, Q = np.array(plant.F.sample(k)), np.array(plant.Q.sample(k))
        if plant.G is not None:
            G = plant.G.sample(k)
            Q = G @ Q @ np.swapaxes(G, 1, 2)
        F, Q = np.concatenate([np.eye(n)[None], F]), np.concatenate([np.zeros((1, n, n)), Q])
        if problem.at == "posterior":
            F[N], Q[N] = np.eye(n), 0.0
        return F, np.zeros((N + 1, n)), Q
    since, start = cast(SampleTimes, problem.clock).since, problem.clock.start
    F, Q = transitions(plant.A, plant.noise, since[:-1], since[1:], start)
    g = np.zeros((N + 1, n))
    if plant.B is not None:
        g = driven_transitions(plant, start + since[:-1], start + since[1:])[1]
    return F, g, Q


def reading_predictor(problem: ReadingsProblem, model: ReadingModel) -> Predictor:
    """The prediction of the output from the estimate after every reading.

    Parameters
    ----------
    problem : ReadingsProblem
    model : of its schedule, N intervals
    """
    D, N = problem.output.at(problem.output_at), model.intervals
    p, n = D.shape
    F, g, Q = (part[-1] for part in between(problem))
    if not problem.discrete:
        at = float(problem.predict_at or 0.0)
        last, push, gram = (x[0] for x in driven_transitions(problem.plant, model.edges[-1:], np.array([at])))
        F, g, Q = last, push, gram
    matrix, offset, noise = np.empty((N + 1, p, n)), np.empty((N + 1, p)), np.empty((N + 1, p, p))
    matrix[N], offset[N], noise[N] = D @ F, D @ g, D @ Q @ D.T
    for k in range(N - 1, -1, -1):
        later = matrix[k + 1]
        matrix[k], offset[k] = later @ model.transition[k], later @ model.input[k] + offset[k + 1]
        noise[k] = later @ model.noise[k] @ later.T + noise[k + 1]
    return Predictor(matrix, offset, noise)


def matched_filter(problem: ReadingsProblem, schedule: Schedule, gate: float | None = None) -> MatchedFilter:
    """The on-line filter: one `step` for every reading time.

    Parameters
    ----------
    problem : ReadingsProblem
    schedule : to follow
    gate : probability; a reading farther off than a consistent one would be with this probability is left out
    """
    model = reading_model(problem, schedule)
    return MatchedFilter(problem, schedule, model, gate=gate, predictor=reading_predictor(problem, model))


def run_filter(
    problem: ReadingsProblem, schedule: Schedule, measurements: Sequence[Measurement], gate: float | None = None
) -> Estimate:
    """Estimate the state and predict the output from readings along a schedule.

    Parameters
    ----------
    problem : ReadingsProblem with n states
    schedule : with N readings
    measurements : each a reading of one sensor at one of the instants, in any order
    gate : see `matched_filter`

    Returns an Estimate with N+1 rows: before the first reading, then after each. Raises ProblemError naming line and
    sensor of every reading that does not belong to the schedule.
    """
    matched = matched_filter(problem, schedule, gate)
    model = matched.model
    samples = arrange(
        problem.clock.times, model.names, model.rows, model.active, measurements, instants=True, slack=1e-6
    )
    steps = [matched.state()]
    for sample in samples:
        steps.append(matched.step(sample))
    D = problem.output.at(problem.output_at)
    return Estimate(
        times=model.edges,
        mean=np.array([s.estimate for s in steps]),
        standard_deviation=np.array([deviation_of(s.covariance) for s in steps]),
        predicted=np.array([s.prediction for s in steps]),
        predicted_deviation=np.array([deviation_of(s.prediction_covariance) for s in steps]),
        nis=np.array([s.nis for s in steps]),
        dimension=np.array([s.dimension for s in steps]),
        covariance=np.array([s.covariance for s in steps]),
        notes=notes_of(model, steps, gate, instants=True),
        output=np.array([D @ s.estimate for s in steps]),
        output_deviation=np.array([deviation_of(D @ s.covariance @ D.T) for s in steps]),
    )


def simulate(problem: ReadingsProblem, schedule: Schedule, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """One true trajectory and what the scheduled sensors report of it.

    Parameters
    ----------
    problem : ReadingsProblem
    schedule : to follow
    seed : of the random generator; the same seed gives the same data

    Returns the readings, and the truth before the first reading and at every one.
    """
    model = reading_model(problem, schedule)
    states, readings = draw(model, [seed])
    measurements = [
        Measurement(float(model.edges[k + 1]), model.names[j], readings[k][0, place])
        for k in range(model.intervals)
        for j, place in model.places(k).items()
    ]
    return measurements, Trajectory(model.edges, states[0])


def reading_tables(problem: ReadingsProblem, schedule: ReadingSchedule | Schedule) -> dict[str, np.ndarray]:
    """Everything that an on-line filter of readings needs, by the names of filter/tables.py.

    Parameters
    ----------
    problem : ReadingsProblem
    schedule : to follow
    """
    matched = matched_filter(problem, schedule)
    D = problem.output.at(problem.output_at)
    return tables_of(matched, np.broadcast_to(D, (matched.model.intervals + 1, *D.shape)).copy())


def reading_target(problem: ReadingsProblem, schedule: Schedule) -> TargetPlan:
    """The schedule and its filter for code on a target.

    Parameters
    ----------
    problem : ReadingsProblem
    schedule : to follow
    """
    model = reading_model(problem, schedule)
    clock = problem.clock.variable
    at = "" if problem.discrete or problem.predict_at is None else f" at {clock} = {problem.predict_at:g}"
    return plan_of(model, reading_predictor(problem, model), instants=True, variable=clock, predicted_for=at)
