"""One method on one problem as an experiment of many runs, and the Solution that comes out of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.hybrid.methods import ExpectedCovariance, Fixed, Random, Scheduled
from occontrol.families.hybrid.problem import Problem

if TYPE_CHECKING:
    from occontrol.families.hybrid.monte_carlo import Chooser, Experiment, Runs
    from occontrol.families.hybrid.statistics import Outcomes

KEPT = 2_000_000  # entries of the per-run arrays that go into arrays.npz


def experiment(problem: Problem, method: Any) -> Experiment:
    """What one run of a method on a problem needs.

    Parameters
    ----------
    problem : Problem
    method : a METHODS value

    Raises ProblemError when the method names a sensor that does not exist.
    """
    from occontrol.families.hybrid.monte_carlo import Experiment
    from occontrol.families.hybrid.truth import Truth

    groups = problem.groups or ()
    if isinstance(method, Fixed):
        groups = groups[:1] if method.sensor is None else (problem.group_named(method.sensor),)
    mode = None if problem.truth_mode is None else problem.plant.names.index(problem.truth_mode)
    return Experiment(
        plant=problem.plant,
        sensors=problem.sensors,
        groups=problem.positions_of(groups),
        steps=int(problem.steps),
        position=problem.position or (),
        truth=Truth(problem.truth_mean, problem.truth_covariance, mode),
        chooser=_chooser(problem, method),
        seed=int(problem.seed),
    )


def _chooser(problem: Problem, method: Any) -> Chooser:
    from occontrol.families.hybrid.monte_carlo import Chooser

    if isinstance(method, Scheduled):
        return Chooser(None, 1.0, problem.position_weight)
    if isinstance(method, ExpectedCovariance):
        return Chooser(None, 0.0, 1.0)
    if isinstance(method, Random):
        return Chooser(lambda luck, count: np.minimum((luck * count).astype(int), count - 1))
    return Chooser(lambda luck, count: np.broadcast_to(np.arange(luck.shape[1]) % count, luck.shape))


def assemble(
    problem: Problem, method: Any, tried: Experiment, outcomes: Outcomes, first: Runs, monitor: Monitor, seconds: float
) -> Solution:
    """The Solution that the runs add up to.

    Parameters
    ----------
    problem, method, tried : what was solved, how, and as which experiment
    outcomes : of all runs that were done
    first : the complete first run, the example in figures and schedule
    monitor : Monitor
    seconds : wall time
    """
    from occontrol.families.hybrid.statistics import summarise_runs

    done, names = outcomes.runs, problem.sensors.names
    status, message = Status.FEASIBLE, f"{done} runs of {problem.steps} steps"
    if done < problem.runs:
        status = Status.INTERRUPTED if monitor.interrupted else Status.LIMIT
        message = f"{done} of {problem.runs} runs before the {'interrupt' if monitor.interrupted else 'time limit'}"
    member = np.zeros((len(tried.groups), len(names)))
    for g, group in enumerate(tried.groups):
        member[g, group] = 1.0
    frequency = np.stack([np.mean(outcomes.choices == g, axis=0) for g in range(len(member))], axis=1)
    labels = ["+".join(names[j] for j in group) for group in tried.groups]
    share = frequency.mean(axis=0)
    schedule = Schedule(np.arange(problem.steps + 1.0), member[first.choices[0]], tuple(names))
    result: dict[str, Any] = {
        **summarise_runs(outcomes),
        "use": {name: float(value) for name, value in zip(names, share @ member, strict=True)},
        "group_use": {label: float(value) for label, value in zip(labels, share, strict=True)},
        "runs": done,
        "states": problem.plant.states,
        "first_scores": first_scores(problem, tried),
        "schedule": schedule.segments(),
    }
    if isinstance(method, Fixed):
        result["sensor"] = labels[0]
    if problem.plant.guards is not None:
        result |= {"guard_excess": outcomes.excess, "guard_error": outcomes.error}
    if problem.plant.guards is not None and outcomes.excess > 1e-6:
        message += f"; guard probabilities that did not sum to 1 (by {outcomes.excess:.2g}) were divided by their sum"
    return Solution(
        family="hybrid",
        method=method.name,
        status=status,
        message=message,
        iterations=done,
        seconds=seconds,
        result=result,
        arrays=_arrays(problem, outcomes, first, schedule, frequency @ member),
        schedule=schedule,
        history=last_report(monitor),
        problem=problem,
    )


def _arrays(
    problem: Problem, outcomes: Outcomes, first: Runs, schedule: Schedule, use: np.ndarray
) -> dict[str, np.ndarray]:
    """RMS over time, shares over time, and the first run with k = 0 in front."""
    from occontrol.families.hybrid.statistics import rms

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
    if outcomes.squared.size <= KEPT:
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
    from occontrol.families.hybrid.imm import start
    from occontrol.families.hybrid.imm_kernel import predict_step, score_groups

    model, _ = tried.models()
    means, covariances, log_predicted, _, _ = predict_step(model, 1, *start(problem.plant))
    weights = float(tried.chooser.bound_weight), float(tried.chooser.position_weight)
    scores = score_groups(model, 1, means, covariances, log_predicted, *weights)
    labels = ["+".join(problem.sensors.names[j] for j in group) for group in tried.groups]
    return {label: float(score) for label, score in zip(labels, scores, strict=True)}
