"""What the command line and the report say of a problem and of a solution of the athans family."""

from __future__ import annotations

from occontrol.core.solution import Solution
from occontrol.families.athans.inspection import inspect
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import AthansResult


def describe(problem: SchedulingProblem) -> list[tuple[str, str]]:
    """What `check` prints: sizes, costs, observability, an estimate of work.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    return inspect(problem)


def summarise(solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    solution : Solution
    """
    r: AthansResult = solution.numbers  # type: ignore[assignment]
    lines = [
        ("method", f"{solution.method}, {solution.iterations} iterations, {solution.seconds:.2f} s"),
        ("cost", f"{r.cost:.8g}"),
        ("lower bound", f"{r.lower_bound:.8g}   gap {100 * r.relative_gap:.3g} %"),
    ]
    c = r.continuous
    if c is not None:
        text = f"cost {c.cost:.8g}   bound {c.lower_bound:.8g}   gap {100 * c.relative_gap:.3g} %"
        lines.append(("continuous", text))
    observed = f"observation {r.observation_cost:.6g} x {r.cost_weight:g}"
    lines.append(("parts", f"{observed}, running {r.running_cost:.6g}, prediction {r.prediction_error:.6g}"))
    singular = f"singular on {100 * r.singular_fraction:.3g} % of the horizon"
    lines.append(("switches", f"{r.switches}   {singular}"))
    return lines
