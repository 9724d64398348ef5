"""Switching sensors against the worst admissible uncertainty (Savkin, Evans & Skafidas)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from occontrol.core import stopwatch
from occontrol.core.conversion import Asked
from occontrol.core.errors import InfeasibleError, ProblemError, SolveFailed
from occontrol.core.kinds import PlainDict
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.core.trajectory import Trajectory
from occontrol.families.family import NOTHING, Ability, Family
from occontrol.families.robust.balanced import balanced, restored
from occontrol.families.robust.methods import METHODS
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.result import SwitchingResult, sequence_of
from occontrol.families.robust.slots import table_of

if TYPE_CHECKING:
    from types import ModuleType

    from matplotlib.figure import Figure

    from occontrol.core.claims import Claims
    from occontrol.core.target import TargetPlan
    from occontrol.families.robust.online import OnlineSwitching
    from occontrol.files.page import Group, Table


class Robust(Family):
    """The family of Savkin, Evans & Skafidas: README.md beside this file has the equations."""

    name: ClassVar[str] = "robust"
    title: ClassVar[str] = "switching against the worst admissible uncertainty (Savkin, Evans & Skafidas)"
    methods: ClassVar[Mapping[str, type]] = METHODS
    compared: ClassVar[Sequence[str]] = ("optimal", "one-step", "best-single", "round-robin", "random")
    estimate_band: ClassVar[tuple[float, str]] = (1.0, "every state that the data allow")
    compared_curve: ClassVar[tuple[str, str, str] | None] = ("fine_times", "fine_size", "size, worst case up to t")
    abilities: ClassVar[frozenset[Ability]] = frozenset(
        {Ability.CERTIFY, Ability.SIMULATE, Ability.FILTER, Ability.ONLINE, Ability.COMPARE, Ability.CLOSED_LOOP}
    )
    problem_type: ClassVar[type] = Problem
    result_type: ClassVar[type] = SwitchingResult

    def solve(self, problem: Problem, method: Method | None = None, monitor: Monitor | None = None) -> Solution:
        """Find a sequence of sensors and prove how good it is.

        Parameters
        ----------
        problem : Problem
        method : an object of one of `methods`; the problem's own, or Optimal(), if left out
        monitor : Monitor

        Returns a Solution; its status is `infeasible` (with the observability horizon) when no schedule keeps the set
        of possible states bounded for all measurements. Raises UsageError for a method of another family, ProblemError
        for options that do not fit the problem.
        """
        began = stopwatch.seconds()
        chosen = self.choose(problem, problem.method if method is None else method)
        mistakes = [m.under("method") for m in chosen.check(problem)]
        if mistakes:
            raise ProblemError(mistakes)
        inner = balanced(problem)
        slots = table_of(inner)
        if slots is None:
            from occontrol.families.robust.assemble import unobservable_solution

            solution = unobservable_solution(inner, chosen.name, chosen.stated(problem))
        else:
            watch = (monitor or Monitor()).child(chosen.time_limit)
            solution = chosen.run(inner, slots, watch)
        return dataclasses.replace(restored(solution, problem), seconds=stopwatch.seconds() - began)

    def describe(self, problem: Problem) -> list[tuple[str, str]]:
        """What `check` prints: sizes, observability, an estimate of work."""
        from occontrol.families.robust.text import describe

        return describe(problem)

    def summarise(self, problem: Problem, solution: Solution) -> list[tuple[str, str]]:
        """The lines after a solve."""
        from occontrol.families.robust.text import summarise

        return summarise(problem, solution)

    def schema(self) -> ModuleType:
        """The module of the problem file."""
        from occontrol.families.robust import schema

        return schema

    def figures(self, problem: Problem, solution: Solution) -> dict[str, Figure]:
        """The sets of possible states, their size over time, and who measures when."""
        from occontrol.families.robust.figures import draw

        return draw(problem, solution)

    def groups(self, problem: Problem, solution: Solution) -> list[Group]:
        """The panels of the page of a solution."""
        from occontrol.families.robust.page import groups

        return groups(problem, solution)

    def tables(self, problem: Problem, solution: Solution) -> list[Table]:
        """Tables of the page of a solution."""
        from occontrol.families.robust.page import tables

        return tables(solution)

    def compare_figure(self, problem: Problem, solutions: Mapping[str, Solution]) -> Figure:
        """Size over time and schedule of several methods."""
        from occontrol.families.robust.figures import draw_compare

        return draw_compare(problem, solutions)

    def estimate_figures(
        self, problem: Problem, solution: Solution, estimate: Estimate, truth: Trajectory | None = None
    ) -> dict[str, Figure]:
        """The set of possible states from a measurement file."""
        from occontrol.families.robust.figures import draw_estimate

        return draw_estimate(problem, solution, estimate, truth)

    def require_feasible(self, problem: Problem) -> None:
        """Raise InfeasibleError when the plant is not uniformly robustly observable, whatever the sensors."""
        from occontrol.families.robust.observability import uniformly_observable, unobservable

        inner = balanced(problem)
        if not uniformly_observable(inner):
            raise InfeasibleError(unobservable(inner)[1])

    def truth_remark(self, estimate: Estimate, truth: Trajectory, source: object) -> str:
        """Whether the set of possible states held the truth at every time."""
        from occontrol.families.robust.text import truth_remark

        return truth_remark(estimate, truth, source)

    def converted(self, problem: Problem, family: str, asked: Asked = NOTHING) -> tuple[PlainDict, list[str]]:
        """A `problem` as a document of `family` athans, without its uncertainty; UsageError for others; nothing need be
        `asked`."""
        from occontrol.families.robust.convert import as_schedule

        return as_schedule(problem) if family == "athans" else super().converted(problem, family, asked)

    def target_plan(self, problem: Problem, solution: Solution) -> TargetPlan:
        """The schedule of a `solution` of a `problem`, for code on a target; SolveFailed without one."""
        from occontrol.core.target import schedule_alone

        if solution.schedule is None:
            raise SolveFailed("the solution has no schedule to follow")
        return schedule_alone(solution.schedule, "the estimate of family robust is a set, and no Kalman filter")

    def certify(self, problem: Problem, schedule: Schedule, claims: Claims | None = None) -> Solution:
        """Cost, lower bound and gap of anybody's schedule, everything recomputed (certify.py)."""
        from occontrol.families.robust.certify import certify

        began = stopwatch.seconds()
        return dataclasses.replace(certify(problem, schedule, claims), seconds=stopwatch.seconds() - began)

    def claims_of(self, problem: Problem, solution: Solution) -> Claims:
        """What a run says of its sequence, for `certify` to check."""
        from occontrol.families.robust.certify import claims_of

        return claims_of(solution)

    def simulate(
        self, problem: Problem, solution: Solution | None, seed: int = 0
    ) -> tuple[list[Measurement], Trajectory]:
        """An admissible truth, drawn at random, and what the scheduled sensors report of it.

        Parameters
        ----------
        problem : Problem
        solution : Solution whose schedule is followed; the problem is solved if None
        seed : of the generator
        """
        from occontrol.families.robust.data import simulate_admissible

        sequence = sequence_of(solution or self.solve(problem))
        names = problem.sensors.names
        return simulate_admissible(problem.flow, problem.plant, names, problem.edges, sequence, problem.samples, seed)

    def run_filter(self, problem: Problem, solution: Solution, measurements: Sequence[Measurement]) -> Estimate:
        """The set of possible states over measurements: center, half widths along every state, shape times level.

        Parameters
        ----------
        problem, solution : of the run
        measurements : list of Measurement; a value is held since the sampling time before it
        """
        from occontrol.families.robust.data import filter_samples

        sequence, names = sequence_of(solution), problem.sensors.names
        return filter_samples(
            problem.flow, problem.plant, names, problem.edges, sequence, problem.samples, measurements
        )

    def online(
        self, problem: Problem, solution: Solution | None = None, method: Method | None = None
    ) -> OnlineSwitching:
        """The on-line object: takes measurements, returns the set and the next sensor (online.py).

        Parameters
        ----------
        problem : Problem
        solution, method : not used: the object searches for itself

        Raises InfeasibleError when the plant is not uniformly robustly observable, SolveFailed where the user's units,
        in which it runs, hide that it is.
        """
        from occontrol.families.robust.online import OnlineSwitching

        self.require_feasible(problem)
        slots = table_of(problem)
        if slots is None:
            raise SolveFailed("the states are in units too far apart\n  hint: give them in units of their deviations")
        return OnlineSwitching(slots, problem.plant, names=problem.sensors.names)


FAMILY = Robust()
