"""A filter over a file of measurements along a plan, and simulated truth and measurements, for a nonlinear plant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.arrange import arrange
from occontrol.core.errors import SolveFailed
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.schedule import Schedule
from occontrol.core.trajectory import Trajectory
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.filter.kalman_bucy import deviation_of, notes_of
from occontrol.families.athans.nonlinear.online import NonlinearFilter, NonlinearStep
from occontrol.numerics.linalg import square_root


def run_filter(
    problem: AthansProblem,
    schedule: Schedule,
    measurements: Sequence[Measurement],
    estimator: str | None = None,
    gate: float | None = None,
) -> Estimate:
    """Estimate the state and predict the output along a schedule.

    Parameters
    ----------
    problem : with a nonlinear plant of n states
    schedule : with N readings, or N intervals
    measurements : each a reading of one sensor at its instant, or the average over the interval that ends at its time
    estimator, gate : see NonlinearFilter

    Returns an Estimate with N+1 rows: at the start, then after each step. Raises ProblemError naming line and sensor of
    every reading that does not belong to the schedule.
    """
    matched = NonlinearFilter(problem, schedule, estimator, gate)
    times = matched.edges[1:] if problem.takes_readings else matched.edges
    how = {"instants": True, "slack": 1e-6} if problem.takes_readings else {}
    samples = arrange(times, matched.names, matched.rows, matched.active, measurements, **how)
    steps = [matched.state()]
    for sample in samples:
        steps.append(matched.step(sample))
    D = np.array([_output(problem, s.time) for s in steps])
    return Estimate(
        times=matched.edges,
        mean=np.array([s.estimate for s in steps]),
        standard_deviation=np.array([deviation_of(s.covariance) for s in steps]),
        predicted=np.array([s.prediction for s in steps]),
        predicted_deviation=np.array([deviation_of(s.prediction_covariance) for s in steps]),
        nis=np.array([s.nis for s in steps]),
        dimension=np.array([s.dimension for s in steps]),
        covariance=np.array([s.covariance for s in steps]),
        notes=_notes(matched, steps, gate, problem.takes_readings),
        output=np.array([d @ s.estimate for d, s in zip(D, steps, strict=True)]),
        output_deviation=np.array([deviation_of(d @ s.covariance @ d.T) for d, s in zip(D, steps, strict=True)]),
    )


def _output(problem: AthansProblem, time: float) -> np.ndarray:
    at = problem.output_at if problem.takes_readings else time  # type: ignore[attr-defined]
    return np.nan_to_num(problem.output.at(at))  # type: ignore[attr-defined]


def _notes(matched: NonlinearFilter, steps: Sequence[NonlinearStep], gate: float | None, instants: bool):
    notes = list(notes_of(matched, steps, gate, instants, "the filter went on without them"))
    lost = next((s for s in steps if s.diverging), None)
    if lost is not None:
        t = matched.chain.origin.plant.variable
        notes.append(
            f"the filter has probably lost the track by {t} = {lost.time:.6g}: the last normalised innovations add up "
            f"to {lost.recent:.4g}, those of a consistent filter stay below {lost.limit:.4g}"
        )
    return tuple(notes)


def simulate(problem: AthansProblem, schedule: Schedule, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """One true path of the nonlinear plant and what the scheduled sensors report of it.

    Parameters
    ----------
    problem : with a nonlinear plant
    schedule : to follow
    seed : of the random generator; the same seed gives the same data

    Noise of a span is drawn from its covariance along the true path. A sensor that does not see the true state (its
    `visible` is not above 0) brings nothing: a lost reading. Returns the measurements, and the truth at every step.
    Raises SolveFailed where the true state leaves the range of the numbers.
    """
    matched, luck = NonlinearFilter(problem, schedule), np.random.default_rng(seed)
    chain, flow = matched.chain, matched.chain.origin.plant.flow
    n, substeps = len(matched.mean), chain.substeps
    x = matched.mean + matched.root @ luck.standard_normal(n)
    states, measurements = [x], []
    for k, time in enumerate(chain.times):
        readout, h = matched.readouts[k], float(chain.lengths[k])
        m = readout.rows
        shock, noise = luck.standard_normal(n + m), luck.standard_normal(m)
        since = float(chain.since[k])
        if matched.averaging:
            end, _, Q = readout.integrated.across(np.append(x, np.zeros(m)), since, h, substeps)
            end = end + square_root(_finite(Q, time), floor=0.0) @ shock
            x, z = end[:n], end[n:] / h
        else:
            end, _, Q = flow.across(x, since, h, substeps)
            x = end + square_root(_finite(Q, time), floor=0.0) @ shock[:n]
            z = readout.values(x[None], float(time))[0]
        states.append(_finite(x, time))
        z = z + square_root(readout.covariance(x, float(time)), floor=0.0) @ noise
        z = np.where(readout.angles, np.mod(z + np.pi, 2 * np.pi) - np.pi, z)
        seen = readout.seen(x, float(time))
        for sensor, place, there in zip(readout.sensors, readout.places, seen, strict=True):
            if there:
                measurements.append(Measurement(float(time), sensor.name, z[place]))
    return measurements, Trajectory(matched.edges, np.array(states))


def _finite(found: np.ndarray, time: float) -> np.ndarray:
    if not np.all(np.isfinite(found)):
        hint = "another seed, or an initial covariance (sd of a parameter) that keeps to what the formulas can stand"
        raise SolveFailed(f"the simulated state leaves the range of the numbers before t = {time:g}\n  hint: {hint}")
    return found
