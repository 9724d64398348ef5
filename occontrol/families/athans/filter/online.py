"""The matched filter as an object for a loop on a target: one `step` per interval.

    innovation e = z - H x - d,  its covariance Y = H P H' + R,  gain K = (F P H' + S) Y^-1
    x+ = F x + g + K e
    P+ = (F - K H) P (F - K H)' + [I, -K] [[Q, S], [S', R]] [I, -K]'

(the Kalman filter in Joseph form, with the correlated noises of a SampledModel). As long as every planned sample
arrives, gain and covariance are the ones computed beforehand; from the first missing sample on they are computed anew
at every step.
Athans (1971), sections 3.1 and 7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.schedule import Schedule
from occontrol.families.athans.filter.predictor import Predictor, make_predictor
from occontrol.families.athans.filter.sampled_model import SampledModel, exact_model, split_model
from occontrol.families.athans.problem import SchedulingProblem

MODELS = {"split": split_model, "exact": exact_model}


@dataclass(frozen=True, eq=False)
class Step:
    """What the filter knows at a node.

    Parameters
    ----------
    time : t
    estimate, covariance : (n,), (n, n) of the state
    prediction, prediction_covariance : (p,), (p, p) of w(Tp)
    next_sensor : names of the sensors to read during the interval that begins here; () for none
    nis : normalised innovation squared of the sample just taken, NaN if there was none
    dimension : number of values behind nis
    planned : whether covariance and gain are still the ones computed beforehand
    """

    time: float
    estimate: np.ndarray
    covariance: np.ndarray
    prediction: np.ndarray
    prediction_covariance: np.ndarray
    next_sensor: tuple[str, ...]
    nis: float
    dimension: int
    planned: bool


@dataclass(frozen=True, eq=False)
class Plan:
    """Gains and covariances along a schedule, computed before any measurement.

    Parameters
    ----------
    gain : N arrays K (n, m): node to node, they include the half step after the reading
    innovation : N arrays Y (m, m)
    covariance : (N+1, n, n) at the nodes
    """

    gain: list[np.ndarray]
    innovation: list[np.ndarray]
    covariance: np.ndarray


def make_plan(model: SampledModel) -> Plan:
    """Gains and covariances when every planned sample arrives.

    Parameters
    ----------
    model : SampledModel
    """
    covariance = np.empty((model.intervals + 1, model.states, model.states))
    covariance[0] = model.covariance
    gains, innovations = [], []
    for k in range(model.intervals):
        kept = np.arange(len(model.offset[k]))
        gain, innovation, covariance[k + 1] = _advance(model, k, covariance[k], kept)
        gains.append(gain)
        innovations.append(innovation)
    return Plan(gains, innovations, covariance)


def _advance(model: SampledModel, k: int, P: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, ...]:
    """Gain, innovation covariance and the next covariance when the stacked values `kept` arrive."""
    F, Q = model.transition[k], model.noise[k]
    H, R, S = model.observe[k][kept], model.reading_noise[k][np.ix_(kept, kept)], model.cross[k][:, kept]
    if not len(kept):
        after = F @ P @ F.T + Q
        return np.zeros((len(F), 0)), np.zeros((0, 0)), (after + after.T) / 2
    innovation = H @ P @ H.T + R
    gain = np.linalg.solve(innovation, (F @ P @ H.T + S).T).T
    closed = F - gain @ H
    after = closed @ P @ closed.T + Q - gain @ S.T - S @ gain.T + gain @ R @ gain.T
    return gain, innovation, (after + after.T) / 2


class MatchedFilter:
    """Kalman filter and predictor along a schedule, one `step` per interval.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule to follow
    model : "split" (default; its covariance is the schedule's) or "exact" (for coarse grids), or a SampledModel
    plan : Plan to use instead of the computed one

    Athans (1971), equations (3.2), (3.6)-(3.8), (7.3)-(7.5).
    """

    def __init__(
        self,
        problem: SchedulingProblem,
        schedule: Schedule,
        model: str | SampledModel = "split",
        plan: Plan | None = None,
    ):
        if isinstance(model, str) and model not in MODELS:
            raise UsageError(f"there is no filter model '{model}'\n  hint: there are: {', '.join(MODELS)}")
        self.model = MODELS[model](problem, schedule) if isinstance(model, str) else model
        self.plan = plan or make_plan(self.model)
        self.predictor: Predictor = make_predictor(problem, self.model)
        self.restart()

    def restart(self) -> None:
        """Back to the start of the horizon."""
        self.k, self.planned = 0, True
        self.mean, self.covariance = self.model.mean.copy(), self.plan.covariance[0]

    @property
    def next_sensor(self) -> tuple[str, ...]:
        """Names of the sensors to read during the coming interval."""
        if self.k >= self.model.intervals:
            return ()
        return tuple(self.model.names[j] for j in self.model.active[self.k])

    @property
    def finished(self) -> bool:
        """Whether the end of the horizon is reached."""
        return self.k >= self.model.intervals

    def state(self, nis: float = np.nan, dimension: int = 0) -> Step:
        """What is known now, without a step.

        Parameters
        ----------
        nis, dimension : of the last sample, if there was one
        """
        w, spread = self.predictor.predict(self.k, self.mean, self.covariance)
        time = float(self.model.edges[self.k])
        mean = self.mean.copy()
        return Step(time, mean, self.covariance, w, spread, self.next_sensor, nis, dimension, self.planned)

    def step(self, sample: Mapping[str, np.ndarray] | np.ndarray | None = None) -> Step:
        """Advance by one interval with what was measured during it.

        Parameters
        ----------
        sample : {sensor name: (m,) averages over the interval}; the values alone when one sensor is in use; None, or a
            sensor left out, when the sample is missing, and NaN for a single value that is

        Returns the Step at the end of the interval. Raises ProblemError for a sensor that is not in use, a wrong
        number of values, infinite values, and beyond the end of the horizon.
        """
        model, k = self.model, self.k
        if self.finished:
            raise ProblemError("the horizon is over: there is no further interval", "restart() begins again")
        z, kept = self._stack(sample)
        if len(kept) < len(z):
            self.planned = False
        if self.planned:
            gain, innovation, after = self.plan.gain[k], self.plan.innovation[k], self.plan.covariance[k + 1]
        else:
            gain, innovation, after = _advance(model, k, self.covariance, kept)
        error = z[kept] - model.observe[k][kept] @ self.mean - model.offset[k][kept]
        self.mean = model.transition[k] @ self.mean + model.input[k] + gain @ error
        self.covariance = after
        self.k += 1
        nis = float(error @ np.linalg.solve(innovation, error)) if len(kept) else np.nan
        return self.state(nis, len(kept))

    def _stack(self, sample) -> tuple[np.ndarray, np.ndarray]:
        """All values of the interval (NaN where missing) and the positions of those that arrived."""
        model, k = self.model, self.k
        places = model.places(k)
        z = np.full(len(model.offset[k]), np.nan)
        if sample is None:
            sample = {}
        elif not isinstance(sample, Mapping):
            if len(places) != 1:
                raise ProblemError(f"{len(places)} sensors are in use", "give {name: values}")
            sample = {model.names[next(iter(places))]: sample}
        for name, values in sample.items():
            j = model.names.index(name) if name in model.names else -1
            if j not in places:
                use = ", ".join(self.next_sensor) or "none"
                raise ProblemError(f"sensor '{name}' is not in use, in use: {use}")
            values = np.atleast_1d(np.asarray(values, dtype=float))
            if values.shape != (model.rows[j],) or np.any(np.isinf(values)):
                raise ProblemError(f"a sample of sensor '{name}' is {model.rows[j]} finite values, not {values}")
            z[places[j]] = values
        return z, np.flatnonzero(np.isfinite(z))
