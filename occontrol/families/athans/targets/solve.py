"""One method on a problem of many targets: relaxation, looks that are whole, certificate."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.kinds import PlainDict
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.baselines import Greedy, Random, RoundRobin
from occontrol.families.athans.found import STEPS_FOR_BOUND
from occontrol.families.athans.methods import Relaxed, RelaxRoundPolish
from occontrol.families.athans.targets.fill import Filled, fill
from occontrol.families.athans.targets.methods import CostateIndex, Information, LargestTrace
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.families.athans.targets.whole import ENOUGH, MOST_LOOKS, Whole, bound_whole, by_tree
from occontrol.scheduling.blocks import relaxation
from occontrol.scheduling.blocks.local_search import improve
from occontrol.scheduling.blocks.single import singles
from occontrol.scheduling.blocks.sweep import BlockSweep
from occontrol.scheduling.blocks.walk import CHANGE, INFORMATION, TRACE, Walk, charged_weight, random_looks, round_robin
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.rounding import roundings

MOST_SUBSTEPS = 16  # that are chosen where none are stated
MOST_WORK = 3e7  # blocks times steps, beyond which no finer steps are chosen
SEARCH = 8e7  # steps of a block of two states that the search may spend, at most so many times the open looks:
SEARCH_PER_LOOK = 3e4
LEAN = 30_000_000  # looks at blocks, beyond which their lists are dropped once laid out; a tenth where no search is
SEVERAL_STARTS, RANDOM_STARTS = 300, 5  # looks up to which there are several starts


@dataclass
class Task:
    """A problem on its way to a schedule.

    Parameters
    ----------
    filled : the problem as arrays
    sweep : over its blocks
    relaxed : the relaxation
    monitor : Monitor
    extra : what a method alone has to say
    whole : what is known about schedules of whole looks
    """

    filled: Filled
    sweep: BlockSweep
    relaxed: RelaxedOutcome
    monitor: Monitor
    extra: PlainDict = field(default_factory=dict)
    whole: Whole | None = None

    @cached_property
    def walk(self) -> Walk:
        """For the rules of thumb."""
        f = self.filled
        return Walk(f.groups, f.allowed, f.looks.price, f.steps, f.charges)


def solve(problem: TargetsProblem, method: Method, monitor: Monitor) -> Solution:
    """Run `method` on the problem's blocks and certify what it found.

    Parameters
    ----------
    problem : TargetsProblem
    method : an options object of families/athans/targets/methods.py
    monitor : Monitor
    """
    from occontrol.families.athans.targets.assembly import assemble

    began = stopwatch.seconds()
    gap = float(getattr(method, "relative_gap", 1e-4))
    filled, error = resolved(problem, gap, monitor)
    sweeps = isinstance(method, Relaxed | RoundRobin | Random)
    uses = sum(len(group.entry) for group in filled.groups)
    lean = (sweeps and uses > LEAN / 10) or (isinstance(method, RelaxRoundPolish) and uses > LEAN)
    task = relaxed_task(filled, gap, getattr(method, "max_iterations", STEPS_FOR_BOUND), monitor, lean)
    weights = _weights(task, method)
    return assemble(problem, method.name, task, weights, error, gap, began)


def relaxed_task(filled: Filled, gap: float, most: int, monitor: Monitor, lean: bool = False) -> Task:
    """The relaxation of a problem, to a gap or at most so many steps.

    Parameters
    ----------
    filled : the problem
    gap : relative
    most : steps
    monitor : Monitor
    lean : keep only what sweeps need: looks cannot be tried one by one afterwards
    """
    sweep = filled.sweep()
    if lean:
        filled.groups.clear()
        sweep.release()
        filled.groups.extend(lanes.group for lanes in sweep.lanes)
    monitor.stage = "relaxation"
    return Task(filled, sweep, relaxation.relax(sweep, filled.allowed, gap, most, monitor), monitor)


def resolved(problem: TargetsProblem, gap: float, monitor: Monitor) -> tuple[Filled, float]:
    """The problem with as many steps an interval as its accuracy asks for, and the estimated error of a cost.

    The steps are doubled until halving them once more changes the cost of a rounded policy by too little to matter.

    Parameters
    ----------
    problem : TargetsProblem
    gap : relative, of the method
    monitor : Monitor
    """
    stated = problem.integration.substeps
    filled = fill(problem, int(stated) if isinstance(stated, int) else 1)
    if stated is not None:
        return filled, np.nan
    target = problem.integration.target(gap)
    sweep = filled.sweep()
    rough = relaxation.relax(sweep, filled.allowed, max(0.02, gap), 60, monitor.child(silent=True))
    policy = filled.allowed.round(rough.weights)
    cost = sweep.cost(policy)
    while True:
        finer = fill(problem, 2 * filled.substeps)
        other = finer.sweep().cost(policy)
        error = 4 / 3 * abs(other - cost)
        blocks = sum(len(group) for group in filled.groups)
        enough = error <= target * abs(cost) or finer.substeps > MOST_SUBSTEPS
        if enough or blocks * len(finer.steps) > MOST_WORK or monitor.stop:
            return filled, error
        filled, cost = finer, other


def _weights(task: Task, method: Method) -> np.ndarray:
    """What the method makes of the relaxation, (E, 1)."""
    f, walk = task.filled, lambda kind, parts: task.walk.policy(kind, parts)
    task.monitor.stage = method.name
    if isinstance(method, Relaxed):
        return task.relaxed.weights
    if isinstance(method, RoundRobin):
        return round_robin(f.allowed, f.problem.targets * len(f.problem.resources))
    if isinstance(method, Random):
        return random_looks(f.allowed, method.seed)
    if isinstance(method, LargestTrace):
        return walk(TRACE, [charged_weight(group) for group in f.groups])
    if isinstance(method, Information):
        return walk(INFORMATION, [group.initial for group in f.groups])
    if isinstance(method, Greedy):
        return walk(CHANGE, task.walk.costates(np.zeros(f.allowed.shape)))
    if isinstance(method, CostateIndex):
        return walk(CHANGE, task.walk.costates(task.relaxed.weights))
    assert isinstance(method, RelaxRoundPolish)
    return _searched(task, method)


def _searched(task: Task, method: RelaxRoundPolish) -> np.ndarray:
    """The best of several roundings, the costate index and the price index, improved by exact changes, and the tree."""
    f, monitor = task.filled, task.monitor
    best = _improved(task, method)
    if near(task, best):
        return best
    task.whole = bound_whole(f, task.sweep, task.relaxed, task.sweep.cost(best), monitor, walk=True)
    if task.whole is None:
        return best
    if task.whole.weights is not None:
        found = _improved(task, method, [task.whole.weights])
        best = min((best, found), key=task.sweep.cost)
    task.whole = by_tree(f, task.sweep, task.relaxed, task.whole, best, monitor)
    if task.whole.weights is None:
        return best
    return min((best, task.whole.weights), key=task.sweep.cost)


def near(task: Task, weights: np.ndarray) -> bool:
    """Whether the relaxed bound lies so near the cost of a schedule (E, 1) that nothing more is asked.

    Parameters
    ----------
    task : Task
    weights : (E, 1) whole looks
    """
    cost = task.sweep.cost(weights)
    few = np.sum(task.filled.looks.target >= 0) <= MOST_LOOKS
    return cost - task.relaxed.lower_bound <= ENOUGH * abs(cost) and not few


def _improved(task: Task, method: RelaxRoundPolish, starts: list[np.ndarray] | None = None) -> np.ndarray:
    """The best of schedules (E, 1), those at hand if none are named, improved by exact single changes."""
    f, monitor = task.filled, task.monitor
    candidates = _at_hand(task) if starts is None else starts
    candidates.sort(key=task.sweep.cost)
    if not method.polish or monitor.stop or not sum(len(group.entry) for group in f.groups):
        return candidates[0]
    monitor.stage = "search"
    data = singles(f.groups, f.owners, f.problem.targets, f.steps, f.charges)
    work, looks, open_ = SEARCH, f.looks, f.allowed.shape[0]
    work = min(work, SEARCH_PER_LOOK * open_ * f.substeps)
    if starts is None and open_ <= SEVERAL_STARTS:  # a few looks have many local optima: several starts cost little
        order = round_robin(f.allowed, f.problem.targets * len(f.problem.resources))
        candidates += [order, *(random_looks(f.allowed, seed) for seed in range(RANDOM_STARTS))]
    else:
        candidates = candidates[:1]
    done = []
    for start in candidates:
        x, made = improve(
            start, f.allowed, looks.target, looks.resource, looks.price, data, work / len(candidates), monitor
        )
        done.append((task.sweep.cost(x), len(done), x))
        task.extra["changes"] = task.extra.get("changes", 0) + made
    return min(done)[2]


def _at_hand(task: Task) -> list[np.ndarray]:
    """Roundings of the relaxed optimum and the schedule of its costate index, (E, 1) each."""
    f = task.filled
    candidates = roundings(task.relaxed.weights, f.allowed)[:2]
    if len(f.steps) * sum(group.initial.size for group in f.groups) < 3e7:
        candidates.append(task.walk.policy(CHANGE, task.walk.costates(task.relaxed.weights)))
    return candidates


def interrupted(task: Task) -> Status:
    """The status of a relaxation, or that somebody has interrupted."""
    return Status.INTERRUPTED if task.monitor.interrupted else task.relaxed.status
