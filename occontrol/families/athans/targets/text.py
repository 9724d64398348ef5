"""What the command line and the report say of a problem of many targets and of its solution."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import Mistake, plural
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.families.athans.result import AthansResult
from occontrol.families.athans.targets.problem import TargetsProblem

NANOSECONDS = 3.0  # that a block costs in every step, for each square of its states plus one; measured, one thread
WORST = 5


def describe(problem: TargetsProblem) -> list[tuple[str, str]]:
    """What `check` prints: targets, resources, blocks, memory, the time of a sweep.

    Parameters
    ----------
    problem : TargetsProblem
    """
    from occontrol.families.athans.targets.fill import fill

    filled = fill(problem)
    sizes: dict[int, int] = {}
    for group in filled.groups:
        sizes[group.states] = sizes.get(group.states, 0) + len(group)
    blocks = ", ".join(f"{count} of {plural(n, 'state')}" for n, count in sorted(sizes.items()))
    looks = filled.allowed.shape[0] - len(filled.allowed.capacity)
    possible = problem.targets * len(problem.resources) * problem.intervals
    nanoseconds = sum(len(g) * len(filled.steps) * NANOSECONDS * (g.states + 1) ** 2 for g in filled.groups)
    memory = filled.sweep(threads=1).bytes + 6 * 8 * filled.allowed.shape[0]
    models = {group.model for group in problem.groups}
    found = [
        (
            "sizes",
            f"{plural(problem.targets, 'target')} of {plural(len(models), 'model')}, n = {problem.states}, "
            f"{plural(len(problem.resources), 'resource')}, {plural(problem.intervals, 'interval')}",
        ),
        ("blocks", f"{sum(sizes.values())} blocks: {blocks}"),
        ("looks", f"{looks} may be taken, {100 * looks / possible:.3g} % of all pairs and intervals"),
    ]
    for resource in problem.resources:
        low, high = int(np.min(resource.capacity)), int(np.max(resource.capacity))
        several = f"{low} to {high} looks" if low != high else plural(high, "look")
        closed = 100 * float(np.mean(resource.capacity == 0))
        shut = f", closed {closed:.3g} %" if closed else ""
        found.append((f"resource {resource.name}", f"{several} an interval{shut}"))
    text = f"a sweep about {nanoseconds / 1e6:.3g} ms on one processor, memory about {memory / 1e6:.3g} MB"
    found.append(("work", text))
    return found


def summarise(problem: TargetsProblem, solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    problem : TargetsProblem
    solution : Solution
    """
    r: AthansResult = solution.numbers  # type: ignore[assignment]
    lines = [
        ("method", f"{solution.method}, {solution.iterations} iterations, {solution.seconds:.2f} s"),
        ("cost", f"{r.cost:.8g}"),
        (
            "lower bound",
            f"{rounded_down(r.lower_bound, 8)}   gap {100 * r.relative_gap:.3g} %, "
            "for schedules that change at these edges",
        ),
    ]
    if r.bounds is not None and r.bounds.get("integer") is not None:
        relaxed, integer = (rounded_down(r.bounds[key], 8) for key in ("relaxed", "integer"))
        lines.append(("bounds", f"relaxed {relaxed}, of whole looks {integer}"))
    observed = f"observation {r.observation_cost:.6g} x {r.cost_weight:g}"
    lines.append(("parts", f"{observed}, running {r.running_cost:.6g}, prediction {r.prediction_error:.6g}"))
    if r.continuous is not None:
        known = r.continuous.cost
        lines.append(("continuous", f"{known:.8g}" if known is not None else str(r.continuous.reason)))
    schedule = solution.schedule
    if isinstance(schedule, LookSchedule):
        for i, name in enumerate(schedule.resources):
            mine = schedule.resource == i
            seen = len(np.unique(schedule.target[mine]))
            lines.append((f"looks of {name}", f"{np.sum(schedule.share[mine]):.6g} at {plural(seen, 'target')}"))
        costs = solution.arrays.get("per_target_cost")
        if costs is not None and len(costs) > 1:
            worst = np.argsort(-costs)[:WORST]
            listed = ", ".join(f"{schedule.targets[i]} {costs[i]:.4g}" for i in worst)
            lines.append(("dearest targets", listed))
    return lines


def priced_by(solution: Solution) -> str:
    """What the prices of looks in a solution come from.

    Parameters
    ----------
    solution : Solution of a problem of targets
    """
    bounds = getattr(solution.numbers, "bounds", None) or {}
    integer = bounds.get("integer")
    return "the bound on whole looks" if integer is not None and integer > bounds["relaxed"] else "the relaxed optimum"


def warnings_of(problem: TargetsProblem) -> list[Mistake]:
    """Targets that no resource ever sees.

    Parameters
    ----------
    problem : TargetsProblem
    """
    unseen = np.flatnonzero(~problem.seen)
    if not len(unseen):
        return []
    names = problem.target_names
    listed = ", ".join(f"'{names[i]}'" for i in unseen[:5]) + (", .." if len(unseen) > 5 else "")
    what = f"{plural(len(unseen), 'target')} {'is' if len(unseen) == 1 else 'are'} never seen: {listed}"
    return [Mistake(("targets",), what, "give looks and windows that cover whole intervals, or leave the targets out")]
