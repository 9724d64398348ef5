"""On-line selection along the worst eigendirection (Oshman 1994), with baselines, look-ahead and the exact optimum."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from occontrol.core.errors import SolveFailed, UsageError
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution, Status
from occontrol.core.trajectory import Trajectory
from occontrol.families.vlambda.methods import Eigenspace, Fixed, Lookahead, Optimal, Random, RoundRobin, Trace
from occontrol.families.vlambda.optimal import certify, claims_of, optimal
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.result import cost_of, finish, recorded
from occontrol.families.vlambda.selection import Selection, run_selection
from occontrol.families.vlambda.sensor_choice import FixedChooser, subsets
from occontrol.families.vlambda.text import describe, summarise

if TYPE_CHECKING:
    from occontrol.families.vlambda.online import OnlineSelector

__all__ = [
    "COLUMNS",
    "COMPARE",
    "METHODS",
    "Problem",
    "certify",
    "claims_of",
    "compare_names",
    "describe",
    "method_named",
    "online",
    "run_filter",
    "simulate",
    "solve",
    "summarise",
]

METHODS: dict[str, type] = {m.name: m for m in (Eigenspace, Fixed, RoundRobin, Random, Trace, Lookahead, Optimal)}
COLUMNS = ("sum_largest_eigenvalue", "sum_trace", "peak_largest_eigenvalue")


COMPARE = ["eigenspace", "fixed", "round-robin", "random", "trace", "lookahead", "optimal"]


def compare_names(problem: Problem) -> list[str]:
    """COMPARE with every fixed choice by itself, where there are few: "fixed:one", "fixed:two", .."""
    groups = subsets(len(problem.sensors), problem.select, 12)
    if groups is None:
        return COMPARE
    names = problem.sensors.names
    fixed = ["fixed:" + "+".join(names[j] for j in group) for group in groups]
    return [COMPARE[0], *fixed, *COMPARE[2:]]


def method_named(problem: Problem, name: str) -> Any:
    """The options of a method that carries its argument, "fixed:one+two" or "lookahead:3"; None for any other name."""
    head, colon, argument = name.partition(":")
    method: Any = None
    if colon and head == "fixed":
        method = Fixed(argument if argument in problem.sensors.names else argument.split("+"))
    elif colon and head == "lookahead" and argument.isdecimal():
        method = Lookahead(depth=int(argument))
    if method is not None:
        mistakes = list(method.check(problem))
        if mistakes:
            raise UsageError(f"method {name}: {mistakes[0].what}\n  hint: {mistakes[0].hint}")
    return method


def solve(problem: Problem, method: Any = None, monitor: Monitor | None = None) -> Solution:
    """Select sensors over the horizon with one method and evaluate what the filter makes of it.

    Parameters
    ----------
    problem : Problem
    method : a METHODS value; the problem's own, or Eigenspace(), if left out
    monitor : Monitor

    Returns Solution. Raises InfeasibleError when a movable sensor has nowhere to be, SolveFailed when a search would
    be too large.
    """
    watch = Monitor() if monitor is None else monitor
    method = method or problem.method or Eigenspace()
    before = len(watch.history)
    began = time.perf_counter()
    if isinstance(method, Optimal):
        return finish(problem, method.name, began, watch, before, *optimal(problem, method, watch))
    if isinstance(method, Fixed) and method.sensor is None:
        selection, message = _best_fixed(problem, watch)
    else:
        selection = run_selection(problem.sampled, problem.starts, problem.select, method.chooser(problem), watch)
        message = (
            "selected on-line; a rule proves no bound"
            if method.name not in ("fixed", "random", "round-robin")
            else "a baseline"
        )
    status = Status.FEASIBLE
    if selection.held_from is not None:
        status, message = Status.INTERRUPTED, f"interrupted; from k = {selection.held_from} on the last choice is kept"
    return finish(problem, method.name, began, watch, before, selection, status, message, {})


def _best_fixed(problem: Problem, watch: Monitor) -> tuple[Selection, str]:
    """Every group of `select` sensors all the time; the one with the smallest cost."""
    groups = subsets(len(problem.sensors), problem.select)
    if groups is None:
        raise SolveFailed(
            "there are too many groups of sensors to try them all\n  hint: fixed needs sensor: [name, ..] here"
        )
    found: list[tuple[Selection, str]] = []
    for group in groups:
        selection = run_selection(problem.sampled, problem.starts, problem.select, FixedChooser(group), watch)
        names = ", ".join(problem.sensors.names[j] for j in group)
        if not found or cost_of(problem, selection) < cost_of(problem, found[0][0]) * (1 - 1e-12):
            found = [(selection, f"the best of all fixed choices: {names}")]
        if watch.stop:
            break
    return found[0]


def online(problem: Problem, method: Any = None) -> OnlineSelector:
    """The loop of a target: `step(measurements)` gives the estimate and which sensors to use next.

    Parameters
    ----------
    problem : Problem
    method : a METHODS value or a name such as "eigenspace" or "fixed:one"; the problem's own if left out

    >>> loop = online(problem)                       # doctest: +SKIP
    >>> done = loop.step({"one": [0.3, 0.1]})        # doctest: +SKIP
    >>> done.estimate, done.next_sensors                 # doctest: +SKIP
    """
    from occontrol.families.vlambda.online import OnlineSelector

    if isinstance(method, str):
        name = method
        method = method_named(problem, name) or (METHODS[name]() if name in METHODS else None)
        if method is None:
            raise UsageError(f"family vlambda has no method '{name}'\n  hint: there are: {', '.join(METHODS)}")
    method = method or problem.method or Eigenspace()
    searched = isinstance(method, Optimal) or (isinstance(method, Fixed) and method.sensor is None)
    chooser = recorded(problem, solve(problem, method)) if searched else method.chooser(problem)
    return OnlineSelector(problem.sampled, problem.starts, problem.select, chooser)


def simulate(problem: Problem, solution: Solution | None, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """A true trajectory x(0) .. x(K-1) and what the selected sensors report of it, one Measurement per sensor and step.

    Parameters
    ----------
    problem : Problem
    solution : Solution whose choices are followed; solved with the problem's own method if None
    seed : of the generator
    """
    from occontrol.families.vlambda.data import simulate_selection

    chosen = solution or solve(problem)
    return simulate_selection(problem.sampled, problem.starts, problem.select, recorded(problem, chosen), seed)


def run_filter(problem: Problem, solution: Solution, measurements: Sequence[Measurement]) -> Estimate:
    """The V-Lambda filter over a measurement file, with the solution's choices.

    Parameters
    ----------
    problem, solution : of the run
    measurements : list of Measurement, t = k

    Raises ProblemError for a sensor that does not exist, a t that is no step, or the wrong number of values.
    """
    from occontrol.families.vlambda.data import filter_measurements

    return filter_measurements(
        problem.sampled, problem.starts, problem.select, recorded(problem, solution), measurements
    )
