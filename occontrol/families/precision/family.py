"""Least sensor precision for a required accuracy, in ensemble and unscented Kalman filters (Das & Bhattacharya)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from occontrol.core import stopwatch
from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution
from occontrol.core.trajectory import Trajectory
from occontrol.families.family import Ability, Family
from occontrol.families.precision.methods import METHODS
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.result import PrecisionResult

if TYPE_CHECKING:
    from types import ModuleType

    from matplotlib.figure import Figure

    from occontrol.core.target import TargetPlan
    from occontrol.files.page import Group, Table


class Precision(Family):
    """The family of Das & Bhattacharya: README.md beside this file has the equations."""

    name: ClassVar[str] = "precision"
    title: ClassVar[str] = "least sensor precision in ensemble and unscented filters (Das & Bhattacharya)"
    methods: ClassVar[Mapping[str, type]] = METHODS
    compared: ClassVar[Sequence[str]] = ("barrier", "clarabel", "uniform")
    abilities: ClassVar[frozenset[Ability]] = frozenset(
        {Ability.SIMULATE, Ability.FILTER, Ability.COMPARE, Ability.CLOSED_LOOP}
    )
    begins_anew: ClassVar[str] = "an interior-point method starts well inside, a point near the optimum is no help"
    seed_paths: ClassVar[Sequence[str]] = ("filter.seed",)
    problem_type: ClassVar[type] = Problem
    result_type: ClassVar[type] = PrecisionResult

    def solve(self, problem: Problem, method: Method | None = None, monitor: Monitor | None = None) -> Solution:
        """Choose the precisions of every batch and prove how good they are.

        Parameters
        ----------
        problem : Problem
        method : an object of one of `methods`; the problem's own, or Barrier(), if left out
        monitor : Monitor

        Returns a Solution whose status is certified, feasible, limit, interrupted or infeasible (with the smallest
        factor that can be reached). Several batches run one after another against a simulated truth, measured with the
        precisions that were chosen. Raises UsageError for a method of another family.

        Raises ProblemError where the method does not suit the problem.
        """
        from occontrol.families.precision.assemble import assemble
        from occontrol.families.precision.batches import solve_batches

        began = stopwatch.seconds()
        chosen = self.choose(problem, problem.method if method is None else method)
        mistakes = [m.under("method") for m in chosen.check(problem)]
        if mistakes:
            raise ProblemError(mistakes)
        watch = (monitor or Monitor()).child(chosen.time_limit)
        solved, outcomes = solve_batches(problem, chosen, watch)
        solution = assemble(problem, chosen.name, solved, outcomes, watch)
        return dataclasses.replace(solution, seconds=stopwatch.seconds() - began)

    def warnings(self, problem: Problem) -> list[Mistake]:
        """An ensemble that is too small for the plant."""
        from occontrol.families.precision.warnings import warnings_of

        return warnings_of(problem)

    def describe(self, problem: Problem) -> list[tuple[str, str]]:
        """What `check` prints: sizes, filter, bound, and whether the first batch can meet it."""
        from occontrol.families.precision.text import describe

        return describe(problem)

    def summarise(self, problem: Problem, solution: Solution) -> list[tuple[str, str]]:
        """The lines after a solve."""
        from occontrol.families.precision.text import summarise

        return summarise(problem, solution)

    def schema(self) -> ModuleType:
        """The module of the problem file."""
        from occontrol.families.precision import schema

        return schema

    def figures(self, problem: Problem, solution: Solution) -> dict[str, Figure]:
        """Who measures how precisely, and where there are any: the batches and the price of pruning."""
        from occontrol.families.precision.figures import draw

        return draw(problem, solution)

    def groups(self, problem: Problem, solution: Solution) -> list[Group]:
        """The panels of the page of a solution."""
        from occontrol.families.precision.page import groups

        return groups(problem, solution)

    def tables(self, problem: Problem, solution: Solution) -> list[Table]:
        """Tables of the page of a solution."""
        from occontrol.families.precision.page import tables

        return tables(problem, solution)

    def compare_figure(self, problem: Problem, solutions: Mapping[str, Solution]) -> Figure:
        """The precisions of several methods side by side."""
        from occontrol.families.precision.figures import draw_compare

        return draw_compare(problem, solutions)

    def require_feasible(self, problem: Problem) -> None:
        """Raise InfeasibleError when the first batch cannot meet the bound."""
        problem.require_feasible()

    def target_plan(self, problem: Problem, solution: Solution) -> TargetPlan:
        """The gain of a `solution` of a `problem` with one batch, for code on a target; see target.py."""
        from occontrol.families.precision.target import target_plan

        return target_plan(problem, solution)

    def simulate(
        self, problem: Problem, solution: Solution | None, seed: int = 0
    ) -> tuple[list[Measurement], Trajectory]:
        """A true trajectory, and measurements of it with exactly the chosen precisions."""
        from occontrol.families.precision.data import simulate

        return simulate(problem, solution, seed)

    def run_filter(self, problem: Problem, solution: Solution, measurements: Sequence[Measurement]) -> Estimate:
        """The ensemble or unscented filter over measurements, with the solution's precisions."""
        from occontrol.families.precision.data import run_filter

        return run_filter(problem, solution, measurements)


FAMILY = Precision()
