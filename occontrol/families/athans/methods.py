"""The methods of the athans family as values: each a frozen dataclass of its own options that checks and runs itself.

`run` imports what it needs when it is called: to read a problem file nothing is compiled. The baselines stand in
families/athans/baselines.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, ClassVar

from occontrol.core.errors import Mistake, ProblemError, suggest
from occontrol.core.method import check_options
from occontrol.core.solution import Status
from occontrol.families.athans.baselines import BestSingle, Greedy, Random, RoundRobin
from occontrol.families.athans.periodic.method import Periodic, Shares

if TYPE_CHECKING:
    from occontrol.core.monitor import Monitor
    from occontrol.families.athans.base import AthansProblem
    from occontrol.families.athans.found import Found
    from occontrol.families.athans.problem import SchedulingProblem
    from occontrol.scheduling.feasible_set import FeasibleSet
    from occontrol.scheduling.sweep import Sweep

__all__ = [
    "BestSingle", "Collocation", "Exact", "Greedy", "HMinimal", "Periodic", "Random", "RelaxRoundPolish", "Relaxed",
    "RoundRobin", "Shares",
]  # fmt: skip

KICK_SWEEPS = 4  # times the sweeps that the first polish of readings took: by those its kicks are budgeted
POLISH_SWEEPS = 4  # sweeps of the shaken polish for each of the relaxation's, which cost more
STARTS = {"best-single": BestSingle, "round-robin": RoundRobin, "greedy": Greedy, "random": Random}
_POSITIVE = ("relative_gap", "time_limit")
_END = {
    "stationary": "The policy minimises the Hamiltonian on every interval.",
    "no-descent": "No partial step lowers the cost; where arcs are singular a switching policy can only chatter.",
    "cycle": "The plain full-step sweep repeats itself; use full_step: false.",
    "limit": "max_iterations came first.",
    "interrupted": "Interrupted; this is the best so far.",
}


@dataclass(frozen=True)
class Relaxed:
    """The convex relaxation alone: fractional weights, certified.

    Parameters
    ----------
    relative_gap : target of (J - bound)/|J|, > 0
    max_iterations : steps
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "relaxed"
    relative_gap: float = 1e-4
    max_iterations: int = 3000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        check_options(self, positive=_POSITIVE, whole={"max_iterations": 1})

    def check(self, problem: SchedulingProblem) -> Sequence[Mistake]:
        """Nothing: it fits every problem."""
        return ()

    def run(self, problem: SchedulingProblem, sweep: Sweep, feasible_set: FeasibleSet, monitor: Monitor) -> Found:
        """The relaxed optimum."""
        from occontrol.families.athans.found import relax

        found = relax(sweep, feasible_set, monitor, self.relative_gap, self.max_iterations)
        found.proves = True
        return found


@dataclass(frozen=True)
class Exact:
    """A search for the proven optimum.

    Parameters
    ----------
    relative_gap : of schedule and bound, at which it ends
    max_nodes : of the tree
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "exact"
    relative_gap: float = 1e-6
    max_nodes: int = 2000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        check_options(self, positive=_POSITIVE, whole={"max_nodes": 1})


@dataclass(frozen=True)
class RelaxRoundPolish:
    """The default: relax, round, polish on the true cost, certify.

    Parameters
    ----------
    relative_gap : target of the relaxation
    max_iterations : steps of the relaxation
    polish : rounds of exact single exchanges after rounding, 0 is none
    time_limit : seconds, None is no limit
    branch_first, strengthen : tighter bounds for readings, by fixing first choices and by noise extraction; None is
        where they pay
    exact : whether to search on for the proven optimum: true, or {relative_gap, max_nodes, time_limit}
    off_grid : whether the switch times of a schedule with rules are moved off the grid in the end
    """

    name: ClassVar[str] = "schedule"
    relative_gap: float = 1e-4
    max_iterations: int = 3000
    polish: int = 200
    time_limit: float | None = None
    branch_first: bool | None = None
    strengthen: bool | None = None
    exact: bool | dict[str, float] | None = None
    off_grid: bool = False

    def __post_init__(self) -> None:
        check_options(self, positive=_POSITIVE, whole={"max_iterations": 1, "polish": 0})
        _ = self.exact_options

    @property
    def exact_options(self) -> Exact | None:
        """`exact` as options; ProblemError for those that there are not."""
        if self.exact is None or isinstance(self.exact, bool):
            return Exact() if self.exact else None
        known = [f.name for f in fields(Exact)]
        wrong = [key for key in self.exact if key not in known]
        if wrong:
            raise ProblemError(Mistake(("exact", wrong[0]), f"unknown option '{wrong[0]}'", suggest(wrong[0], known)))
        values: dict = dict(self.exact)
        nodes = values.get("max_nodes")
        if isinstance(nodes, float) and nodes.is_integer():
            values["max_nodes"] = int(nodes)
        try:
            return Exact(**values)
        except ProblemError as error:
            raise ProblemError([m.under("exact") for m in error.mistakes]) from None

    def check(self, problem: AthansProblem) -> Sequence[Mistake]:
        """Options of readings for a problem of continuous sensing."""
        stated = [name for name in ("branch_first", "strengthen") if getattr(self, name) is not None]
        hint = "sensing: samples, or horizon: {steps: ..}"
        if problem.takes_readings:
            what = "off_grid moves the switch times of continuous sensing, readings have instants of their own"
            return [Mistake(("off_grid",), what, "without off_grid", key=True)] if self.off_grid else []
        return [Mistake((name,), f"{name} is for readings at instants", hint, key=True) for name in stated]

    def run(self, problem: SchedulingProblem, sweep: Sweep, feasible_set: FeasibleSet, monitor: Monitor) -> Found:
        """The best of several roundings of the relaxed optimum, polished."""
        from occontrol.families.athans.found import relax
        from occontrol.families.athans.integration.polish import Repolish, polish_for
        from occontrol.families.athans.integration.priced import Judged, in_terms_of, judge_of
        from occontrol.scheduling.baselines import greedy
        from occontrol.scheduling.hminimal import polish
        from occontrol.scheduling.rounding import roundings
        from occontrol.scheduling.shaking import kick, shake

        found = relax(sweep, feasible_set, monitor, self.relative_gap, self.max_iterations)
        found.proves = True
        monitor.stage = "rounding"
        # none of the roundings is the best on every problem, and a polish costs a fraction of the relaxation
        readings = sweep.recursion.charge is not None
        further = [greedy(sweep.recursion, feasible_set)] if readings else []
        candidates = sorted([*roundings(found.weights, feasible_set), *further], key=sweep.cost)
        found.weights, relaxed = candidates[0], found.relaxed
        if self.polish and not monitor.stop:
            # with a running weight a polish is slow: the best start alone, but for readings, of which there are few
            exact = sweep.foresees_exchanges and not sweep.dense
            starts = candidates if exact or readings else candidates[:1]
            before = sweep.forward_count
            done = [polish(sweep, feasible_set, start, self.polish, monitor) for start in starts]
            polished = sweep.forward_count - before
            best, judge = min(done, key=lambda o: o.cost), judge_of(sweep)
            if relaxed is not None:
                inner = in_terms_of(sweep, relaxed)
                if exact and best.end == "stationary":
                    enough = inner.lower_bound + self.relative_gap * abs(relaxed.cost + best.cost - inner.cost)
                    spent = POLISH_SWEEPS * inner.sweeps["gradients"]
                    best = shake(sweep, feasible_set, best, enough, spent, self.polish, monitor)
                if readings and best.end == "stationary":
                    enough = relaxed.lower_bound + self.relative_gap * abs(best.cost)
                    best = kick(sweep, feasible_set, best, enough, KICK_SWEEPS * polished, self.polish, monitor)
                if isinstance(judge, Judged):
                    offset = relaxed.cost - inner.cost
                    options = Repolish(self.relative_gap, self.polish)
                    best = polish_for(judge, feasible_set, [o.weights for o in done], best, offset, options, monitor)
            found.weights, found.extra["polish_rounds"] = best.weights, best.iterations
            if best.end == "interrupted":
                found.status = Status.INTERRUPTED
        return found


@dataclass(frozen=True)
class HMinimal:
    """Kelley's H-minimal sweep with partial steps; `full_step` is the plain method, which may cycle.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    max_iterations : sweeps
    full_step : replace the policy everywhere at once (epsilon = 1 always)
    tolerance : stop when the predicted decrease is below this share of |J|
    start : "best-single", "round-robin", "greedy", "random": the first guess
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "hminimal"
    relative_gap: float = 1e-4
    max_iterations: int = 3000
    full_step: bool = False
    tolerance: float = 1e-9
    start: str = "best-single"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        whole, starts = {"max_iterations": 1}, {"start": tuple(STARTS)}
        check_options(self, positive=_POSITIVE, at_least={"tolerance": 0}, whole=whole, one_of=starts)

    def check(self, problem: SchedulingProblem) -> Sequence[Mistake]:
        """Nothing: it fits every problem."""
        return ()

    def run(self, problem: SchedulingProblem, sweep: Sweep, feasible_set: FeasibleSet, monitor: Monitor) -> Found:
        """Where the sweep ended, with the relaxation whose bound stands beside it."""
        from occontrol.families.athans.found import relax
        from occontrol.families.athans.integration.priced import judge_of
        from occontrol.scheduling.hminimal import h_minimal

        found = relax(sweep, feasible_set, monitor, self.relative_gap, self.max_iterations)
        first, judge = STARTS[self.start]().policy(sweep, feasible_set), judge_of(sweep)
        done = h_minimal(judge, feasible_set, first, self.max_iterations, self.tolerance, self.full_step, monitor)
        found.weights, found.iterations, found.bound = done.weights, done.iterations, done.lower_bound
        found.extra["end"] = done.end
        found.message = _END[done.end]
        if done.end == "interrupted":
            found.status = Status.INTERRUPTED
        return found


@dataclass(frozen=True)
class Collocation:
    """Ipopt direct collocation of the relaxed problem: the independent judge for small problems, not the engine.

    Parameters
    ----------
    relative_gap : target of (J - bound)/|J| for its policy under the common recursion
    scheme : "radau" or "legendre"
    stages : collocation points per element
    max_iterations : of Ipopt
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "collocation"
    relative_gap: float = 1e-4
    scheme: str = "radau"
    stages: int = 3
    max_iterations: int = 300
    time_limit: float | None = None

    def __post_init__(self) -> None:
        whole = {"stages": 1, "max_iterations": 1}
        check_options(self, positive=_POSITIVE, whole=whole, one_of={"scheme": ("radau", "legendre")})

    def check(self, problem: SchedulingProblem) -> Sequence[Mistake]:
        """Nothing: it fits every problem, though it is slow for many states."""
        return ()

    def run(self, problem: SchedulingProblem, sweep: Sweep, feasible_set: FeasibleSet, monitor: Monitor) -> Found:
        """Ipopt's policy; `sweep` plays no part in finding it."""
        from occontrol.families.athans.collocation.solve import solve_collocation
        from occontrol.families.athans.found import Found

        monitor.stage = "collocation"
        raw = solve_collocation(problem, self, monitor)
        found = Found(raw.weights, raw.iterations, raw.status, raw.message, target=self.relative_gap)
        found.extra["collocation_cost"] = float(raw.cost)
        return found


METHODS: dict[str, type] = {
    m.name: m for m in (RelaxRoundPolish, HMinimal, Relaxed, Collocation, BestSingle, RoundRobin, Random, Greedy)
}

# an infinite horizon has this one alone, the others end
ALL_METHODS: dict[str, type] = {**METHODS, Periodic.name: Periodic, Shares.name: Shares}
