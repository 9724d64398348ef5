"""What the family athans does with a problem of many targets and few resources."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from occontrol.core.errors import Mistake, UsageError
from occontrol.core.kinds import PlainDict
from occontrol.core.method import Method
from occontrol.families.athans.methods import METHODS as OF_FAMILY
from occontrol.families.athans.rate import RateFamily
from occontrol.families.athans.targets.methods import METHODS
from occontrol.families.athans.targets.problem import TargetsProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from occontrol.core.claims import Claims
    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.monitor import Monitor
    from occontrol.core.schedule import Schedule
    from occontrol.core.solution import Solution
    from occontrol.core.trajectory import Trajectory
    from occontrol.files.page.content import Group


class TargetsFamily(RateFamily):
    """Which resource looks at which target when."""

    methods: ClassVar[Mapping[str, type]] = METHODS
    compared: ClassVar[Sequence[str]] = (
        "schedule", "relaxed", "costate-index", "greedy", "information", "largest-trace", "round-robin", "random",
    )  # fmt: skip

    def choose(self, problem: TargetsProblem, method: Method | str | None = None) -> Method:
        """The method object to run. Raises UsageError for one that does not do many targets."""
        name = method if isinstance(method, str) else getattr(method, "name", "")
        foreign = name in OF_FAMILY and name not in METHODS
        if foreign:
            raise UsageError(f"{name} does not do many targets\n  hint: there are: {', '.join(METHODS)}")
        return super().choose(problem, method)

    def mistakes(self, problem: TargetsProblem, method: Method) -> list[Mistake]:
        """What is wrong with the options of `method` for `problem`."""
        found = super().mistakes(problem, method)
        if getattr(method, "exact_options", None) is not None:
            what = "exact does not do many targets"
            found.append(Mistake(("method", "exact"), what, "leave it out: the bound stands beside the schedule", True))
        return found

    def solve(self, problem: TargetsProblem, method: Method, monitor: Monitor) -> Solution:
        """Run `method` on the problem's blocks and certify what it found."""
        from occontrol.families.athans.targets.solve import solve

        return solve(problem, method, monitor)

    def require_feasible(self, problem: TargetsProblem) -> None:
        """Nothing: to look at nothing is always allowed."""

    def warnings(self, problem: TargetsProblem) -> list[Mistake]:
        """Targets that no resource ever sees."""
        from occontrol.families.athans.targets.text import warnings_of

        return warnings_of(problem)

    def describe(self, problem: TargetsProblem) -> list[tuple[str, str]]:
        """Targets, resources, blocks, memory and the time of a sweep."""
        from occontrol.families.athans.targets.text import describe

        return describe(problem)

    def summarise(self, problem: TargetsProblem, solution: Solution) -> list[tuple[str, str]]:
        """Cost, bound, the parts of the cost, looks by resource, the dearest targets."""
        from occontrol.families.athans.targets.text import summarise

        return summarise(problem, solution)

    def figures(self, problem: TargetsProblem, solution: Solution) -> dict[str, Figure]:
        """overview, and the panels of it by themselves."""
        from occontrol.families.athans.targets.figures import draw

        return draw(problem, solution)

    def groups(self, problem: TargetsProblem, solution: Solution) -> list[Group]:
        """Who is looked at when, ages, deviations, prices."""
        from occontrol.families.athans.targets.page import target_groups

        return target_groups(problem, solution)

    def compare_figure(self, problem: TargetsProblem, solutions: Mapping[str, Solution]) -> Figure | None:
        """Costs of several methods beside the best bound."""
        from occontrol.families.athans.targets.figures import draw_compare

        return draw_compare(problem, solutions)

    def certify(self, problem: TargetsProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
        """Cost, lower bound and gap of anybody's schedule; refuted claims make the status `disagrees`."""
        from occontrol.families.athans.targets.certify import certify

        return certify(problem, schedule, claims)

    def simulate(
        self, problem: TargetsProblem, solution: Solution | None, seed: int
    ) -> tuple[list[Measurement], Trajectory]:
        """A true trajectory of every target, and what the scheduled looks report of them."""
        from occontrol.families.athans.targets.filter import simulate

        return simulate(problem, solution, seed)

    def run_filter(
        self,
        problem: TargetsProblem,
        solution: Solution,
        measurements: Sequence[Measurement],
        model: str | None = None,
        gate: float | None = None,
    ) -> Estimate:
        """One bank of matched filters, target by target; `model` and `gate` as for one plant."""
        from occontrol.families.athans.targets.filter import run_filter

        return run_filter(problem, solution, measurements, model, gate)

    def online(self, problem: TargetsProblem, solution: Solution | None = None, method: Method | None = None):
        """UsageError: an on-line filter is for one target, see `target_problem`."""
        raise UsageError(
            "the on-line filter does not do many targets at once\n  hint: occontrol filter RUN MEASUREMENTS"
        )

    def filter_loop(self, problem: TargetsProblem, solution: Solution, **options: object):
        """UsageError, as `online`."""
        return self.online(problem, solution)

    def target_plan(self, problem: TargetsProblem, solution: Solution):
        """UsageError: code on a target is for one plant."""
        what = "code on a target does not do many targets at once"
        raise UsageError(f"{what}\n  hint: --to csv writes who looks at what; target_problem takes one out")

    def filter_tables(self, problem: TargetsProblem, solution: Solution) -> PlainDict:
        """Nothing: gains of many targets are not exported."""
        return {}

    def tradeoff(self, problem: TargetsProblem, cost_weights: Sequence[float], monitor: Monitor):
        """UsageError: costs of looks are traded for one plant only."""
        raise UsageError("tradeoff does not do many targets\n  hint: solve with other values of objective.cost_weight")


TARGETS = TargetsFamily()
