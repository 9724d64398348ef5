"""What the family athans does with a problem of readings: in discrete time, or samples of a continuous plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from occontrol.core.errors import Mistake, UsageError
from occontrol.core.kinds import PlainDict
from occontrol.core.method import Method
from occontrol.core.result import ResultData
from occontrol.families.athans.rate import RateFamily, refuse, schedule_of
from occontrol.families.athans.readings.problem import ReadingsProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from occontrol.core.claims import Claims
    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.monitor import Monitor
    from occontrol.core.schedule import Schedule
    from occontrol.core.solution import Solution
    from occontrol.core.target import TargetPlan
    from occontrol.core.trajectory import Trajectory
    from occontrol.families.athans.filter.online import MatchedFilter
    from occontrol.families.athans.tradeoff import Front
    from occontrol.files.page import Group


class ReadingsFamily(RateFamily):
    """Which sensors give a reading at every instant."""

    def solve(self, problem: ReadingsProblem, method: Method, monitor: Monitor) -> Solution:
        """Run `method` on the problem's recursion, which is the problem itself, and certify what it found.

        The status is certified, feasible, limit, interrupted or disagrees. Raises UsageError for collocation,
        InfeasibleError when some instant cannot be filled.
        """
        from occontrol.families.athans.readings.solve import solve

        return solve(problem, method, monitor)

    def require_feasible(self, problem: ReadingsProblem) -> None:
        """Raise InfeasibleError, with the time, when too few sensors can be read at some instant."""
        problem.require_feasible()

    def warnings(self, problem: ReadingsProblem) -> list[Mistake]:
        """Windows without a reading, unstable states that nothing sees."""
        from occontrol.families.athans.readings.text import warnings_of

        return warnings_of(problem)

    def describe(self, problem: ReadingsProblem) -> list[tuple[str, str]]:
        """Sizes, costs, deviations of readings, an estimate of work."""
        from occontrol.families.athans.readings.text import describe

        return describe(problem)

    def summarise(self, problem: ReadingsProblem, solution: Solution) -> list[tuple[str, str]]:
        """Cost, bounds, the parts of the cost, readings by sensor."""
        from occontrol.families.athans.readings.text import summarise

        return summarise(problem, solution)

    def figures(self, problem: ReadingsProblem, solution: Solution) -> dict[str, Figure]:
        """overview, and the panels of it by themselves."""
        from occontrol.families.athans.criteria.figures import draw_design
        from occontrol.families.athans.readings.figures import draw

        if not problem.prior:
            return draw_design(problem, solution)
        return draw(problem, solution)

    def groups(self, problem: ReadingsProblem, solution: Solution) -> list[Group]:
        """The panels of the page of a schedule."""
        from occontrol.families.athans.page import readings_groups

        return readings_groups(problem, solution)

    def compare_figure(self, problem: ReadingsProblem, solutions: Mapping[str, Solution]) -> Figure | None:
        """Readings, costs and bounds of several methods below each other."""
        from occontrol.families.athans.figures_compare import draw_compare

        return draw_compare(problem, solutions)

    def certify(self, problem: ReadingsProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
        """Cost, lower bound and gap of anybody's schedule; refuted claims make the status `disagrees`."""
        from occontrol.families.athans.readings.certify import certify

        return certify(problem, schedule, claims)

    def simulate(
        self, problem: ReadingsProblem, solution: Solution | None, seed: int
    ) -> tuple[list[Measurement], Trajectory]:
        """A true trajectory of the plant at the readings, and what the scheduled sensors report of it."""
        from occontrol.families.athans.readings.filter import simulate

        refuse(problem, "simulate")
        return simulate(problem, schedule_of(solution), seed)

    def run_filter(
        self,
        problem: ReadingsProblem,
        solution: Solution,
        measurements: Sequence[Measurement],
        model: str | None = None,
        gate: float | None = None,
    ) -> Estimate:
        """The Kalman filter and predictor along the schedule; `gate` leaves improbable readings out.

        Raises UsageError for a `model` other than exact: readings need no other; without a prior for a gate.
        """
        from occontrol.families.athans.criteria.design_filter import run_information_filter
        from occontrol.families.athans.readings.filter import run_filter

        _require_exact(model)
        if not problem.prior:
            if gate is not None:
                raise UsageError("without a prior there is nothing to gate by\n  hint: leave the gate out")
            return run_information_filter(problem, schedule_of(solution), measurements)
        return run_filter(problem, schedule_of(solution), measurements, gate)

    def online(
        self, problem: ReadingsProblem, solution: Solution | None = None, method: Method | None = None
    ) -> MatchedFilter:
        """The filter for a loop on a target, along the solution's schedule: one step a reading time.

        Raises UsageError without a solution, and without a prior.
        """
        from occontrol.families.athans.readings.filter import matched_filter

        if solution is None:
            what = "the on-line filter of family athans follows the schedule of a solution"
            raise UsageError(f"{what}\n  hint: online(problem, solve(problem))")
        refuse(problem, "the on-line filter")
        return matched_filter(problem, schedule_of(solution))

    def filter_loop(
        self, problem: ReadingsProblem, solution: Solution, model: str | None = None, gate: float | None = None
    ) -> MatchedFilter:
        """The filter of `run_filter` step by step, with the same options; UsageError for a `model` other than exact."""
        from occontrol.families.athans.readings.filter import matched_filter

        _require_exact(model)
        refuse(problem, "the filter step by step")
        return matched_filter(problem, schedule_of(solution), gate)

    def filter_tables(self, problem: ReadingsProblem, solution: Solution) -> PlainDict:
        """The filter as plain arrays, see filter/tables.py."""
        from occontrol.families.athans.readings.filter import reading_tables

        return {} if solution.schedule is None or not problem.prior else reading_tables(problem, solution.schedule)

    def target_plan(self, problem: ReadingsProblem, solution: Solution) -> TargetPlan:
        """The `solution`'s schedule of a `problem` and its filter, for code on a target."""
        from occontrol.families.athans.readings.filter import reading_target

        refuse(problem, "code on a target")
        return reading_target(problem, schedule_of(solution))

    def tradeoff(self, problem: ReadingsProblem, cost_weights: Sequence[float], monitor: Monitor) -> Front:
        """Observation cost against prediction error over the cost weight alpha; UsageError for other criteria."""
        from occontrol.families.athans.readings.tradeoff import tradeoff

        refuse(problem, "tradeoff")
        if problem.measured:
            what = f"tradeoff does not do the criterion {problem.criterion.name}"  # type: ignore[union-attr]
            raise UsageError(f"{what}\n  hint: solve with several values of objective.cost_weight")
        return tradeoff(problem, cost_weights, monitor)

    def sensitivity(
        self, problem: ReadingsProblem, solution: Solution | None, monitor: Monitor, change: float | None = None
    ) -> ResultData:
        """Derivatives of the relaxed optimum; UsageError for rules, budgets and `change`."""
        from occontrol.families.athans.readings.sensitivity import sensitivity

        if change is not None:
            raise UsageError("changes of readings are not solved again\n  hint: a study varies price or noise: sweep")
        return sensitivity(problem, solution, monitor)


def _require_exact(model: str | None) -> None:
    if model not in (None, "exact"):
        raise UsageError(f"readings have one filter, which is exact; there is no model '{model}'\n  hint: leave it out")


READINGS = ReadingsFamily()
