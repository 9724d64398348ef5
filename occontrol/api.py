"""The calls of the library that work for every family: each finds the family by the problem and hands over."""

from __future__ import annotations

import dataclasses
import difflib
import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from occontrol.core.errors import InfeasibleError, UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution, Status
from occontrol.families import FAMILIES, family_module

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.schedule import Schedule
    from occontrol.families.athans.certificate import Claims


def suggest(name: str, known: Iterable[str]) -> str:
    """A hint for the misspelt `name`: the closest of the `known` names, or all of them."""
    known = list(known)
    close = difflib.get_close_matches(name, known, n=1)
    return f"did you mean '{close[0]}'?" if close else "there are: " + ", ".join(known)


def choose_method(problem: Any, name: str) -> Any:
    """The options object of the method `name` for `problem`.

    Options that the problem states for its own method and that the named one has too, such as relative_gap, are kept.

    Parameters
    ----------
    problem : the problem of any family
    name : one of the family's METHODS

    Raises UsageError for an unknown name.
    """
    module = family_module(problem.family)
    methods = module.METHODS
    # some families have names that carry an argument, such as fixed:radar
    special = module.method_named(problem, name) if hasattr(module, "method_named") else None
    if special is not None:
        return special
    if name not in methods:
        raise UsageError(f"family {problem.family} has no method '{name}'\n  hint: {suggest(name, methods)}")
    own = getattr(problem, "method", None)
    if own is None or isinstance(own, methods[name]):
        return methods[name]() if own is None else own
    known = {f.name for f in dataclasses.fields(methods[name]) if f.init}
    stated = {f.name: getattr(own, f.name) for f in dataclasses.fields(own) if getattr(own, f.name) != f.default}
    return methods[name](**{option: value for option, value in stated.items() if option in known})


def ability(problem: Any, name: str, what: str) -> Any:
    """The function `name` of the problem's family.

    Parameters
    ----------
    problem : the problem of any family
    name : such as "certify"
    what : the same in words, for the message

    Raises UsageError, naming the families that can, when this one cannot.
    """
    function = getattr(family_module(problem.family), name, None)
    if function is None:
        able = [f for f in FAMILIES if _offers(f, name)]
        hint = f"\n  hint: these can: {', '.join(able)}" if able else ""
        raise UsageError(f"family {problem.family} cannot {what}{hint}")
    return function


def _require_schedule(solution: Solution | None) -> None:
    """InfeasibleError, with the solver's reason, when the solution says that there is no schedule to follow."""
    if solution is not None and solution.status is Status.INFEASIBLE:
        raise InfeasibleError(solution.message or solution.status.text)


def _offers(family: str, name: str) -> bool:
    try:
        return hasattr(family_module(family), name)
    except ModuleNotFoundError:
        return False


def solve(problem: Any, method: Any = None, monitor: Monitor | None = None) -> Solution:
    """Solve a problem of any family.

    Parameters
    ----------
    problem : from `read_problem`, or built in Python
    method : an options object such as `HMinimal()`, the name of a method, or None for the problem's own
    monitor : Monitor to watch and stop the work, optional

    Returns a Solution: schedule, certificate, covariance. Raises InfeasibleError when no schedule exists, UsageError
    for an unknown method, SolveFailed when a solver ends with nothing usable.
    """
    if isinstance(method, str):
        method = choose_method(problem, method)
    solution = family_module(problem.family).solve(problem, method, monitor)
    return dataclasses.replace(solution, problem=problem)


def read_run(folder: str | Path) -> tuple[Any, Solution]:
    """The problem and the Solution of the run folder `folder`, identical to what was written.

    Parameters
    ----------
    folder : as `write_run` or the command line wrote it

    Raises ProblemError naming the file that is missing, damaged, or does not belong to the others; FileAccessError when
    there is no such folder or it cannot be read.
    """
    from occontrol.files import run_folder
    from occontrol.files.problem_file import read_problem

    return run_folder.read_run(folder, read_problem)


def write_run(
    folder: str | Path, problem: Any, solution: Solution, extras: Callable[[Path, dict], None] | None = None
) -> dict[str, Any]:
    """Write a run folder and return the content of its result.json.

    Parameters
    ----------
    folder : the run folder, created if missing; an earlier result in it is replaced only when the new one is complete
    problem : the problem that was solved
    solution : Solution
    extras : called with the folder under construction and the content of result.json, to add pictures and the like

    Raises FileAccessError when the folder cannot be written, or is in use by another process.
    """
    from occontrol.files import run_folder
    from occontrol.files.problem_file import document

    return run_folder.write_run(folder, document(problem), solution, extras)


def certify(problem: Any, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of a schedule that anybody wrote, all recomputed.

    Parameters
    ----------
    problem : a problem whose family proves bounds
    schedule : Schedule, for example from `read_schedule`
    claims : the cost and bound that somebody states for it; a wrong one makes the status `disagrees`

    Raises UsageError for families without bounds.
    """
    judge = ability(problem, "certify", "certify schedules")
    return judge(problem, schedule) if claims is None else judge(problem, schedule, claims)


def simulate(problem: Any, solution: Solution | None, seed: int = 0) -> tuple[list[Measurement], Any]:
    """A true trajectory and what the scheduled sensors would report of it.

    Parameters
    ----------
    problem : the problem
    solution : Solution whose schedule is followed
    seed : of the random generator; the same seed gives the same data

    Returns (measurements, truth). Raises UsageError for families that cannot, InfeasibleError without a schedule.
    """
    function = ability(problem, "simulate", "simulate measurements")
    _require_schedule(solution)
    return function(problem, solution, seed)


def run_filter(problem: Any, solution: Solution, measurements: Sequence[Measurement], **options: Any) -> Estimate:
    """The estimate that the schedule's filter makes of measurements.

    Parameters
    ----------
    problem : the problem
    solution : Solution whose schedule and gains are used
    measurements : list of Measurement
    options : of the family's filter, such as model="exact" (athans, for coarse grids)

    Raises UsageError for families without such a filter or option, ProblemError when the measurements do not fit.
    """
    function = ability(problem, "run_filter", "filter a measurement file")
    _require_schedule(solution)
    known = inspect.signature(function).parameters
    for name in options:
        if name not in known:
            raise UsageError(f"the filter of family {problem.family} has no option '{name}'")
    return function(problem, solution, measurements, **options)


def tradeoff(problem: Any, cost_weights: Sequence[float], monitor: Monitor | None = None) -> Any:
    """The front of observation cost against prediction error over the cost weight alpha.

    Parameters
    ----------
    problem : a problem whose family proves bounds (athans)
    cost_weights : values of alpha
    monitor : Monitor to watch and stop the work, optional

    Returns a Front. Raises UsageError for families without such a trade-off.
    """
    what = "trade observation cost against prediction error"
    return ability(problem, "tradeoff", what)(problem, cost_weights, monitor)


def plot(solution: Solution, problem: Any = None, figure: str | None = None) -> dict[str, Figure] | Figure:
    """Pictures of a solution, as matplotlib Figures.

    Parameters
    ----------
    solution : Solution
    problem : the problem, where the solution does not carry it
    figure : the name of one figure, for example "overview"; all of them, by name, if left out

    Raises UsageError when there is no such figure.
    """
    from occontrol.files.figures import figures_of

    problem = problem if problem is not None else solution.problem
    if problem is None:
        raise UsageError("the solution does not carry its problem\n  hint: occontrol.plot(solution, problem)")
    drawn = figures_of(problem, solution)
    if figure is None:
        return drawn
    if figure not in drawn:
        raise UsageError(f"there is no figure '{figure}'\n  hint: {suggest(figure, drawn)}")
    return drawn[figure]
