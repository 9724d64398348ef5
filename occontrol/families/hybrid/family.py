"""The family of Liu & Hwang as one object: sensors for jumping-mode plants, judged by many simulated runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution
from occontrol.core.trajectory import Trajectory
from occontrol.families.family import Ability, Family
from occontrol.families.hybrid.methods import (
    METHODS,
    Alternate,
    ExpectedCovariance,
    Fixed,
    GroupMethod,
    Random,
    Scheduled,
)
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.result import HybridResult, numbers_of

if TYPE_CHECKING:
    from types import ModuleType

    from matplotlib.figure import Figure

    from occontrol.core.target import TargetPlan
    from occontrol.files.page import Group

MOST_FIXED = 3  # groups that `compare` shows one by one


class Hybrid(Family):
    """Choose one group of sensors at every step so that mode and state of a jumping-mode plant can be told."""

    name: ClassVar[str] = "hybrid"
    title: ClassVar[str] = "sensors for jumping-mode plants (Liu & Hwang)"
    methods: ClassVar[Mapping[str, type]] = METHODS
    compared: ClassVar[Sequence[str]] = tuple(m.name for m in (Scheduled, ExpectedCovariance, Alternate, Random, Fixed))
    columns: ClassVar[Sequence[str]] = ("average_rms", "peak_rms", "mode_errors", "average_nees")
    compared_curve: ClassVar[tuple[str, str, str] | None] = ("times", "rms", "RMS position error")
    abilities: ClassVar[frozenset[Ability]] = frozenset(
        {Ability.SIMULATE, Ability.FILTER, Ability.COMPARE, Ability.MONTE_CARLO, Ability.CLOSED_LOOP}
    )
    begins_anew: ClassVar[str] = "a result holds the averages over its runs, not the runs"
    seed_paths: ClassVar[Sequence[str]] = ("simulation.seed",)
    problem_type: ClassVar[type] = Problem
    result_type: ClassVar[type] = HybridResult

    def solve(
        self, problem: Problem, method: GroupMethod | str | None = None, monitor: Monitor | None = None
    ) -> Solution:
        """Simulate and estimate all runs with one of `methods` as the chooser.

        Parameters
        ----------
        problem : Problem
        method : an object of one of `methods`, or a name; the problem's own, or Scheduled(), if left out
        monitor : Monitor

        Returns a Solution whose status is feasible, limit or interrupted; what it says is about the runs that were
        done. Raises SolveFailed when a state or an estimate leaves the range of the numbers, UsageError for a method of
        another family, ProblemError for options that do not fit.
        """
        return self._fitting(problem, method).run(problem, Monitor() if monitor is None else monitor)

    def _fitting(self, problem: Problem, method: GroupMethod | str | None) -> GroupMethod:
        chosen = self.choose(problem, method)
        mistakes = [m.under("method") for m in chosen.check(problem)]
        if mistakes:
            raise ProblemError(mistakes)
        return chosen

    def describe(self, problem: Problem) -> list[tuple[str, str]]:
        """(label, text) lines that `check` prints of a `problem`."""
        from occontrol.families.hybrid.text import describe

        return describe(problem)

    def summarise(self, problem: Problem, solution: Solution) -> list[tuple[str, str]]:
        """(label, text) lines of a `solution` to a `problem`."""
        from occontrol.families.hybrid.text import summarise

        return summarise(problem, solution)

    def schema(self) -> ModuleType:
        """The module of the problem file."""
        from occontrol.families.hybrid import schema

        return schema

    def figures(self, problem: Problem, solution: Solution) -> dict[str, Figure]:
        """The figures of a `solution` to a `problem` by name."""
        from occontrol.families.hybrid.figures import draw

        return draw(problem, solution)

    def groups(self, problem: Problem, solution: Solution) -> list[Group]:
        """The panels of the page of a solution."""
        from occontrol.families.hybrid.page import groups

        return groups(problem, solution)

    def compare_figure(self, problem: Problem, solutions: Mapping[str, Solution]) -> Figure:
        """One figure of several `solutions` by method name."""
        from occontrol.families.hybrid.figures import draw_compare

        return draw_compare(problem, solutions)

    def compare_names(self, problem: Problem) -> list[str]:
        """`compared`, with every group by itself where there are few: "fixed:one", "fixed:two", .."""
        groups = problem.groups or ()
        if len(groups) > MOST_FIXED:
            return list(self.compared)
        fixed = ["fixed:" + "+".join(group) for group in groups]
        return [each for name in self.compared for each in (fixed if name == Fixed.name else [name])]

    def method_named(self, problem: Problem, name: str) -> Fixed | None:
        """The method that carries its argument, "fixed:one+two"; None for any other name.

        Parameters
        ----------
        problem : Problem, whose sensors are named
        name : what the user calls the method

        Raises UsageError where the argument does not fit the problem.
        """
        head, colon, argument = name.partition(":")
        if not colon or head != Fixed.name:
            return None
        method = Fixed(argument)
        mistakes = list(method.check(problem))
        if mistakes:
            raise UsageError(f"method {name}: {mistakes[0].what}\n  hint: {mistakes[0].hint}")
        return method

    def target_plan(self, problem: Problem, solution: Solution) -> TargetPlan:
        """The schedule of a `solution` of a `problem`, for code on a target.

        Raises UsageError where it depends on what is measured, and where a run drew it by chance.
        """
        from occontrol.families.hybrid.target import target_plan

        return target_plan(problem, solution)

    def simulate(
        self, problem: Problem, solution: Solution | None, seed: int = 0
    ) -> tuple[list[Measurement], Trajectory]:
        """One seeded truth and the measurements that the solution's chooser asks for along it.

        Parameters
        ----------
        problem : Problem
        solution : Solution whose method chooses, or None for the problem's own
        seed : of the random generator

        Returns (measurements, truth): measurements at k = 1 .. steps, truth with values (steps+1, n).
        """
        from occontrol.families.hybrid.data import simulate

        if solution is None:
            return simulate(problem, self._fitting(problem, None), seed)
        return simulate(problem, METHODS[solution.method].behind(numbers_of(solution)), seed)

    def run_filter(self, problem: Problem, solution: Solution, measurements: Sequence[Measurement]) -> Estimate:
        """The jumping-mode estimate along measurements at whole steps; any sensors may report at a step, or none.

        Parameters
        ----------
        problem : Problem
        solution : Solution; not looked at, the estimator follows the measurements
        measurements : list of Measurement with time = k; a value that is NaN is missing

        Raises ProblemError for unknown sensors, wrong numbers of values, and times that are not steps.
        """
        from occontrol.families.hybrid.data import run_filter

        return run_filter(problem, measurements)


FAMILY = Hybrid()
