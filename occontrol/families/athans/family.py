"""Off-line schedules with a certificate: the family of Athans (1971), for continuous sensing, for readings, for ever.

Five kinds of problems, one family: each call goes to the part that a problem belongs to: continuous sensing, readings,
many targets, no end, or many targets without an end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from occontrol.core.errors import Mistake, UsageError
from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.core.measurement import OnlineLoop
from occontrol.core.method import Method
from occontrol.core.result import ResultData
from occontrol.core.solution import Tradeoff
from occontrol.families.abilities import Work
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.endless.half import ENDLESS_TARGETS
from occontrol.families.athans.endless.problem import EndlessTargetsProblem
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.families.athans.periodic.half import PERIODIC
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.rate import RATE, RateFamily, refuse, schedule_of
from occontrol.families.athans.readings.half import READINGS
from occontrol.families.athans.targets.half import TARGETS
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.families.family import Family

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.random import SeedSequence

    from occontrol.core.claims import Claims
    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.monitor import Monitor
    from occontrol.core.schedule import Schedule
    from occontrol.core.solution import Solution
    from occontrol.core.target import TargetPlan
    from occontrol.core.trajectory import Trajectory
    from occontrol.files.page import Group


class AthansFamily(RateFamily):
    """Which sensor when, planned for a whole horizon, with a proven lower bound beside the cost."""

    title: ClassVar[str] = "off-line schedules with a certificate (Athans 1971)"
    further_methods: ClassVar[Mapping[str, type]] = {**TARGETS.methods, **PERIODIC.methods}

    def _half(self, problem: AthansProblem) -> Family:
        if problem.of_targets:
            return ENDLESS_TARGETS if problem.infinite else TARGETS
        if problem.infinite:
            return PERIODIC
        return READINGS if problem.takes_readings else RATE

    def choose(self, problem: AthansProblem, method: Method | str | None = None) -> Method:
        """The method object to run; many targets and no end have their own. Raises UsageError for others."""
        if isinstance(problem, EndlessTargetsProblem):
            return ENDLESS_TARGETS.choose(problem, method)
        if isinstance(problem, TargetsProblem):
            return TARGETS.choose(problem, method)
        if isinstance(problem, PeriodicProblem):
            return PERIODIC.choose(problem, method)
        chosen = problem.method if method is None else method
        name = chosen if isinstance(chosen, str) else getattr(chosen, "name", "")
        if name in PERIODIC.methods:
            hint = "horizon: {infinite: true}, with step: .. in continuous time"
            raise UsageError(f"{name} does not do a horizon that ends\n  hint: {hint}")
        return super().choose(problem, method)

    def mistakes(self, problem: AthansProblem, method: Method) -> list[Mistake]:
        """What is wrong with the options of `method` for `problem`."""
        if isinstance(problem, TargetsProblem):
            return TARGETS.mistakes(problem, method)
        return super().mistakes(problem, method)

    def compare_names(self, problem: AthansProblem) -> list[str]:
        """The method names that `compare` runs on `problem` when none are given."""
        if problem.infinite:
            return list((ENDLESS_TARGETS if problem.of_targets else PERIODIC).compared)
        return list(TARGETS.compared if problem.of_targets else self.compared)

    def claims_of(self, problem: AthansProblem, solution: Solution) -> Claims:
        """Everything that a run says of its schedule; of an infinite horizon the proof, too."""
        return self._half(problem).claims_of(problem, solution)  # type: ignore[return-value]

    def solve(self, problem: AthansProblem, method: Method, monitor: Monitor) -> Solution:
        """Run `method` on `problem` and certify what it found; see the two halves for what is raised."""
        return _labelled(problem, self._half(problem).solve(problem, method, monitor))

    def require_feasible(self, problem: AthansProblem) -> None:
        """Raise InfeasibleError, with the time, when the sensors of `problem` are too few somewhere."""
        self._half(problem).require_feasible(problem)

    def warnings(self, problem: AthansProblem) -> list[Mistake]:
        """What `problem` says that is allowed and hardly meant."""
        from occontrol.families.athans.nonlinear.label import doubts

        return [*self._half(problem).warnings(problem), *doubts(problem)]

    def describe(self, problem: AthansProblem) -> list[tuple[str, str]]:
        """Sizes, costs, observability, an estimate of work of `problem`."""
        from occontrol.families.athans.nonlinear.label import describe_linearised

        return [*self._half(problem).describe(problem), *describe_linearised(problem)]

    def summarise(self, problem: AthansProblem, solution: Solution) -> list[tuple[str, str]]:
        """Cost, bound and parts of a `solution` of `problem`."""
        from occontrol.families.athans.nonlinear.label import summarise_linearised

        return [*self._half(problem).summarise(problem, solution), *summarise_linearised(solution)]

    def figures(self, problem: AthansProblem, solution: Solution) -> dict[str, Figure]:
        """overview, and the panels of it by themselves."""
        return self._half(problem).figures(problem, solution)

    def groups(self, problem: AthansProblem, solution: Solution) -> list[Group]:
        """The panels of the page of a schedule."""
        return self._half(problem).groups(problem, solution)

    def compare_figure(self, problem: AthansProblem, solutions: Mapping[str, Solution]) -> Figure | None:
        """Schedules, costs and bounds of several methods below each other."""
        return self._half(problem).compare_figure(problem, solutions)

    def certify(self, problem: AthansProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
        """Cost, lower bound and gap of anybody's schedule; refuted claims make the status `disagrees`."""
        return _labelled(problem, self._half(problem).certify(problem, schedule, claims))

    def simulate(
        self, problem: AthansProblem, solution: Solution | None, seed: int
    ) -> tuple[list[Measurement], Trajectory]:
        """A true trajectory of the plant and what the scheduled sensors report of it."""
        if _nonlinear(problem, "simulate"):
            from occontrol.families.athans.nonlinear.filter import simulate

            return simulate(problem, schedule_of(solution), seed)
        return self._half(problem).simulate(problem, solution, seed)

    def run_filter(
        self, problem: AthansProblem, solution: Solution, measurements: Sequence[Measurement], **options: object
    ) -> Estimate:
        """The matched filter along the solution's schedule; options: model and gate.

        Of a nonlinear plant `model` is ekf, iterated or ukf.
        """
        if _nonlinear(problem, "the filter of a nonlinear plant"):
            from occontrol.families.athans.nonlinear.filter import run_filter

            return run_filter(problem, schedule_of(solution), measurements, **_renamed(options))
        return self._half(problem).run_filter(problem, solution, measurements, **options)

    def online(
        self, problem: AthansProblem, solution: Solution | None = None, method: Method | None = None
    ) -> OnlineLoop:
        """The matched filter for a loop on a target, along the solution's schedule."""
        if solution is not None and _nonlinear(problem, "the filter of a nonlinear plant"):
            from occontrol.families.athans.nonlinear.online import NonlinearFilter

            return NonlinearFilter(problem, schedule_of(solution))
        return self._half(problem).online(problem, solution, method)

    def filter_loop(self, problem: AthansProblem, solution: Solution, **options: object) -> OnlineLoop:
        """The matched filter of a `solution` of a `problem`, step by step; `options`: model and gate."""
        if _nonlinear(problem, "the filter of a nonlinear plant"):
            from occontrol.families.athans.nonlinear.online import NonlinearFilter

            return NonlinearFilter(problem, schedule_of(solution), **_renamed(options))
        return self._half(problem).filter_loop(problem, solution, **options)

    def filter_tables(self, problem: AthansProblem, solution: Solution) -> PlainDict:
        """The matched filter as plain arrays; none of a nonlinear plant, whose filter linearises as it goes."""
        if linearisation_of(problem) is not None:
            return {}
        return self._half(problem).filter_tables(problem, solution)

    def target_plan(self, problem: AthansProblem, solution: Solution) -> TargetPlan:
        """The schedule of a `solution` to a `problem` and its filter, for code on a target."""
        if _nonlinear(problem, "code on a target"):
            from occontrol.families.athans.nonlinear.target import target_plan

            return target_plan(problem, schedule_of(solution))
        return self._half(problem).target_plan(problem, solution)

    def tradeoff(self, problem: AthansProblem, cost_weights: Sequence[float], monitor: Monitor) -> Tradeoff:
        """Observation cost against prediction error over the cost weight alpha."""
        return self._half(problem).tradeoff(problem, cost_weights, monitor)

    def budgets(self, problem: AthansProblem, caps: Sequence[float], monitor: Monitor) -> Tradeoff:
        """The least prediction error over caps on the observation cost."""
        from occontrol.families.athans.budgets import budgets

        return budgets(problem, caps, self._half(problem), monitor)

    def sensitivity(
        self, problem: AthansProblem, solution: Solution | None, monitor: Monitor, change: float | None = None
    ) -> ResultData:
        """Derivatives of the relaxed optimum; UsageError for rules."""
        from occontrol.families.athans.scope import require_traces

        require_traces(problem, "sensitivities")
        return self._half(problem).sensitivity(problem, solution, monitor, change)

    def monte_carlo(
        self,
        problem: AthansProblem,
        solution: Solution,
        policies: Sequence[str] | None,
        runs: int,
        seed: int,
        monitor: Monitor,
        work: Work | None = None,
    ) -> ResultData:
        """Policies side by side on simulated runs; methods side by side where sensing is continuous."""
        from occontrol.families.athans.scope import require_traces

        require_traces(problem, "simulated runs in closed loop")
        if not problem.takes_readings:
            return super().monte_carlo(problem, solution, policies, runs, seed, monitor, work)
        from occontrol.families.athans.replanning.monte_carlo import compare

        return compare(problem, solution, policies, runs, seed, monitor, work)  # type: ignore[arg-type]

    def monte_carlo_batch(
        self, problem: AthansProblem, solution: Solution, policies: Sequence[str], seeds: Sequence[SeedSequence]
    ) -> tuple[dict, dict]:
        """Outcomes of a few runs of each policy, and the milliseconds of its decisions."""
        if not problem.takes_readings:
            return super().monte_carlo_batch(problem, solution, policies, seeds)
        from occontrol.families.athans.replanning.monte_carlo import simulated

        return simulated(problem, solution, policies, seeds)  # type: ignore[arg-type]

    def squared_error(self, problem: AthansProblem, estimate: Estimate, truth: Trajectory) -> float:
        """The objective's own: running and terminal squared error of a run with continuous sensing."""
        from occontrol.families.athans.replanning.continuous import charged
        from occontrol.families.flights import errors

        return charged(problem, errors(estimate, truth), estimate.times)  # type: ignore[arg-type]

    def paid(self, problem: AthansProblem, solution: Solution) -> float:
        """The observation cost of a plan as the objective weighs it."""
        from occontrol.families.athans.readings.ruled import WEIGHTS

        weight = WEIGHTS.get(problem.minimise, problem.cost_weight)  # type: ignore[attr-defined]
        return float(weight * getattr(solution.numbers, "observation_cost", 0.0))


def _nonlinear(problem: AthansProblem, what: str) -> bool:
    """Whether the plant is nonlinear; UsageError where `what` needs the initial covariance that it does not have."""
    if linearisation_of(problem) is None:
        return False
    refuse(problem, what)
    return True


def _renamed(options: PlainMapping) -> PlainDict:
    """The options of a filter in the words of a nonlinear one."""
    return {{"model": "estimator"}.get(name, name): value for name, value in options.items()}


def _labelled(problem: AthansProblem, solution: Solution) -> Solution:
    """The solution; of a nonlinear plant with the words that its certificate is of the linearised problem."""
    from occontrol.families.athans.nonlinear.label import labelled

    return labelled(problem, solution)


FAMILY = AthansFamily()
