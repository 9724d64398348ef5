"""Problems of continuous sensing: the half of the family whose noise is an intensity and whose cost is a rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from occontrol.core import stopwatch
from occontrol.core.conversion import Asked
from occontrol.core.errors import Mistake, SolveFailed, UsageError
from occontrol.core.kinds import PlainDict
from occontrol.core.method import Method
from occontrol.core.result import ResultData
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.methods import METHODS, RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import AthansResult
from occontrol.families.family import NOTHING, Ability, Family

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

    from matplotlib.figure import Figure

    from occontrol.core.claims import Claims
    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.monitor import Monitor
    from occontrol.core.target import TargetPlan
    from occontrol.core.trajectory import Trajectory
    from occontrol.families.athans.budgets import BudgetFront
    from occontrol.families.athans.filter.online import MatchedFilter
    from occontrol.families.athans.tradeoff import Front
    from occontrol.files.page import Group


class RateFamily(Family):
    """Continuous sensing: which sensor when, the schedule constant on intervals."""

    name: ClassVar[str] = "athans"
    title: ClassVar[str] = "off-line schedules in continuous time with a certificate (Athans 1971)"
    methods: ClassVar[Mapping[str, type]] = METHODS
    compared: ClassVar[Sequence[str]] = (
        "schedule", "relaxed", "hminimal", "greedy", "best-single", "round-robin", "random",
    )  # fmt: skip
    abilities: ClassVar[frozenset[Ability]] = frozenset(Ability) - {Ability.MONTE_CARLO}
    filter_options: ClassVar[Sequence[str]] = ("model", "gate")
    problem_type: ClassVar[type] = AthansProblem
    result_type: ClassVar[type] = AthansResult

    def solve(self, problem: SchedulingProblem, method: Method, monitor: Monitor) -> Solution:
        """Run `method` on the problem's recursion and certify what it found.

        The status is certified, feasible, limit, interrupted or disagrees. Raises InfeasibleError when some interval
        cannot be filled, SolveFailed when nothing usable was found.
        """
        from occontrol.families.athans.assembly import assemble
        from occontrol.families.athans.balanced import balanced, restored
        from occontrol.families.athans.discretise import feasible_set
        from occontrol.families.athans.integration.refine import search_space
        from occontrol.families.athans.whole_dense import with_whole_looks

        if not problem.prior:
            from occontrol.families.athans.criteria.rate_design import solve_rate_design

            return solve_rate_design(problem, method, monitor)
        if problem.measured:
            if problem.ruled:
                from occontrol.families.athans.criteria.ruled_rate import solve_ruled_rate

                return solve_ruled_rate(problem, method, monitor)
            from occontrol.families.athans.criteria.rate import solve_rate

            return solve_rate(problem, method, monitor)
        if problem.ruled or getattr(method, "exact_options", None) is not None or getattr(method, "off_grid", False):
            from occontrol.families.athans.rules.solve import solve_ruled

            return solve_ruled(problem, method, monitor)
        problem.require_feasible()
        began = stopwatch.seconds()
        inner, units = balanced(problem)
        integrator, sweep = search_space(inner, method, monitor)
        inner = integrator.problem  # edges may have been added
        found = method.run(inner, sweep, feasible_set(inner), monitor)
        if isinstance(method, RelaxRoundPolish) and method.polish:
            with_whole_looks(found, sweep, feasible_set(inner), monitor)
        return restored(assemble(inner, method.name, integrator, sweep, found, monitor, began), problem, units)

    def require_feasible(self, problem: SchedulingProblem) -> None:
        """Raise InfeasibleError, with the time, when some interval has too few available sensors."""
        problem.require_feasible()

    def warnings(self, problem: SchedulingProblem) -> list[Mistake]:
        """Lost modes, useless windows and sensors, size."""
        from occontrol.families.athans.warnings import warnings_of

        return warnings_of(problem)

    def describe(self, problem: SchedulingProblem) -> list[tuple[str, str]]:
        """Sizes, costs, observability, an estimate of work."""
        from occontrol.families.athans.text import describe

        return describe(problem)

    def summarise(self, problem: SchedulingProblem, solution: Solution) -> list[tuple[str, str]]:
        """Cost, bound, the same in continuous time, the parts of the cost, switches."""
        from occontrol.families.athans.text import summarise

        return summarise(solution)

    def schema(self) -> ModuleType:
        """Problem files of this family."""
        from occontrol.families.athans import schema

        return schema

    def figures(self, problem: SchedulingProblem, solution: Solution) -> dict[str, Figure]:
        """overview, and the panels of it by themselves."""
        from occontrol.families.athans.criteria.figures_rate import draw_rate_design
        from occontrol.families.athans.figures import draw

        return draw(problem, solution) if problem.prior else draw_rate_design(problem, solution)

    def groups(self, problem: SchedulingProblem, solution: Solution) -> list[Group]:
        """The panels of the page of a schedule."""
        from occontrol.families.athans.page import rate_groups

        return rate_groups(problem, solution)

    def compare_figure(self, problem: SchedulingProblem, solutions: Mapping[str, Solution]) -> Figure | None:
        """Schedules, costs and bounds of several methods below each other."""
        from occontrol.families.athans.figures_compare import draw_compare

        return draw_compare(problem, solutions)

    def certify(self, problem: SchedulingProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
        """Cost, lower bound and gap of anybody's schedule; refuted claims make the status `disagrees`."""
        from occontrol.families.athans.certify import certify

        return certify(problem, schedule, claims)

    def claims_of(self, problem: SchedulingProblem, solution: Solution) -> Claims:
        """Everything that a run says of its schedule."""
        from occontrol.families.athans.certify import claims_of

        return claims_of(solution)

    def simulate(
        self, problem: SchedulingProblem, solution: Solution | None, seed: int
    ) -> tuple[list[Measurement], Trajectory]:
        """A true trajectory of the continuous plant and what the scheduled sensors report of it."""
        from occontrol.families.athans.filter.simulate import simulate

        refuse(problem, "simulate")
        return simulate(problem, schedule_of(solution), seed)

    def run_filter(
        self,
        problem: SchedulingProblem,
        solution: Solution,
        measurements: Sequence[Measurement],
        model: str | None = None,
        gate: float | None = None,
    ) -> Estimate:
        """The matched filter; `model` is "split" or "exact", None the one that belongs to the schedule.

        `gate` is a probability, for example 0.9999: samples farther off than that are left out.
        """
        from occontrol.families.athans.filter.kalman_bucy import run_filter
        from occontrol.families.athans.filter.planned import default_model

        refuse(problem, "the filter of continuous sensing")
        return run_filter(problem, schedule_of(solution), measurements, model or default_model(solution.result), gate)

    def online(
        self, problem: SchedulingProblem, solution: Solution | None = None, method: Method | None = None
    ) -> MatchedFilter:
        """The matched filter for a loop on a target, along the solution's schedule.

        Raises UsageError without a solution.
        """
        from occontrol.families.athans.filter.online import MatchedFilter

        if solution is None:
            what = "the on-line filter of family athans follows the schedule of a solution"
            raise UsageError(f"{what}\n  hint: online(problem, solve(problem))")
        refuse(problem, "the on-line filter")
        return MatchedFilter(problem, schedule_of(solution))

    def filter_loop(
        self, problem: SchedulingProblem, solution: Solution, model: str | None = None, gate: float | None = None
    ) -> MatchedFilter:
        """The filter of `run_filter` step by step, with the same options."""
        from occontrol.families.athans.filter.online import MatchedFilter
        from occontrol.families.athans.filter.planned import default_model

        refuse(problem, "the filter step by step")
        return MatchedFilter(problem, schedule_of(solution), model or default_model(solution.result), gate=gate)

    def filter_tables(self, problem: SchedulingProblem, solution: Solution) -> PlainDict:
        """The matched filter as plain arrays, see filter/tables.py."""
        from occontrol.families.athans.filter.planned import default_model
        from occontrol.families.athans.filter.tables import filter_tables

        if solution.schedule is None or not problem.prior:
            return {}
        return filter_tables(problem, schedule_of(solution), default_model(solution.result))

    def target_plan(self, problem: SchedulingProblem, solution: Solution) -> TargetPlan:
        """The `solution`'s schedule of a `problem` and its filter, for code on a target, see filter/target.py."""
        from occontrol.families.athans.filter.planned import default_model
        from occontrol.families.athans.filter.target import target_plan

        refuse(problem, "code on a target")
        return target_plan(problem, schedule_of(solution), default_model(solution.result))

    def tradeoff(self, problem: SchedulingProblem, cost_weights: Sequence[float], monitor: Monitor) -> Front:
        """Observation cost against prediction error over the cost weight alpha; UsageError for rules."""
        from occontrol.families.athans.tradeoff import tradeoff

        refuse(problem, "tradeoff")
        if problem.criterion is not None and problem.measured:
            what = f"tradeoff does not do the criterion {problem.criterion.name}"
            raise UsageError(f"{what}\n  hint: solve with several values of objective.cost_weight")
        if problem.ruled:
            what = "tradeoff does not do rules on schedules"
            raise UsageError(f"{what}\n  hint: tradeoff --budget FROM:TO:COUNT")
        return tradeoff(problem, cost_weights, monitor)

    def write_tradeoff(self, folder: Path, front: Front | BudgetFront, figures: bool = True) -> list[Path]:
        """tradeoff.json, front.csv, arrays.npz and pictures."""
        from occontrol.families.athans.budgets import BudgetFront, write_budgets

        if isinstance(front, BudgetFront):
            return write_budgets(folder, front, figures)
        from occontrol.families.athans.front_folder import write_front

        return write_front(folder, front, figures)

    def converted(self, problem: AthansProblem, family: str, asked: Asked = NOTHING) -> tuple[PlainDict, list[str]]:
        """A `problem` of continuous sensing as a document of `family` vlambda or robust, with what is `asked` of the
        user; UsageError for others."""
        from occontrol.families.athans.convert import as_selection, as_uncertain

        ways = {"vlambda": as_selection, "robust": as_uncertain}
        if family not in ways or not isinstance(problem, SchedulingProblem):
            return super().converted(problem, family, asked)
        refuse(problem, "conversion")
        return ways[family](problem, asked)

    def sensitivity(
        self, problem: SchedulingProblem, solution: Solution | None, monitor: Monitor, change: float | None = None
    ) -> ResultData:
        """Derivatives of the relaxed optimum; UsageError for rules."""
        from occontrol.families.athans.sensitivity import sensitivity

        return sensitivity(problem, solution, monitor, change)

    def sensitivity_figure(self, found: ResultData) -> Figure:
        """What prices and noises of the sensors are worth."""
        from occontrol.families.athans.figures_sensitivity import draw
        from occontrol.families.athans.sensitivity import Sensitivities

        return draw(Sensitivities.from_dict(found.as_dict()))


def refuse(problem: AthansProblem, what: str) -> None:
    """UsageError for what needs an initial covariance.

    Parameters
    ----------
    problem : of the family
    what : the name of that
    """
    if not problem.prior:
        raise UsageError(f"{what} needs an initial covariance, and this problem has none")


def schedule_of(solution: Solution | None) -> Schedule:
    """The schedule of a solution as far as it measures; SolveFailed where there is none."""
    if solution is None or solution.schedule is None:
        raise SolveFailed("the solution has no schedule to follow")
    schedule, measuring = solution.schedule, solution.arrays.get("measuring")
    # with rules a sensor that is on may still be warming up
    return schedule if measuring is None else Schedule(schedule.edges, measuring, schedule.names)


RATE = RateFamily()
