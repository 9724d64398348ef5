"""Sensors for jumping-mode plants: the family of Liu & Hwang."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution
from occontrol.families.hybrid.data import run_filter, simulate
from occontrol.families.hybrid.methods import Alternate, ExpectedCovariance, Fixed, Random, Scheduled
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.runs import assemble, experiment, last_report

__all__ = [
    "COLUMNS",
    "COMPARE",
    "METHODS",
    "Problem",
    "compare_names",
    "describe",
    "method_named",
    "run_filter",
    "simulate",
    "solve",
    "summarise",
]

METHODS: dict[str, type] = {m.name: m for m in (Scheduled, ExpectedCovariance, Fixed, Alternate, Random)}
COMPARE = ["scheduled", "expected-covariance", "alternate", "random", "fixed"]
COLUMNS = ("average_rms", "peak_rms", "mode_errors", "average_nees")
MOST_FIXED = 3  # groups that `compare` shows one by one


def compare_names(problem: Problem) -> list[str]:
    """COMPARE with every group by itself, where there are few: "fixed:one", "fixed:two", .."""
    groups = problem.groups or ()
    if len(groups) > MOST_FIXED:
        return COMPARE
    return [*COMPARE[:-1], *("fixed:" + "+".join(group) for group in groups)]


def method_named(problem: Problem, name: str) -> Any:
    """The options of a method that carries its argument, "fixed:one+two"; None for any other name."""
    head, colon, argument = name.partition(":")
    if not colon or head != Fixed.name:
        return None
    try:
        problem.group_named(argument)
    except ProblemError as error:
        raise UsageError(f"method {name}: {error.mistakes[0].what}\n  hint: {error.mistakes[0].hint}") from None
    return Fixed(argument)


def solve(problem: Problem, method: Any = None, monitor: Monitor | None = None) -> Solution:
    """Simulate and estimate all runs with one of METHODS as the chooser.

    Parameters
    ----------
    problem : Problem
    method : a METHODS value, or None for the problem's own, or the default
    monitor : Monitor

    Returns a Solution whose status is feasible, limit or interrupted; what it says is about the runs that were done.
    Raises SolveFailed when a state or an estimate leaves the range of the numbers.
    """
    from occontrol.families.hybrid.monte_carlo import monte_carlo

    monitor = monitor or Monitor()
    method = method or problem.method or Scheduled()
    started = time.perf_counter()
    limit = method.time_limit
    if isinstance(method, Fixed) and method.sensor is None and len(problem.groups or ()) > 1:
        return _best_fixed(problem, method, monitor, started)
    if monitor.time_limit is None and limit is not None:
        monitor.time_limit = monitor.seconds + limit
    monitor.stage = monitor.stage or "runs"
    tried = experiment(problem, method)
    outcomes, first = monte_carlo(tried, problem.runs, monitor)
    return assemble(problem, method, tried, outcomes, first, monitor, time.perf_counter() - started)


def _best_fixed(problem: Problem, method: Fixed, monitor: Monitor, started: float) -> Solution:
    """Every group for itself; the one of least average RMS, with the others beside it."""
    solutions = []
    for group in problem.groups or ():
        single = dataclasses.replace(method, sensor="+".join(group))
        solutions.append(solve(problem, single, monitor))
        if monitor.stop:
            break
    best = min(solutions, key=lambda s: s.result["average_rms"])
    keys = ("average_rms", "average_rms_standard_error", "mode_errors", "mode_errors_standard_error")
    candidates = [{"sensor": s.result["sensor"], **{key: s.result[key] for key in keys}} for s in solutions]
    result = {**best.result, "candidates": candidates}
    message = f"{best.result['sensor']} is the best of {len(solutions)} in average RMS; {best.message}"
    seconds = time.perf_counter() - started
    return dataclasses.replace(best, result=result, message=message, seconds=seconds, history=last_report(monitor))


def summarise(problem: Problem, solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    """
    result = solution.result

    def pm(name: str) -> str:
        error = result.get(f"{name}_standard_error")
        known = isinstance(error, int | float) and np.isfinite(error)
        return f"{result[name]:.5g}" + (f" ± {error:.2g}" if known else "")

    share = ", ".join(f"{name} {100 * value:.3g} %" for name, value in result["use"].items())
    lines = [
        ("method", solution.method + (f", {result['sensor']}" if "sensor" in result else "")),
        ("average RMS", f"{pm('average_rms')} (position error, mean over the steps)"),
        ("peak RMS", pm("peak_rms")),
        ("mode errors", f"{pm('mode_errors')} of {problem.steps} steps"),
        ("use", share),
        ("NEES", f"{pm('average_nees')} ({result['states']} where the covariance is honest)"),
        ("seconds", f"{solution.seconds:.2f}"),
    ]
    for other in result.get("candidates", []):
        error = other["average_rms_standard_error"]
        text = f"average RMS {other['average_rms']:.5g}" + (f" ± {error:.2g}" if error == error and error else "")
        lines.append((f"only {other['sensor']}", f"{text}, mode errors {other['mode_errors']:.4g}"))
    return lines


def describe(problem: Problem) -> list[tuple[str, str]]:
    """The lines that `check` prints.

    Parameters
    ----------
    problem : Problem
    """
    plant = problem.plant
    how = "Markov transitions" if plant.guards is None else f"{len(plant.guards)} guards on the state"
    groups = ", ".join("+".join(group) for group in problem.groups or ())
    sensors = ", ".join(f"{s.name} ({s.rows} value{'s' * (s.rows != 1)})" for s in problem.sensors)
    position = ", ".join(f"x{i + 1}" for i in problem.position or ())
    weight = f" + {problem.position_weight:g} × position variance" if problem.position_weight else ""
    method = problem.method or Scheduled()
    return [
        ("plant", f"{plant.states} states, {len(plant.modes)} modes ({', '.join(plant.names)}), {how}"),
        ("sensors", sensors),
        ("groups", f"{groups}; one at a time"),
        ("criterion", f"bound on a wrong mode{weight}"),
        ("position", position),
        ("method", method.name),
        ("simulation", f"{problem.runs} runs of {problem.steps} steps, seed {problem.seed}"),
        ("observability", _observability(problem)),
        ("work", f"{problem.runs * problem.steps} estimator steps of {len(plant.modes)} modes, about {_work(problem)}"),
    ]


def _observability(problem: Problem) -> str:
    """Rank of the observability matrix of every mode with all sensors together, at k = 1."""
    n, low = problem.plant.states, []
    C = np.vstack([sensor.C.at(1.0) for sensor in problem.sensors])
    for mode in problem.plant.modes:
        blocks, A = [C], mode.A.at(1.0)
        for _ in range(n - 1):
            blocks.append(blocks[-1] @ A)
        rank = int(np.linalg.matrix_rank(np.vstack(blocks)))
        if rank < n:
            low.append(f"{mode.name} has rank {rank} of {n}")
    return "every mode is observable with all sensors" if not low else "with all sensors: " + "; ".join(low)


def _work(problem: Problem) -> str:
    """A rough time on one core: the operations of mixing, prediction, scores and update, two nanoseconds each."""
    n, modes, groups = problem.plant.states, len(problem.plant.modes), len(problem.groups or ())
    p = max(sensor.rows for sensor in problem.sensors)
    each = modes * modes * n * n + modes * (4 * n**3 + 4 * n * n * p) + groups * modes * (n * n * p + modes * p**3)
    seconds = 2e-9 * each * problem.runs * problem.steps
    return "a second or less" if seconds < 1 else f"{seconds:.0f} s"
