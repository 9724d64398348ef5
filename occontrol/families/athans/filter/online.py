"""The matched filter as an object for a loop on a target: one `step` per interval.

    innovation e = z - H x - d,  its covariance Y = H P H' + R,  gain K = (F P H' + S) Y^-1
    x+ = F x + g + K e
    P+ = (F - K H) P (F - K H)' + [I, -K] [[Q, S], [S', R]] [I, -K]'

(the Kalman filter with the correlated noises of a SampledModel). Covariances are carried as square roots, see
numerics/square_root_filter.py, so that they stay definite whatever the data. As long as every planned sample arrives,
gain and covariance are the ones computed beforehand; from the first missing sample on they are computed anew at every
step.
Athans (1971), sections 3.1 and 7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.measurement import Step
from occontrol.core.schedule import Schedule
from occontrol.families.athans.filter.predictor import Predictor, make_predictor
from occontrol.families.athans.filter.sampled_model import SampledModel, exact_model, split_model
from occontrol.numerics.linalg import square_root, symmetrise
from occontrol.numerics.square_root_filter import advance, gain_of, triangularise, whitened

MODELS = {"split": split_model, "exact": exact_model}


@dataclass(frozen=True, eq=False, kw_only=True)
class MatchedStep(Step):
    """What the filter knows at a node; the prediction is of w(Tp).

    Parameters
    ----------
    planned : whether covariance and gain are still the ones computed beforehand
    samples : {sensor: (nis, number of values)} of every sensor that reported, each judged by itself
    skipped : names of the sensors whose samples the gate left out
    """

    planned: bool
    samples: Mapping[str, tuple[float, int]] = field(default_factory=dict)
    skipped: tuple[str, ...] = ()

    @property
    def skipped_values(self) -> int:
        """How many values the gate left out."""
        return sum(self.samples[name][1] for name in self.skipped)


@dataclass(frozen=True, eq=False)
class Plan:
    """Gains and covariances along a schedule, computed before any measurement.

    Parameters
    ----------
    gain : N arrays K (n, m): node to node, they include the half step after the reading
    innovation_root : N arrays D (m, m), lower triangular, D D' = Y
    root : (N+1, n, n) S with P = S S' at the nodes
    """

    gain: list[np.ndarray]
    innovation_root: list[np.ndarray]
    root: np.ndarray

    @cached_property
    def innovation(self) -> list[np.ndarray]:
        """N arrays Y (m, m): the covariance of every innovation."""
        return [root @ root.T for root in self.innovation_root]

    @cached_property
    def covariance(self) -> np.ndarray:
        """(N+1, n, n) P at the nodes."""
        return symmetrise(self.root @ np.swapaxes(self.root, 1, 2))


def make_plan(model: SampledModel) -> Plan:
    """Gains and covariances when every planned sample arrives.

    Parameters
    ----------
    model : SampledModel
    """
    root = np.empty((model.intervals + 1, model.states, model.states))
    root[0] = square_root(model.covariance, floor=0.0)
    gains, innovations = [], []
    for k in range(model.intervals):
        gain, innovation, root[k + 1] = _advance(model, k, root[k], np.arange(len(model.offset[k])))
        gains.append(gain)
        innovations.append(innovation)
    return Plan(gains, innovations, root)


def _advance(model: SampledModel, k: int, root: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, ...]:
    """Gain K, innovation root D and the next root S+ when the stacked values `kept` arrive."""
    noise, n = model.noise_roots[k], model.states
    rows = np.ascontiguousarray(model.observe[k][kept])
    stacked = np.concatenate((noise[n + kept], noise[:n]))
    after, normalised, innovation = advance(root, np.ascontiguousarray(model.transition[k]), rows, stacked)
    return gain_of(normalised, innovation), innovation, after


class MatchedFilter:
    """Kalman filter and predictor along a schedule, one `step` per interval.

    Parameters
    ----------
    problem : SchedulingProblem; any problem where model and predictor are given
    schedule : Schedule to follow
    model : "split" (default; its covariance is the schedule's) or "exact" (for coarse grids), or a SampledModel
    plan : Plan to use instead of the computed one
    gate : probability; a sample farther off than a consistent one would be with this probability is left out
    predictor : Predictor for the model's nodes, where they are not the edges of a SchedulingProblem

    Athans (1971), equations (3.2), (3.6)-(3.8), (7.3)-(7.5).

    Raises UsageError for an unknown model and for a gate that is no probability.
    """

    def __init__(
        self,
        problem: Any,
        schedule: Schedule,
        model: str | SampledModel = "split",
        plan: Plan | None = None,
        gate: float | None = None,
        predictor: Predictor | None = None,
    ):
        if isinstance(model, str) and model not in MODELS:
            raise UsageError(f"there is no filter model '{model}'\n  hint: there are: {', '.join(MODELS)}")
        self.model = MODELS[model](problem, schedule) if isinstance(model, str) else model
        if gate is not None and not 0 < gate < 1:
            raise UsageError(f"gate is {gate:g}, it must be a probability between 0 and 1\n  hint: for example 0.9999")
        self.gate = gate
        self._limits: dict[int, float] = {}
        self.plan = plan or make_plan(self.model)
        self.predictor: Predictor = predictor or make_predictor(problem, self.model)
        self.restart()

    def restart(self) -> None:
        """Back to the start of the horizon."""
        self.k, self.planned = 0, True
        self.mean, self.root = self.model.mean.copy(), self.plan.root[0]

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) of the state, P = S S'."""
        return self.root @ self.root.T

    @property
    def next_sensors(self) -> tuple[str, ...]:
        """Names of the sensors to read during the coming interval."""
        if self.k >= self.model.intervals:
            return ()
        return tuple(self.model.names[j] for j in self.model.active[self.k])

    @property
    def times_left(self) -> np.ndarray:
        """Times of the samples that are still to come, the ends of their intervals."""
        return self.model.edges[self.k + 1 :]

    @property
    def finished(self) -> bool:
        """Whether the end of the horizon is reached."""
        return self.k >= self.model.intervals

    def state(self, nis: float = np.nan, dimension: int = 0) -> MatchedStep:
        """What is known now, without a step.

        Parameters
        ----------
        nis, dimension : of the last sample, if there was one
        """
        covariance = self.covariance
        w, spread = self.predictor.predict(self.k, self.mean, covariance)
        return MatchedStep(
            time=float(self.model.edges[self.k]),
            estimate=self.mean.copy(),
            covariance=covariance,
            prediction=w,
            prediction_covariance=spread,
            nis=nis,
            dimension=dimension,
            next_sensors=self.next_sensors,
            planned=self.planned,
        )

    def step(self, sample: Mapping[str, np.ndarray] | np.ndarray | None = None) -> MatchedStep:
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
        error = z - model.observe[k] @ self.mean - model.offset[k]
        samples = self._judge(error)
        skipped = tuple(name for name, (nis, m) in samples.items() if nis > self._limit(m))
        for name in skipped:
            z[model.places(k)[model.names.index(name)]] = np.nan
        if skipped:
            kept = np.flatnonzero(np.isfinite(z))
        if len(kept) < len(z):
            self.planned = False
        if self.planned:
            gain, innovation_root, after = self.plan.gain[k], self.plan.innovation_root[k], self.plan.root[k + 1]
        else:
            gain, innovation_root, after = _advance(model, k, self.root, kept)
        error = error[kept]
        self.mean = model.transition[k] @ self.mean + model.input[k] + gain @ error
        self.root = after
        self.k += 1
        nis = float(np.sum(whitened(innovation_root, error) ** 2)) if len(kept) else np.nan
        return replace(self.state(nis, len(kept)), samples=samples, skipped=skipped)

    def _judge(self, error: np.ndarray) -> dict[str, tuple[float, int]]:
        """NIS and number of values of every sensor that reported, by itself; `error` (m,) is NaN where nothing came."""
        model, k, found = self.model, self.k, {}
        noise, n = model.noise_roots[k], model.states
        for j, place in model.places(k).items():
            there = np.arange(len(error))[place]
            there = there[np.isfinite(error[there])]
            if len(there):
                array = np.hstack((model.observe[k][there] @ self.root, noise[n + there]))
                triangularise(array, len(there))
                white = whitened(np.ascontiguousarray(array[:, : len(there)]), error[there])
                found[model.names[j]] = float(white @ white), len(there)
        return found

    def _limit(self, degrees: int) -> float:
        """The NIS of so many values beyond which the gate leaves a sample out."""
        if self.gate is None:
            return np.inf
        if degrees not in self._limits:
            from scipy.stats import chi2

            self._limits[degrees] = float(chi2.ppf(self.gate, degrees))
        return self._limits[degrees]

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
                use = ", ".join(self.next_sensors) or "none"
                raise ProblemError(f"sensor '{name}' is not in use, in use: {use}")
            values = np.atleast_1d(np.asarray(values, dtype=float))
            if values.shape != (model.rows[j],) or np.any(np.isinf(values)):
                raise ProblemError(f"a sample of sensor '{name}' is {model.rows[j]} finite values, not {values}")
            z[places[j]] = values
        return z, np.flatnonzero(np.isfinite(z))
