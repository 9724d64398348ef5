"""One method on one problem as an experiment of many runs, and the Solution that comes out of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status, make_solution
from occontrol.families.hybrid.imm import start
from occontrol.families.hybrid.imm_kernel import predict_step, score_groups
from occontrol.families.hybrid.monte_carlo import Experiment, Runs, monte_carlo
from occontrol.families.hybrid.result import HybridResult, numbers_of
from occontrol.families.hybrid.statistics import Outcomes, rms, summarise_runs
from occontrol.families.hybrid.truth import Truth

if TYPE_CHECKING:
    from occontrol.families.hybrid.methods import GroupMethod
    from occontrol.families.hybrid.problem import Problem

MOST_STORED_ENTRIES = 2_000_000  # entries of the per-run arrays that go into arrays.npz
LARGE_EXCESS = 1e-6  # of the sum of guard probabilities over 1, worth a word


def experiment(problem: Problem, method: GroupMethod) -> Experiment:
    """What one run of a method on a problem needs.

    Parameters
    ----------
    problem : Problem
    method : an object of one of METHODS

    Raises ProblemError when the method names a sensor that does not exist.
    """
    mode = None if problem.truth_mode is None else problem.plant.names.index(problem.truth_mode)
    return Experiment(
        plant=problem.plant,
        sensors=problem.sensors,
        groups=problem.positions_of(method.groups(problem)),
        steps=int(problem.steps),
        position=problem.position or (),
        truth=Truth(problem.truth_mean, problem.truth_covariance, mode),
        chooser=method.chooser(problem),
        seed=int(problem.seed),
    )


def judge(problem: Problem, method: GroupMethod, monitor: Monitor) -> Solution:
    """Simulate and estimate all runs with one method, or as many as the limits allow.

    Parameters
    ----------
    problem : Problem
    method : an object of one of METHODS
    monitor : Monitor

    Raises SolveFailed when a state or an estimate leaves the range of the numbers.
    """
    began, watch = stopwatch.seconds(), monitor.child(method.time_limit)
    watch.stage = watch.stage or "runs"
    tried = experiment(problem, method)
    outcomes, first = monte_carlo(tried, problem.runs, watch)
    done = outcomes.runs
    status, message = Status.FEASIBLE, f"{done} runs of {problem.steps} steps"
    if done < problem.runs:
        status = Status.INTERRUPTED if watch.interrupted else Status.LIMIT
        message = f"{done} of {problem.runs} runs before the {'interrupt' if watch.interrupted else 'time limit'}"
    if problem.plant.guards is not None and outcomes.excess > LARGE_EXCESS:
        message += f"; guard probabilities that did not sum to 1 (by {outcomes.excess:.2g}) were divided by their sum"
    use = np.stack([np.mean(outcomes.choices == g, axis=0) for g in range(len(tried.groups))], axis=1)
    member = _members(tried)
    schedule = Schedule(np.arange(problem.steps + 1.0), member[first.choices[0]], tuple(problem.sensors.names))
    numbers = _numbers(problem, tried, outcomes, use.mean(axis=0), schedule)
    if method.constant:
        numbers = dataclasses.replace(numbers, sensor=_labels(tried)[0])
    made = make_solution(
        problem=problem,
        method=method.name,
        status=status,
        message=message,
        numbers=numbers,
        monitor=watch,
        began=began,
        iterations=done,
        arrays=_arrays(problem, outcomes, first, schedule, use @ member),
        schedule=schedule,
    )
    return dataclasses.replace(made, history=last_report(watch))


def best_of(problem: Problem, methods: Sequence[GroupMethod], monitor: Monitor) -> Solution:
    """Every method for itself; the one of least average RMS, with the others beside it.

    Parameters
    ----------
    problem : Problem
    methods : that use one group all the time, at least one
    monitor : Monitor, asked after every method whether to stop
    """
    began, watch = stopwatch.seconds(), monitor.child()
    solutions = []
    for method in methods:
        solutions.append(judge(problem, method, watch))
        if watch.stop:
            break
    best = min(solutions, key=lambda s: numbers_of(s).average_rms)
    numbers = dataclasses.replace(
        numbers_of(best), candidates=[numbers_of(solution).as_candidate for solution in solutions]
    )
    return dataclasses.replace(
        best,
        message=f"{numbers.sensor} is the best of {len(solutions)} in average RMS; {best.message}",
        seconds=stopwatch.seconds() - began,
        history=last_report(watch),
        numbers=numbers,
    )


def _members(tried: Experiment) -> np.ndarray:
    """(groups, sensors) 1 where a sensor belongs to a group."""
    member = np.zeros((len(tried.groups), len(tried.sensors)))
    for g, group in enumerate(tried.groups):
        member[g, list(group)] = 1.0
    return member


def _labels(tried: Experiment) -> list[str]:
    return ["+".join(tried.sensors[j].name for j in group) for group in tried.groups]


def _numbers(
    problem: Problem, tried: Experiment, outcomes: Outcomes, share: np.ndarray, schedule: Schedule
) -> HybridResult:
    """The numbers; `share` (groups,) of the steps of all runs."""
    guarded = problem.plant.guards is not None
    summary: PlainDict = dict(summarise_runs(outcomes))
    by_sensor = zip(problem.sensors.names, share @ _members(tried), strict=True)
    return HybridResult(
        **summary,
        use={name: float(value) for name, value in by_sensor},
        group_use={label: float(value) for label, value in zip(_labels(tried), share, strict=True)},
        runs=outcomes.runs,
        states=problem.plant.states,
        first_scores=first_scores(problem, tried),
        schedule=schedule.segments(),
        guard_excess=outcomes.excess if guarded else None,
        guard_error=outcomes.error if guarded else None,
    )


def _arrays(
    problem: Problem, outcomes: Outcomes, first: Runs, schedule: Schedule, use: np.ndarray
) -> dict[str, np.ndarray]:
    """RMS over time, shares over time, and the first run with k = 0 in front."""
    plant, steps = problem.plant, int(problem.steps)
    curve = rms(outcomes.squared)
    spread = np.std(outcomes.squared, axis=0) / np.sqrt(max(outcomes.runs - 1, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        curve_error = np.where(curve > 0, spread / (2 * curve), 0.0)
    arrays = {
        "times": np.arange(steps + 1.0),
        "edges": schedule.edges,
        "weights": schedule.weights,
        "rms": curve,
        "rms_standard_error": curve_error,
        "mode_error_rate": outcomes.wrong.mean(axis=0),
        "use": use,
        "run_mode_errors": outcomes.wrong.sum(axis=1),
        "run_rms": np.sqrt(outcomes.squared.mean(axis=1)),
        "truth": first.truths.states[0],
        "truth_mode": first.truths.modes[0],
        "estimate": np.vstack([plant.mean, first.estimates[0]]),
        "covariance": np.concatenate([plant.covariance[None], first.covariances[0]]),
        "mode_probabilities": np.vstack([plant.probabilities, np.exp(first.log_probabilities[0])]),
    }
    if outcomes.squared.size <= MOST_STORED_ENTRIES:
        arrays["position_error"] = np.sqrt(outcomes.squared)
    return arrays


def last_report(monitor: Monitor) -> tuple[dict, ...]:
    """The last record of progress: how many rounds came before it depends on the machine's speed, not on the runs.

    Parameters
    ----------
    monitor : Monitor
    """
    return tuple(monitor.history[-1:])


def first_scores(problem: Problem, tried: Experiment) -> dict[str, float]:
    """The criterion of every group at k = 1, before anything was measured: it does not depend on chance.

    Parameters
    ----------
    problem : Problem
    tried : Experiment
    """
    model, _ = tried.models()
    means, roots, log_predicted, _, _ = predict_step(model, 1, *start(problem.plant))
    weights = float(tried.chooser.bound_weight), float(tried.chooser.position_weight)
    scores = score_groups(model, 1, means, roots, log_predicted, *weights)
    return {label: float(score) for label, score in zip(_labels(tried), scores, strict=True)}
