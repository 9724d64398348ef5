"""The family of Oshman (1994) as one object: on-line selection, its baselines, look-ahead and the exact optimum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from occontrol.core import stopwatch
from occontrol.core.conversion import Asked
from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.kinds import PlainDict
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.core.trajectory import Trajectory
from occontrol.families.family import NOTHING, Ability, Family
from occontrol.families.vlambda.methods import METHODS, Fixed, Lookahead, Optimal, Rule
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.result import SelectionResult, assemble, recorded
from occontrol.families.vlambda.sensor_choice import subsets

if TYPE_CHECKING:
    from types import ModuleType

    from matplotlib.figure import Figure

    from occontrol.core.claims import Claims
    from occontrol.core.target import TargetPlan
    from occontrol.families.vlambda.online import OnlineSelector
    from occontrol.files.page import Group

MOST_FIXED = 12  # groups that `compare` shows one by one


class VLambda(Family):
    """Choose sensors at the start of every epoch from the covariance that is predicted there."""

    name: ClassVar[str] = "vlambda"
    title: ClassVar[str] = "on-line selection along the worst eigendirection (Oshman 1994)"
    methods: ClassVar[Mapping[str, type]] = METHODS
    compared: ClassVar[Sequence[str]] = tuple(METHODS)
    columns: ClassVar[Sequence[str]] = ("sum_largest_eigenvalue", "sum_trace", "peak_largest_eigenvalue")
    compared_curve: ClassVar[tuple[str, str, str] | None] = ("times", "largest_eigenvalue", "λmax P(k|k)")
    abilities: ClassVar[frozenset[Ability]] = frozenset(
        {Ability.CERTIFY, Ability.SIMULATE, Ability.FILTER, Ability.ONLINE, Ability.COMPARE, Ability.CLOSED_LOOP}
    )
    problem_type: ClassVar[type] = Problem
    result_type: ClassVar[type] = SelectionResult

    def solve(
        self, problem: Problem, method: Rule | Optimal | str | None = None, monitor: Monitor | None = None
    ) -> Solution:
        """Select sensors over the horizon with one method and evaluate what the filter makes of it.

        Parameters
        ----------
        problem : Problem
        method : an object of one of `methods`, or a name; the problem's own, or Eigenspace(), if left out
        monitor : Monitor

        Returns Solution. Raises InfeasibleError when a movable sensor has nowhere to be, SolveFailed when a search
        would be too large, UsageError for a method of another family, ProblemError for options that do not fit.
        """
        chosen, watch = self._fitting(problem, method), (monitor or Monitor()).child()
        began = stopwatch.seconds()
        outcome = chosen.run(problem, watch)
        return assemble(problem, outcome, method=chosen.name, began=began, monitor=watch)

    def _fitting(self, problem: Problem, method: Rule | Optimal | str | None) -> Rule | Optimal:
        chosen = self.choose(problem, method)
        mistakes = [m.under("method") for m in chosen.check(problem)]
        if mistakes:
            raise ProblemError(mistakes)
        return chosen

    def describe(self, problem: Problem) -> list[tuple[str, str]]:
        """(label, text) lines that `check` prints of a `problem`."""
        from occontrol.families.vlambda.text import describe

        return describe(problem)

    def summarise(self, problem: Problem, solution: Solution) -> list[tuple[str, str]]:
        """(label, text) lines of a `solution` to a `problem`."""
        from occontrol.families.vlambda.text import summarise

        return summarise(problem, solution)

    def schema(self) -> ModuleType:
        """The module of the problem file."""
        from occontrol.families.vlambda import schema

        return schema

    def figures(self, problem: Problem, solution: Solution) -> dict[str, Figure]:
        """The figures of a `solution` to a `problem` by name."""
        from occontrol.families.vlambda.figures import draw

        return draw(problem, solution)

    def groups(self, problem: Problem, solution: Solution) -> list[Group]:
        """The panels of the page of a solution."""
        from occontrol.families.vlambda.page import groups

        return groups(problem, solution)

    def compare_figure(self, problem: Problem, solutions: Mapping[str, Solution]) -> Figure:
        """One figure of several `solutions` by method name."""
        from occontrol.families.vlambda.figures import draw_compare

        return draw_compare(problem, solutions)

    def compare_names(self, problem: Problem) -> list[str]:
        """`compared`, with every fixed choice by itself where there are few: "fixed:one", "fixed:two", .."""
        groups = subsets(len(problem.sensors), problem.select, MOST_FIXED)
        if groups is None:
            return list(self.compared)
        names = problem.sensors.names
        fixed = ["fixed:" + "+".join(names[j] for j in group) for group in groups]
        return [each for name in self.compared for each in (fixed if name == Fixed.name else [name])]

    def method_named(self, problem: Problem, name: str) -> Fixed | Lookahead | None:
        """The method that carries its argument, "fixed:one+two" or "lookahead:3"; None for any other name.

        Parameters
        ----------
        problem : Problem, whose sensors are named
        name : what the user calls the method

        Raises UsageError where the argument does not fit the problem.
        """
        head, colon, argument = name.partition(":")
        method: Fixed | Lookahead | None = None
        try:
            if colon and head == Fixed.name:
                method = Fixed(argument if argument in problem.sensors.names else argument.split("+"))
            elif colon and head == Lookahead.name and argument.isdecimal():
                method = Lookahead(depth=int(argument))
            mistakes = [] if method is None else list(method.check(problem))
        except ProblemError as error:
            mistakes = error.mistakes
        if mistakes:
            raise UsageError(f"method {name}: {mistakes[0].what}\n  hint: {mistakes[0].hint}")
        return method

    def require_feasible(self, problem: Problem) -> None:
        """Raise InfeasibleError where a movable sensor of `problem` has nowhere to be."""
        problem.require_feasible()

    def converted(self, problem: Problem, family: str, asked: Asked = NOTHING) -> tuple[PlainDict, list[str]]:
        """A `problem` as a document of `family` athans, which plans all choices together; UsageError for others;
        nothing need be `asked`."""
        from occontrol.families.vlambda.convert import as_readings

        return as_readings(problem) if family == "athans" else super().converted(problem, family, asked)

    def target_plan(self, problem: Problem, solution: Solution) -> TargetPlan:
        """The choices of a `solution` of a `problem` and the filter along them, for code on a target."""
        from occontrol.families.vlambda.target import target_plan

        return target_plan(problem.sampled, problem.starts, recorded(problem, solution))

    def certify(self, problem: Problem, schedule: Schedule, claims: Claims | None = None) -> Solution:
        """Cost of anybody's choices, beside the bound that the exact search proves; see certificate.py.

        Parameters
        ----------
        problem : Problem
        schedule : Schedule over k = 0 .. steps that changes only where an epoch begins
        claims : of a run, to be checked
        """
        from occontrol.families.vlambda.certificate import certify

        return certify(problem, schedule, claims)

    def claims_of(self, problem: Problem, solution: Solution) -> Claims:
        """What a `solution` to a `problem` states, for `certify` to check."""
        from occontrol.families.vlambda.certificate import claims_of

        return claims_of(problem, solution)

    def simulate(
        self, problem: Problem, solution: Solution | None, seed: int = 0
    ) -> tuple[list[Measurement], Trajectory]:
        """A true trajectory x(0) .. x(K-1) and what the selected sensors report of it, one Measurement each and step.

        Parameters
        ----------
        problem : Problem
        solution : Solution whose choices are followed; solved with the problem's own method if None
        seed : of the generator
        """
        from occontrol.families.vlambda.data import simulate_selection

        chooser = recorded(problem, self.solve(problem) if solution is None else solution)
        return simulate_selection(problem.sampled, problem.starts, problem.select, chooser, seed)

    def run_filter(self, problem: Problem, solution: Solution, measurements: Sequence[Measurement]) -> Estimate:
        """The V-Lambda filter over a measurement file, with the solution's choices.

        Parameters
        ----------
        problem, solution : of the run
        measurements : list of Measurement, t = k

        Raises ProblemError for a sensor that does not exist, a t that is no step, or the wrong number of values.
        """
        from occontrol.families.vlambda.data import filter_measurements

        chooser = recorded(problem, solution)
        return filter_measurements(problem.sampled, problem.starts, problem.select, chooser, measurements)

    def online(
        self, problem: Problem, solution: Solution | None = None, method: Rule | Optimal | str | None = None
    ) -> OnlineSelector:
        """The loop of a target: `step(measurements)` gives the estimate and which sensors to use next.

        Parameters
        ----------
        problem : Problem
        solution : Solution whose choices are followed; the method chooses from step to step if left out
        method : an object of one of `methods`, or a name such as "eigenspace" or "fixed:one"; the problem's own if
            left out

        >>> loop = FAMILY.online(problem)                # doctest: +SKIP
        >>> done = loop.step({"one": [0.3, 0.1]})        # doctest: +SKIP
        >>> done.next_sensors                            # doctest: +SKIP

        Raises UsageError where both a solution and a method are given.
        """
        from occontrol.families.vlambda.online import OnlineSelector

        if solution is not None and method is not None:
            raise UsageError("online follows a solution or a method, not both")
        chooser = self._fitting(problem, method).chooser(problem) if solution is None else recorded(problem, solution)
        return OnlineSelector(problem.sampled, problem.starts, problem.select, chooser)


FAMILY = VLambda()
