"""What the family athans does with many targets and no end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from occontrol.core.errors import UsageError
from occontrol.families.athans.endless.problem import EndlessTargetsProblem
from occontrol.families.athans.methods import METHODS as OF_FAMILY
from occontrol.families.athans.periodic.method import Periodic
from occontrol.families.athans.targets.half import TargetsFamily
from occontrol.families.athans.targets.methods import METHODS as OF_TARGETS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from occontrol.core.claims import Claims
    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.method import Method
    from occontrol.core.monitor import Monitor
    from occontrol.core.schedule import Schedule
    from occontrol.core.solution import Solution
    from occontrol.core.trajectory import Trajectory
    from occontrol.files.page.content import Group


class EndlessTargetsFamily(TargetsFamily):
    """Which resource looks at which target, for ever."""

    methods: ClassVar[Mapping[str, type]] = {Periodic.name: Periodic}
    compared: ClassVar[Sequence[str]] = (Periodic.name,)

    def choose(self, problem: EndlessTargetsProblem, method: Method | str | None = None) -> Method:
        """The method object to run. Raises UsageError for one that does not do targets for ever."""
        chosen = problem.method if method is None else method
        name = chosen if isinstance(chosen, str) else getattr(chosen, "name", "")
        if name != Periodic.name and (name in OF_FAMILY or name in OF_TARGETS):
            raise UsageError(f"{name} does not do targets for ever\n  hint: method: {Periodic.name}")
        return super().choose(problem, chosen)

    def solve(self, problem: EndlessTargetsProblem, method: Method, monitor: Monitor) -> Solution:
        """The best joint cycle that can be found, with a bound for all schedules.

        The status is certified, feasible, interrupted or disagrees. Raises InfeasibleError where the covariance of a
        target has no limit, SolveFailed where no cycle was found.
        """
        from occontrol.families.athans.endless.solve import solve

        assert isinstance(method, Periodic)
        return solve(problem, method, monitor)

    def require_feasible(self, problem: EndlessTargetsProblem) -> None:
        """Raise InfeasibleError where the covariance of a target has no limit under any schedule."""
        from occontrol.families.athans.endless.bound import targets_of

        targets_of(problem)

    def describe(self, problem: EndlessTargetsProblem) -> list[tuple[str, str]]:
        """Targets, resources, the length of a look."""
        from occontrol.families.athans.endless.text import describe

        return describe(problem)

    def summarise(self, problem: EndlessTargetsProblem, solution: Solution) -> list[tuple[str, str]]:
        """Cost and bounds, prices, looks of the resources, the dearest targets."""
        from occontrol.families.athans.endless.text import summarise

        return summarise(problem, solution)

    def figures(self, problem: EndlessTargetsProblem, solution: Solution) -> dict[str, Figure]:
        """overview: the cycle, and what every target costs beside its bound."""
        from occontrol.families.athans.endless.figures import draw

        return draw(problem, solution)

    def groups(self, problem: EndlessTargetsProblem, solution: Solution) -> list[Group]:
        """Who is looked at when in a cycle."""
        from occontrol.families.athans.endless.figures import groups

        return groups(problem, solution)

    def compare_figure(self, problem: EndlessTargetsProblem, solutions: Mapping[str, Solution]) -> Figure | None:
        """None: there is one method."""
        return None

    def certify(self, problem: EndlessTargetsProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
        """Cost, lower bound and gap of anybody's cycle; refuted claims make the status `disagrees`."""
        from occontrol.families.athans.endless.certify import certify

        return certify(problem, schedule, claims)

    def simulate(
        self, problem: EndlessTargetsProblem, solution: Solution | None, seed: int
    ) -> tuple[list[Measurement], Trajectory]:
        """Raises UsageError: of targets for ever one is simulated at a time."""
        raise UsageError(f"simulate does not do targets for ever\n  hint: {ONE}")

    def run_filter(
        self,
        problem: EndlessTargetsProblem,
        solution: Solution,
        measurements: Sequence[Measurement],
        model: str | None = None,
        gate: float | None = None,
    ) -> Estimate:
        """Raises UsageError: of targets for ever one is filtered at a time."""
        raise UsageError(f"filter does not do targets for ever\n  hint: {ONE}")


ONE = "problem.alone(i) is one target as a problem of its own, and its cycle runs there"
ENDLESS_TARGETS = EndlessTargetsFamily()
