"""What the family athans does with a problem whose horizon has no end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, NoReturn

from occontrol.core.errors import Mistake, UsageError
from occontrol.core.kinds import PlainDict
from occontrol.families.athans.methods import METHODS as OTHERS
from occontrol.families.athans.periodic.method import Periodic, Shares
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.rate import RateFamily, schedule_of
from occontrol.families.family import Family

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from occontrol.core.claims import Claims
    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.method import Method
    from occontrol.core.monitor import Monitor
    from occontrol.core.schedule import Schedule
    from occontrol.core.solution import Solution
    from occontrol.core.target import TargetPlan
    from occontrol.core.trajectory import Trajectory
    from occontrol.files.page import Group


class PeriodicFamily(RateFamily):
    """Cycles that are repeated for ever."""

    methods: ClassVar[Mapping[str, type]] = {Periodic.name: Periodic, Shares.name: Shares}
    compared: ClassVar[Sequence[str]] = (Periodic.name, Shares.name)

    def choose(self, problem: PeriodicProblem, method: Method | str | None = None) -> Method:
        """The method object to run. Raises UsageError for one that does not do an infinite horizon."""
        chosen = problem.method if method is None else method
        name = chosen if isinstance(chosen, str) else getattr(chosen, "name", "")
        if name in OTHERS:
            raise UsageError(f"{name} does not do an infinite horizon\n  hint: method: {Periodic.name}")
        return super().choose(problem, method)

    def solve(self, problem: PeriodicProblem, method: Method, monitor: Monitor) -> Solution:
        """The best cycle that can be found, with a bound for all schedules.

        The status is certified, feasible, interrupted or disagrees. Raises UsageError for a method other than periodic,
        InfeasibleError where no schedule keeps the covariance bounded.
        """
        from occontrol.families.athans.periodic.solve import solve, solve_drawn

        if isinstance(method, Shares):
            return solve_drawn(problem, method, monitor)
        if not isinstance(method, Periodic):
            raise UsageError(f"{method.name} does not do an infinite horizon\n  hint: method: {Periodic.name}")
        return solve(problem, method, monitor)

    def require_feasible(self, problem: PeriodicProblem) -> None:
        """Raise InfeasibleError where no schedule keeps the covariance bounded."""
        from occontrol.families.athans.periodic.prove import require_bounded

        require_bounded(problem)

    def warnings(self, problem: PeriodicProblem) -> list[Mistake]:
        """None: what cannot go on for ever is a mistake."""
        return []

    def describe(self, problem: PeriodicProblem) -> list[tuple[str, str]]:
        """Sizes, clock, choices, prices, deviations."""
        from occontrol.families.athans.periodic.text import describe

        return describe(problem)

    def summarise(self, problem: PeriodicProblem, solution: Solution) -> list[tuple[str, str]]:
        """The cycle, its cost, bounds and the proof."""
        from occontrol.families.athans.periodic.text import summarise

        return summarise(problem, solution)

    def figures(self, problem: PeriodicProblem, solution: Solution) -> dict[str, Figure]:
        """overview, and the panels of it by themselves."""
        from occontrol.families.athans.periodic.figures import draw

        return draw(problem, solution)

    def groups(self, problem: PeriodicProblem, solution: Solution) -> list[Group]:
        """The panels of the page of a cycle."""
        return Family.groups(self, problem, solution)

    def compare_figure(self, problem: PeriodicProblem, solutions: Mapping[str, Solution]) -> Figure | None:
        """Costs of the methods beside the best bound."""
        from occontrol.families.athans.periodic.figures import draw_compare

        return draw_compare(problem, solutions)

    def certify(self, problem: PeriodicProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
        """Cost, lower bound and gap of anybody's cycle; refuted claims make the status `disagrees`."""
        from occontrol.families.athans.periodic.certify import certify

        return certify(problem, schedule, claims)

    def claims_of(self, problem: PeriodicProblem, solution: Solution) -> Claims:
        """Everything that a run says of its cycle, its proof among it."""
        from occontrol.families.athans.periodic.certify import claims_of

        return claims_of(solution)

    def simulate(
        self, problem: PeriodicProblem, solution: Solution | None, seed: int
    ) -> tuple[list[Measurement], Trajectory]:
        """A true trajectory over many cycles, and what the scheduled sensors report of it."""
        from occontrol.families.athans.periodic.filter import simulate

        return simulate(problem, schedule_of(solution), seed)

    def run_filter(
        self,
        problem: PeriodicProblem,
        solution: Solution,
        measurements: Sequence[Measurement],
        model: str | None = None,
        gate: float | None = None,
    ) -> Estimate:
        """The filter of the periodic steady state along the cycle, as long as there are measurements."""
        from occontrol.families.athans.periodic.filter import run_filter

        return run_filter(problem, solution, measurements, model, gate)

    def online(self, problem: PeriodicProblem, solution: Solution | None = None, method: Method | None = None):
        """The filter of the periodic steady state for a loop on a target; UsageError without a solution."""
        from occontrol.families.athans.periodic.filter import online

        if solution is None:
            what = "the on-line filter of family athans follows the schedule of a solution"
            raise UsageError(f"{what}\n  hint: online(problem, solve(problem))")
        return online(problem, solution)

    def filter_tables(self, problem: PeriodicProblem, solution: Solution) -> PlainDict:
        """The filter of one cycle in its steady state as plain arrays, see filter/tables.py."""
        from occontrol.families.athans.periodic.filter import cycle_tables

        return {} if solution.schedule is None else cycle_tables(problem, solution)

    def target_plan(self, problem: PeriodicProblem, solution: Solution) -> TargetPlan:
        """One cycle and its filter in the steady state, for code on a target that begins anew after it."""
        from occontrol.families.athans.periodic.filter import cycle_target

        return cycle_target(problem, solution)

    def tradeoff(self, problem: PeriodicProblem, cost_weights: Sequence[float], monitor: Monitor) -> NoReturn:
        """Raises UsageError: not for an infinite horizon."""
        raise UsageError("tradeoff does not do an infinite horizon\n  hint: solve with several objective.cost_weight")

    def sensitivity(
        self, problem: PeriodicProblem, solution: Solution | None, monitor: Monitor, change: float | None = None
    ) -> NoReturn:
        """Raises UsageError: not for an infinite horizon."""
        raise UsageError("sensitivity does not do an infinite horizon\n  hint: solve again with what is changed")


PERIODIC = PeriodicFamily()
