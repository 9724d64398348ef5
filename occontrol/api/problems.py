"""The calls on a problem of any family: each finds the family, refuses what is foreign to it, and hands over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from occontrol.api.documents import problem_of
from occontrol.core.claims import Claims
from occontrol.core.conversion import Asked
from occontrol.core.errors import InfeasibleError, ProblemError, UsageError, suggest
from occontrol.core.kinds import PlainDict
from occontrol.core.measurement import OnlineLoop
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.problem import BaseProblem
from occontrol.core.result import ResultData
from occontrol.core.solution import Solution, Status, Tradeoff
from occontrol.core.trajectory import Trajectory
from occontrol.families import find_family, names
from occontrol.families.family import NOTHING, Ability, Family

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.schedule import Schedule

HUB = "athans"  # the family that others are converted by way of


def family_of(problem: BaseProblem) -> Family:
    """The family of a problem; UsageError for what is no problem of any family."""
    name = getattr(problem, "family", None)
    family = find_family(name) if name in names() else None
    if family is None or not isinstance(problem, family.problem_type):
        what = f"{type(problem).__name__} is not a problem of any family"
        raise UsageError(f"{what}\n  hint: read_problem(FILE), or SchedulingProblem(..)")
    return family


def require(problem: BaseProblem, ability: Ability) -> Family:
    """The family of `problem`; UsageError, naming the families that can, when it does not declare `ability`."""
    family = family_of(problem)
    if not family.can(ability):
        able = [name for name in names() if find_family(name).can(ability)]
        hint = f"\n  hint: these can: {', '.join(able)}" if able else ""
        raise UsageError(f"family {family.name} cannot {ability}{hint}")
    return family


def choose_method(problem: BaseProblem, method: Method | str | None = None) -> Method:
    """The method object that `solve` would run.

    Parameters
    ----------
    problem : the problem of any family
    method : an object or a name of one of the family's methods, or None for the problem's own or the family's default

    Options that the problem states for its own method and that a named one has too, such as relative_gap, are kept.
    Raises UsageError for a method that is not one of the family's, ProblemError where its options do not fit.
    """
    family = family_of(problem)
    chosen = family.choose(problem, method)
    if mistakes := family.mistakes(problem, chosen):
        raise ProblemError(mistakes)
    return chosen


def solve(problem: BaseProblem, method: Method | str | None = None, monitor: Monitor | None = None) -> Solution:
    """Solve a problem of any family.

    Parameters
    ----------
    problem : from `read_problem`, or built in Python
    method : an options object such as `HMinimal()`, the name of a method, or None for the problem's own
    monitor : Monitor to watch and stop the work, optional

    Returns a Solution: schedule, certificate, covariance. Raises UsageError for a method that is not one of the
    family's and ProblemError for options that do not fit, both before any work; InfeasibleError when no schedule
    exists, SolveFailed when a solver ends with nothing usable.
    """
    chosen = choose_method(problem, method)
    solution = family_of(problem).solve(problem, chosen, _own_monitor(monitor, chosen))
    return solution  # it carries its problem, to which a family may have added edges


def _own_monitor(monitor: Monitor | None, method: Method | str | None) -> Monitor:
    """A monitor for this method alone: what it sets does not reach the caller's."""
    return (Monitor() if monitor is None else monitor).child(getattr(method, "time_limit", None))


def certify(problem: BaseProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of a schedule that anybody wrote, all recomputed.

    Parameters
    ----------
    problem : a problem whose family proves bounds
    schedule : Schedule, for example from `read_schedule`
    claims : the cost and bound that somebody states for it; a wrong one makes the status `disagrees`

    Raises UsageError for families without bounds.
    """
    family = require(problem, Ability.CERTIFY)
    return family.certify(problem, schedule, claims)  # it carries its problem, on edges where the schedule switches


def simulate(problem: BaseProblem, solution: Solution | None, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """A true trajectory and what the scheduled sensors would report of it.

    Parameters
    ----------
    problem : the problem
    solution : Solution whose schedule is followed
    seed : of the random generator; the same seed gives the same data

    Returns (measurements, truth). Raises UsageError for families that cannot, InfeasibleError without a schedule.
    """
    family = require(problem, Ability.SIMULATE)
    _require_schedule(solution)
    return family.simulate(problem, solution, seed)


def run_filter(
    problem: BaseProblem, solution: Solution, measurements: Sequence[Measurement], **options: object
) -> Estimate:
    """The estimate that the schedule's filter makes of measurements.

    Parameters
    ----------
    problem : the problem
    solution : Solution whose schedule and gains are used
    measurements : list of Measurement
    options : of the family's filter, such as model="exact" (athans, for coarse grids)

    Raises UsageError for families without such a filter or option, ProblemError when the measurements do not fit.
    """
    family = require(problem, Ability.FILTER)
    _require_schedule(solution)
    for name in options:
        if name not in family.filter_options:
            hint = f"\n  hint: {suggest(name, family.filter_options)}" if family.filter_options else ""
            raise UsageError(f"the filter of family {family.name} has no option '{name}'{hint}")
    return family.run_filter(problem, solution, measurements, **options)


def online(problem: BaseProblem, solution: Solution | None = None, method: Method | str | None = None) -> OnlineLoop:
    """The object for a loop on a target: `step(measurements)` gives the estimate and what to measure next.

    Parameters
    ----------
    problem : the problem
    solution : Solution whose schedule is followed, where the family plans ahead (athans)
    method : what chooses the sensors, where the family chooses in the loop (vlambda)

    Raises UsageError for families that cannot, InfeasibleError without a schedule.
    """
    family = require(problem, Ability.ONLINE)
    _require_schedule(solution)
    return family.online(problem, solution, None if method is None else choose_method(problem, method))


def converted(problem: BaseProblem, family: str, asked: Asked = NOTHING) -> tuple[PlainDict, list[str]]:
    """A problem as a document of another family; by way of athans where the two have no direct one.

    Parameters
    ----------
    problem : the problem
    family : name of the other family
    asked : Asked, what the other family needs and this one does not hold

    Returns the document, and sentences on what is left behind. Raises UsageError where the mathematics has no way.
    """
    own = family_of(problem)
    if family == own.name:
        raise UsageError(f"the problem is of family {family} already")
    if family not in names():
        raise UsageError(f"there is no family '{family}'\n  hint: {suggest(family, names())}")
    try:
        return own.converted(problem, family, asked)
    except UsageError:
        if HUB in (own.name, family) or type(own).converted is Family.converted:
            raise
    between, left = own.converted(problem, HUB, asked)
    found, more = find_family(HUB).converted(problem_of(between), family, asked)
    return found, [*left, *more]


def tradeoff(
    problem: BaseProblem,
    cost_weights: Sequence[float] = (),
    monitor: Monitor | None = None,
    budgets: Sequence[float] | None = None,
) -> Tradeoff:
    """The front of observation cost against prediction error, over the cost weight alpha or over caps on the former.

    Parameters
    ----------
    problem : a problem whose family proves bounds (athans)
    cost_weights : values of alpha; they play no part where there are budgets
    monitor : Monitor to watch and stop the work, optional
    budgets : caps on the observation cost, for each of which the error is minimised

    Returns a Front or a BudgetFront. Raises UsageError for families without such a trade-off, InfeasibleError where no
    schedule keeps any cap.
    """
    family = require(problem, Ability.TRADEOFF)
    if budgets is not None:
        return family.budgets(problem, budgets, monitor or Monitor())
    return family.tradeoff(problem, cost_weights, monitor or Monitor())


def sensitivity(
    problem: BaseProblem, solution: Solution | None = None, monitor: Monitor | None = None, change: float | None = None
) -> ResultData:
    """What the optimal cost would change by if a price, a noise, a window or the number of places changed.

    Parameters
    ----------
    problem : the problem of a solution, `solution.problem`
    solution : of it, whose relaxed policy is the start; optional
    monitor : Monitor to watch and stop the work, optional
    change : share, for example 0.1, by which every price and noise goes down and up and is solved again, so that the
        change of the optimum lies between proven bounds; None: nothing is solved again

    Raises UsageError for families that cannot say it.
    """
    family = require(problem, Ability.SENSITIVITY)
    return family.sensitivity(problem, solution, monitor or Monitor(), change)


def _require_schedule(solution: Solution | None) -> None:
    """InfeasibleError, with the solver's reason, when the solution says that there is no schedule to follow."""
    if solution is not None and solution.status is Status.INFEASIBLE:
        raise InfeasibleError(solution.message or solution.status.text)


def figures_of(problem: BaseProblem, solution: Solution) -> dict[str, Figure]:
    """Every figure of `solution` to `problem` by name, the most telling first."""
    return family_of(problem).figures(problem, solution)


def compare_figure(problem: BaseProblem, solutions: Mapping[str, Solution]) -> Figure | None:
    """One figure of several `solutions`, by method name, to the same `problem`; None where the family has none."""
    return family_of(problem).compare_figure(problem, solutions)


def estimate_figures(
    problem: BaseProblem, solution: Solution, estimate: Estimate, truth: Trajectory | None = None
) -> dict[str, Figure]:
    """The figures of an `estimate` along a solution by name; beside the `truth` where it is known."""
    return family_of(problem).estimate_figures(problem, solution, estimate, truth)


def plot(
    solution: Solution, problem: BaseProblem | None = None, figure: str | None = None
) -> dict[str, Figure] | Figure:
    """Pictures of a solution, as matplotlib Figures.

    Parameters
    ----------
    solution : Solution
    problem : the problem, where the solution does not carry it
    figure : the name of one figure, for example "overview"; all of them, by name, if left out

    Raises UsageError when there is no such figure.
    """
    problem = problem if solution.problem is None else solution.problem  # on which edges may have been added
    if problem is None:
        raise UsageError("the solution does not carry its problem\n  hint: occontrol.plot(solution, problem)")
    drawn = figures_of(problem, solution)
    if figure is None:
        return drawn
    if figure not in drawn:
        raise UsageError(f"there is no figure '{figure}'\n  hint: {suggest(figure, drawn)}")
    return drawn[figure]
