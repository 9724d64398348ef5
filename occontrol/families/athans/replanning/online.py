"""A filter for a loop on a target that plans anew on the way: read, step, perhaps plan, say what to read next.

It plans at every `every`-th reading at which a decision begins, unless the last innovations are larger than those of a
consistent filter ever are: a plan from a wrong estimate follows it. Where the deadline passes, the old plan goes on.
Athans (1971), section 8.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from occontrol.core.errors import InfeasibleError, ProblemError
from occontrol.core.measurement import Step
from occontrol.core.schedule import Schedule
from occontrol.families.athans.nonlinear.linearise import Replanning
from occontrol.families.athans.nonlinear.prediction import Prediction
from occontrol.families.athans.readings.filter import reading_model, reading_predictor, weights_on
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.replanning.chain import LinearChain, NonlinearChain, chain_of
from occontrol.families.athans.replanning.filter import predicted, updated
from occontrol.families.athans.replanning.planner import Planner, Replan, usable

USED = 0.5
WATCHED = 10  # readings whose normalised innovations are added
RARE = 1e-4  # how often a consistent filter is called lost


@dataclass(frozen=True, eq=False, kw_only=True)
class ReplannedStep(Step):
    """What is known after a reading.

    Parameters
    ----------
    replan : the plan that was made after it, or None
    diverging : whether the last innovations are larger than those of a consistent filter ever are
    """

    replan: Replan | None = None
    diverging: bool = False


class Watch:
    """The sum of the last normalised innovations, against what a consistent filter stays below."""

    def __init__(self) -> None:
        self._recent: deque[tuple[float, int]] = deque(maxlen=WATCHED)

    def add(self, nis: float, values: int) -> None:
        """Note one reading's NIS and its number of values."""
        if values:
            self._recent.append((nis, values))

    @property
    def diverging(self) -> bool:
        """Whether the sum is beyond what a consistent filter exceeds once in ten thousand times."""
        if not self._recent:
            return False
        total, values = (sum(part) for part in zip(*self._recent, strict=True))
        return bool(total > limit(int(values)))


@cache
def limit(values: int) -> float:
    """What the sum of so many squared normal numbers stays below but once in ten thousand times."""
    from scipy.stats import chi2

    return float(chi2.ppf(1 - RARE, values))


class ReplanningLoop:
    """The on-line object of a problem of readings that plans anew.

    Parameters
    ----------
    problem : ReadingsProblem, of a linear or a nonlinear plant
    schedule : the plan to begin with
    options : Replanning; those of the problem, or the defaults, if left out

    Raises UsageError for continuous sensing, and for a cap on the error.
    """

    def __init__(self, problem: ReadingsProblem, schedule: Schedule, options: Replanning | None = None):
        self.problem, self.chain = problem, chain_of(problem)
        self.options = options or getattr(getattr(problem.plant, "linearised", None), "replan", None) or Replanning()
        self.planner = self._planner(self.chain)
        self.names, self.schedule = tuple(problem.sensors.names), schedule
        self._planned = weights_on(problem, schedule)
        self.predict = self._predictor()
        self.restart()

    def restart(self) -> None:
        """Back to the start of the horizon and the first plan."""
        plant = self.problem.plant
        self.k, self.weights, self.due = 0, self._planned.copy(), False
        self.measuring = self.planner.measuring(self.weights)
        self.mean = np.asarray(plant.mean, dtype=float)[None]
        self.covariance = ((plant.covariance + plant.covariance.T) / 2)[None]
        self.watch, self.shares = Watch(), None
        self._advance()

    @property
    def finished(self) -> bool:
        """Whether the last reading was taken."""
        return self.k >= self.problem.readings

    @property
    def next_sensors(self) -> tuple[str, ...]:
        """Names of the sensors to read next."""
        if self.finished:
            return ()
        return tuple(n for j, n in enumerate(self.names) if self.chain.rows[j] and self.measuring[self.k, j] > USED)

    def step(self, measurements: Mapping[str, np.ndarray] | None = None) -> ReplannedStep:
        """Take the readings of this time, go on to the next one, and plan anew where it is due.

        Parameters
        ----------
        measurements : {sensor name: (m,) values}; a sensor left out, or NaN, is a lost reading

        Raises ProblemError for a sensor that does not exist, a wrong number of values, and beyond the end.
        """
        if self.finished:
            raise ProblemError("the horizon is over: there is no further reading", "restart() begins again")
        nis = values = 0.0
        for name, given in (measurements or {}).items():
            if name not in self.names:
                raise ProblemError(f"there is no sensor '{name}'", f"there are: {', '.join(self.names)}")
            j, z = self.names.index(name), np.atleast_1d(np.asarray(given, dtype=float))
            if z.shape != (self.chain.rows[j],):
                raise ProblemError(f"a reading of sensor '{name}' is {self.chain.rows[j]} values, not {z}")
            if np.all(np.isfinite(z)):
                seen = self.chain.seen(self.k, j, self.mean)
                self.mean, self.covariance, own = updated(
                    self.mean, self.covariance, seen, z[None], self.chain.angles(j)
                )
                nis, values = nis + float(own[0]), values + len(z)
        self.watch.add(nis, int(values))
        time = float(self.problem.clock.times[self.k])
        mean, covariance = self.mean[0], self.covariance[0]
        w, spread = self.predict(self.k + 1, mean, covariance)
        self.k += 1
        self._advance()
        made = self._plan()
        return ReplannedStep(
            time=time, estimate=mean, covariance=covariance, prediction=w, prediction_covariance=spread,
            nis=nis if values else np.nan, dimension=int(values), next_sensors=self.next_sensors, replan=made,
            diverging=self.watch.diverging,
        )  # fmt: skip

    def change(self, problem: ReadingsProblem) -> Replan | None:
        """Go on with the problem as it is from now on: other windows, prices, weights, noises, rules or budgets.

        What was read stays read, and of a new budget what was spent of it is spent. A plan is made at once, and
        returned, or where the next decision begins.

        Parameters
        ----------
        problem : with the same states, sensors and readings

        Raises ProblemError where these differ, InfeasibleError where no schedule goes on from what was done.
        """
        same = (tuple(problem.sensors.names) == self.names, problem.states == self.problem.states)
        if not all(same) or not np.array_equal(problem.clock.times, self.problem.clock.times):
            raise ProblemError("the changed problem has other sensors, states or readings", "begin a new loop for it")
        chain = chain_of(problem)
        planner = self._planner(chain)
        if planner.rules is not None and self.planner.rules is not None:
            planner.rules.spent(self.planner.rules, self.planner.owner, self.k)
        before = (self.problem, self.chain, self.planner, self.predict, self.weights, self.measuring, self.due)
        if isinstance(chain, LinearChain):  # what has closed is not read, even where the next plan has to wait
            closed = problem.upper[planner.owner] <= 0
            closed[: self.k] = False
            self.weights = np.where(closed, 0.0, self.weights)
        self.problem, self.chain, self.planner, self.due = problem, chain, planner, True
        self.predict = self._predictor()
        self.measuring = np.where(self.weights > 0, self.measuring, 0.0)
        try:
            return self._plan(strict=True)
        except (ProblemError, InfeasibleError):
            self.problem, self.chain, self.planner, self.predict, self.weights, self.measuring, self.due = before
            raise

    def _planner(self, chain: LinearChain | NonlinearChain) -> Planner:
        return Planner(chain, self.options.gap, self.options.horizon, self.options.deadline)

    def _advance(self) -> None:
        """Over the span to the next reading, or to the end."""
        mean, F, Q = self.chain.span(self.k, self.mean)
        self.mean, self.covariance = mean, predicted(self.covariance, F, Q)

    def _plan(self, strict: bool = False) -> Replan | None:
        """A new plan where it is due; `strict` lets through why there is none."""
        k = self.k
        if self.finished or not self.planner.begins(k) or not (self.due or k % self.options.every == 0):
            return None
        if (self.watch.diverging and not self.due) or not usable(self.mean, self.covariance):
            return None
        try:
            made = self.planner.plan(k, self.mean[0], self.covariance[0], self.weights, self.shares)
        except (ProblemError, InfeasibleError):  # from a wrong estimate: the old plan goes on
            if strict:
                raise
            return None
        self.shares = made.relaxed
        if not made.late:
            self.weights[k:], self.measuring[k:], self.due = made.weights, made.measuring, False
        return made

    def _predictor(self) -> Callable[[int, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Output and its covariance from the estimate after so many readings."""
        if isinstance(self.chain, NonlinearChain):
            return Prediction(self.problem, self.chain.stages).from_estimate
        return reading_predictor(self.problem, reading_model(self.problem, self.schedule)).predict
