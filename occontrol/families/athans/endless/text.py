"""What the command line and the report say of many targets without an end."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import plural
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.families.athans.endless.problem import EndlessTargetsProblem
from occontrol.families.athans.result import AthansResult

WORST = 5


def describe(problem: EndlessTargetsProblem) -> list[tuple[str, str]]:
    """What `check` prints: targets, resources, the length of a look.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    """
    models, count = {group.model for group in problem.groups}, plural(len(problem.resources), "resource")
    sizes = f"{plural(problem.targets, 'target')} of {plural(len(models), 'model')}, n = {problem.states}, {count}"
    found = [("sizes", sizes), ("horizon", f"looks last {problem.step:g}, for ever")]
    for resource, looks in zip(problem.resources, problem.capacity, strict=True):
        found.append((f"resource {resource.name}", f"{plural(int(looks), 'look')} a step"))
    return found


def summarise(problem: EndlessTargetsProblem, solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    solution : Solution
    """
    r: AthansResult = solution.numbers  # type: ignore[assignment]
    bounds, gap = r.bounds or {}, f"gap {100 * r.relative_gap:.3g} %"
    lines = [
        ("method", f"{solution.method}, {solution.seconds:.2f} s"),
        ("cycle", plural(r.period or 0, "step")),
        ("cost", f"{r.cost:.8g} a unit of time"),
        ("lower bound", f"{rounded_down(r.lower_bound, 8)}   {gap}, for looks at multiples of {problem.step:g}"),
    ]
    if bounds.get("averaged") is not None:
        lines.append(("averaged bound", f"{rounded_down(bounds['averaged'], 8)}, whenever looks begin and end"))
    lines.append(("parts", f"observation {r.observation_cost:.6g} x {r.cost_weight:g}, running {r.running_cost:.6g}"))
    schedule = solution.schedule
    if isinstance(schedule, LookSchedule):
        steps = len(schedule.edges) - 1
        for i, name in enumerate(schedule.resources):
            mine, price = schedule.resource == i, solution.arrays["prices"][0, i]
            seen = plural(len(np.unique(schedule.target[mine])), "target")
            text = f"{np.sum(mine)} in {plural(steps, 'step')} at {seen}, price of one {price:.4g}"
            lines.append((f"looks of {name}", text))
        costs = solution.arrays["per_target_cost"]
        worst = np.argsort(-costs)[:WORST]
        lines.append(("dearest targets", ", ".join(f"{schedule.targets[i]} {costs[i]:.4g}" for i in worst)))
    return lines
