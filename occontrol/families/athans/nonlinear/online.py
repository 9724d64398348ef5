"""The filter of a nonlinear plant as an object for a loop on a target: one `step` for every reading time or interval.

It relinearises at its own estimate (EKF), or follows sigma points (UKF), along the plan's schedule. A planned reading
that does not come is left out. The watch adds the normalised innovations of the last readings: where they exceed what a
consistent filter exceeds once in a hundred thousand times, the filter has probably lost the track.
Athans (1971), section 8.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import ProblemError, UsageError, suggest
from occontrol.core.schedule import Schedule
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.filter.online import MatchedStep
from occontrol.families.athans.nonlinear.estimators import Extended, estimator_named, triangle
from occontrol.families.athans.nonlinear.index import Stages, stages
from occontrol.families.athans.nonlinear.linearise import ESTIMATORS
from occontrol.families.athans.nonlinear.prediction import Prediction
from occontrol.families.athans.nonlinear.readout import Readout
from occontrol.numerics.linalg import square_root

USED = 1e-9
WATCHED = 10  # readings whose normalised innovations are added
RARE = 1e-5  # how often a consistent filter is called lost


@dataclass(frozen=True, eq=False, kw_only=True)
class NonlinearStep(MatchedStep):
    """What the filter knows after a reading.

    Parameters
    ----------
    diverging : whether the last innovations are larger than those of a consistent filter ever are
    recent : sum of the last normalised innovations squared
    limit : what a consistent filter stays below
    """

    diverging: bool = False
    recent: float = 0.0
    limit: float = np.inf


class NonlinearFilter:
    """EKF or UKF, and predictor, along a schedule.

    Parameters
    ----------
    problem : with a nonlinear plant
    schedule : to follow; of readings, or of intervals
    estimator : "ekf", "iterated" or "ukf"; the problem's own if left out
    gate : probability; a reading farther off than a consistent one would be with this probability is left out

    Raises UsageError for an unknown estimator and for a gate that is no probability.
    """

    def __init__(
        self, problem: AthansProblem, schedule: Schedule, estimator: str | None = None, gate: float | None = None
    ):
        self.chain: Stages = stages(problem, schedule.edges)
        origin = self.chain.origin
        name = estimator or origin.estimator
        if name not in ESTIMATORS:
            raise UsageError(f"there is no filter '{name}'\n  hint: {suggest(name, ESTIMATORS)}")
        if gate is not None and not 0 < gate < 1:
            raise UsageError(f"gate is {gate:g}, it must be a probability between 0 and 1\n  hint: for example 0.9999")
        self.gate, self.estimator, self.averaging = gate, estimator_named(name), not problem.takes_readings
        if self.averaging and name == "iterated":  # an average is of the whole way, not of one state
            self.estimator = Extended()
        names = problem.sensors.names
        weights = schedule.on_grid(schedule.edges, names) if self.averaging else _weights(problem, schedule)
        self.names, self.readouts = tuple(names), []
        self.active: list[tuple[int, ...]] = []
        made: dict[tuple, Readout] = {}
        for k in range(len(self.chain.times)):
            used = tuple(j for j in np.flatnonzero(weights[k] > USED).tolist() if names[j] in origin.sensors)
            shares = tuple(float(self.chain.share[k] * weights[k, j]) for j in used)
            sensors = [origin.sensors[names[j]] for j in used]
            key = (used, shares)
            if key not in made:
                made[key] = Readout(origin.plant, sensors, shares)
            self.active.append(used)
            self.readouts.append(made[key])
        self.rows = tuple(origin.sensors[name].rows if name in origin.sensors else 0 for name in names)
        start = self.chain.since[0]
        self.edges = np.append(start, self.chain.times)
        self.prediction = Prediction(problem, self.chain)
        self.restart()

    def restart(self) -> None:
        """Back to the start of the horizon."""
        plant = self.chain.origin.plant
        self.k = 0
        self.mean = plant.whole_mean
        self.root = triangle(square_root(plant.whole_covariance, floor=0.0))
        self.recent: deque[tuple[float, int]] = deque(maxlen=WATCHED)

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) of the state."""
        return self.root @ self.root.T

    @property
    def intervals(self) -> int:
        """The number N of steps."""
        return len(self.chain.times)

    @property
    def dimension(self) -> np.ndarray:
        """(N,) how many values each step should bring."""
        return np.array([readout.rows for readout in self.readouts], dtype=int)

    @property
    def next_sensors(self) -> tuple[str, ...]:
        """Names of the sensors to read next."""
        return () if self.finished else tuple(self.names[j] for j in self.active[self.k])

    @property
    def times_left(self) -> np.ndarray:
        """Times of the samples that are still to come."""
        return self.edges[self.k + 1 :]

    @property
    def finished(self) -> bool:
        """Whether the end of the horizon is reached."""
        return self.k >= self.intervals

    def state(self, nis: float = np.nan, dimension: int = 0, samples=None, skipped: tuple[str, ...] = ()):
        """What is known now, without a step.

        Parameters
        ----------
        nis, dimension : of the last reading, if there was one
        samples : {sensor: (nis, number of values)} of those that reported
        skipped : names of the sensors whose samples the gate left out
        """
        w, spread = self.prediction.from_estimate(self.k, self.mean, self.covariance)
        recent, values = (sum(part) for part in zip(*self.recent, strict=True)) if self.recent else (0.0, 0)
        limit = _limit(1 - RARE, int(values)) if values else np.inf
        return NonlinearStep(
            time=float(self.edges[self.k]), estimate=self.mean.copy(), covariance=self.covariance, prediction=w,
            prediction_covariance=spread, nis=nis, dimension=dimension, next_sensors=self.next_sensors, planned=False,
            samples=samples or {}, skipped=skipped, diverging=bool(recent > limit), recent=float(recent), limit=limit,
        )  # fmt: skip

    def step(self, measurements: Mapping[str, np.ndarray] | np.ndarray | None = None) -> NonlinearStep:
        """Go on to the next reading time, or the end of the next interval, with what was measured.

        Parameters
        ----------
        measurements : {sensor name: (m,) values}; the values alone when one sensor is in use; None, or a sensor
            left out, when the sample is missing, and NaN for a single value that is

        Raises ProblemError for a sensor that is not in use, a wrong number of values, infinite values, beyond the end
        of the horizon, and where the estimate leaves the numbers.
        """
        if self.finished:
            raise ProblemError("the horizon is over: there is no further reading", "restart() begins again")
        k, chain, readout = self.k, self.chain, self.readouts[self.k]
        z = self._stack(measurements)
        time = float(chain.times[k])
        span = (float(chain.since[k]), float(chain.lengths[k]), chain.substeps)
        before = self.root
        if self.averaging:
            joint = self.estimator.averaged(readout, self.mean, self.root, span)
        else:
            mean, before = self.estimator.predicted(chain.origin.plant.flow, self.mean, self.root, span)
            joint = self.estimator.reading(readout, mean, before, time)
        samples, skipped = self._judge(joint, readout, z)
        which = np.flatnonzero(np.isfinite(z))
        mean, root, nis = self.estimator.after(readout, joint, z, which, before, time)
        if not (np.all(np.isfinite(mean)) and np.all(np.isfinite(root))):
            what = f"the estimate leaves the numbers at {chain.origin.plant.variable} = {time:.6g}"
            raise ProblemError(what, "the filter has lost the track: more readings, or a better initial estimate")
        self.mean, self.root, self.k = mean, root, k + 1
        if len(which):
            self.recent.append((nis, len(which)))
        return self.state(nis, len(which), samples, skipped)

    def _judge(self, joint, readout: Readout, z: np.ndarray) -> tuple[dict[str, tuple[float, int]], tuple[str, ...]]:
        """NIS of every sensor by itself; what the gate leaves out becomes NaN in `z`."""
        from occontrol.families.athans.nonlinear.wrap import wrapped

        error, samples, skipped = wrapped(z - joint.expected, readout.angles), {}, []
        for sensor, place in zip(readout.sensors, readout.places, strict=True):
            there = np.arange(len(z))[place]
            there = there[np.isfinite(z[there])]
            if len(there):
                samples[sensor.name] = joint.judged(error, there), len(there)
                if self.gate is not None and samples[sensor.name][0] > _limit(self.gate, len(there)):
                    skipped.append(sensor.name)
                    z[place] = np.nan
        return samples, tuple(skipped)

    def _stack(self, sample) -> np.ndarray:
        """All values of the step, NaN where missing."""
        readout = self.readouts[self.k]
        z, names = np.full(readout.rows, np.nan), [s.name for s in readout.sensors]
        places = dict(zip(names, readout.places, strict=True))
        if sample is None:
            return z
        if not isinstance(sample, Mapping):
            if len(places) != 1:
                raise ProblemError(f"{len(places)} sensors are in use", "give {name: values}")
            sample = {next(iter(places)): sample}
        for name, values in sample.items():
            if name not in places:
                raise ProblemError(f"sensor '{name}' is not in use, in use: {', '.join(places) or 'none'}")
            values, place = np.atleast_1d(np.asarray(values, dtype=float)), places[name]
            if values.shape != (place.stop - place.start,) or np.any(np.isinf(values)):
                what = f"a sample of sensor '{name}' is {place.stop - place.start} finite values, not {values}"
                raise ProblemError(what)
            z[place] = values
        return z


def _limit(probability: float, degrees: int) -> float:
    from scipy.stats import chi2

    return float(chi2.ppf(probability, degrees))


def _weights(problem: AthansProblem, schedule: Schedule) -> np.ndarray:
    from occontrol.families.athans.readings.filter import weights_on

    return weights_on(problem, schedule)  # type: ignore[arg-type]
