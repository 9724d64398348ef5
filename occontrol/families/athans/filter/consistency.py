"""Does a filter believe of its errors what is true? NIS and NEES with their chi-squared bands.

    NIS  = e' Y^-1 e            of an innovation e with m values:   chi-squared, m degrees, independent in time
    NEES = (x - xh)' P^-1 (x - xh)   of the n states:               chi-squared, n degrees, dependent in time

Averages over independent runs are compared with the band that holds them with 99 % probability.
Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.measurement import Estimate
from occontrol.core.schedule import Schedule
from occontrol.core.trajectory import Trajectory
from occontrol.families.athans.filter.online import MODELS, Plan, make_plan
from occontrol.families.athans.filter.sampled_model import SampledModel, exact_model
from occontrol.families.athans.filter.simulate import draw
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.linalg import solve_lower, whitener

PROBABILITY = 0.99


def average_band(degrees: float, probability: float = PROBABILITY) -> tuple[float, float]:
    """The band of (chi-squared with `degrees` degrees)/degrees: two-sided, e.g. 0.5 % on either side.

    Parameters
    ----------
    degrees : degrees of freedom in all (values times runs)
    probability : of lying inside
    """
    from scipy.stats import chi2

    tail = (1 - probability) / 2
    low, high = chi2.ppf([tail, 1 - tail], degrees) / degrees
    return float(low), float(high)


def nees(truth: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normalised estimation error squared at every node, and its degrees of freedom (n, less where P is singular).

    Parameters
    ----------
    truth : (..., K, n) true states; leading axes are runs
    mean : (..., K, n)
    covariance : (K, n, n)
    """
    error = truth - mean
    value = np.zeros(error.shape[:-1])
    degrees = np.zeros(len(covariance), dtype=int)
    for k, P in enumerate(covariance):
        white = whitener(P)
        value[..., k] = np.sum((error[..., k, :] @ white) ** 2, axis=-1)
        degrees[k] = white.shape[1]
    return value, degrees


def expected_nees(problem: SchedulingProblem, schedule: Schedule, model: str = "split") -> np.ndarray:
    """The mean NEES per degree of freedom that a filter has against the continuous plant, without any simulation.

    1 for the exact model; 1 + O(h^2) for the split model. With e = x - xh, H, d of the plant, Hs, ds of the filter,

        e+ = (F - K Hs) e - K (H - Hs) x - K (d - ds) + w - K v

    so mean and covariance of (x, e) together obey a linear recursion.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule with N intervals
    model : of the filter, "split" or "exact"

    Returns (N+1,), one value per node.
    """
    truth, own = exact_model(problem, schedule), MODELS[model](problem, schedule)
    plan, n = make_plan(own), own.states
    joint = np.tile(own.covariance, (2, 2))
    mean, bias = own.mean, np.zeros(n)
    result = np.ones(own.intervals + 1)
    for k in range(own.intervals):
        F, K, S = truth.transition[k], plan.gain[k], truth.cross[k]
        wrong = K @ (truth.observe[k] - own.observe[k])
        closed = own.transition[k] - K @ own.observe[k]
        step = np.block([[F, np.zeros((n, n))], [F - own.transition[k] - wrong, closed]])
        Q = truth.noise[k]
        mixed = Q - S @ K.T
        last = mixed - K @ S.T + K @ truth.reading_noise[k] @ K.T
        joint = step @ joint @ step.T + np.block([[Q, mixed], [mixed.T, last]])
        bias = closed @ bias - wrong @ mean - K @ (truth.offset[k] - own.offset[k])
        mean = F @ mean + truth.input[k]
        white = whitener(plan.covariance[k + 1])
        moment = joint[n:, n:] + np.outer(bias, bias)
        result[k + 1] = np.sum((moment @ white) * white) / max(1, white.shape[1])
    return result


@dataclass(frozen=True, eq=False)
class Consistency:
    """NIS and NEES of K runs.

    Parameters
    ----------
    times : (N+1,) nodes
    nis : (K, N) NaN where nothing was measured
    dimension : (N,) values behind each
    nees : (K, N+1)
    degrees : (N+1,)
    """

    times: np.ndarray
    nis: np.ndarray
    dimension: np.ndarray
    nees: np.ndarray
    degrees: np.ndarray

    @property
    def average_nis(self) -> float:
        """NIS per value, over all steps and runs."""
        return float(np.nansum(self.nis) / (len(self.nis) * max(1, int(np.sum(self.dimension)))))

    @property
    def nis_band(self) -> tuple[float, float]:
        """The 99 % band of `average_nis`."""
        return average_band(len(self.nis) * int(np.sum(self.dimension)))

    @property
    def average_nees(self) -> np.ndarray:
        """(N+1,) NEES per degree of freedom, over the runs; NaN where the covariance is zero."""
        degrees = np.where(self.degrees > 0, self.degrees, np.nan)
        return np.mean(self.nees, axis=0) / degrees

    @property
    def nees_band(self) -> tuple[float, float]:
        """The 99 % band of `average_nees` at one node (of those with most degrees of freedom)."""
        return average_band(len(self.nees) * max(1, int(np.max(self.degrees))))

    @property
    def nees_inside(self) -> float:
        """The share of the nodes at which `average_nees` lies inside its band; 0.99 is expected."""
        bands = {d: average_band(len(self.nees) * d) for d in set(self.degrees.tolist()) if d}
        pairs = zip(self.average_nees, self.degrees.tolist(), strict=True)
        inside = [bands[d][0] <= value <= bands[d][1] for value, d in pairs if d]
        return float(np.mean(inside)) if inside else 1.0


def monte_carlo(
    problem: SchedulingProblem,
    schedule: Schedule,
    seeds: Sequence[int],
    model: str = "split",
    truth: SampledModel | None = None,
    plan: Plan | None = None,
) -> Consistency:
    """Simulate and filter many runs at once.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule to follow
    seeds : one per run
    model : of the filter, "split" or "exact"
    truth : SampledModel to draw from; the continuous plant (exact) if left out
    plan : gains and covariances that the filter uses; computed if left out
    """
    truth = truth or exact_model(problem, schedule)
    states, readings = draw(truth, seeds)
    own = truth if model == "exact" and truth.edges is schedule.edges else MODELS[model](problem, schedule)
    plan = plan or make_plan(own)
    mean = np.empty_like(states)
    mean[:, 0] = own.mean
    nis = np.full((len(states), own.intervals), np.nan)
    for k in range(own.intervals):
        x = mean[:, k]
        error = readings[k] - x @ own.observe[k].T - own.offset[k]
        mean[:, k + 1] = x @ own.transition[k].T + own.input[k] + error @ plan.gain[k].T
        if error.shape[1]:
            nis[:, k] = np.sum(solve_lower(plan.innovation_root[k], error.T) ** 2, axis=0)
    value, degrees = nees(states, mean, plan.covariance)
    return Consistency(own.edges, nis, own.dimension, value, degrees)


def judge_run(estimate: Estimate, truth: Trajectory) -> Consistency:
    """NIS and NEES of one filter run whose truth is known.

    Parameters
    ----------
    estimate : Estimate with one row per node
    truth : Trajectory at the same nodes
    """
    value, degrees = nees(truth.values[None], estimate.mean[None], estimate.covariance)
    return Consistency(estimate.times, estimate.nis[None, 1:], estimate.dimension[1:], value, degrees)
