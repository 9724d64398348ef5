"""What the command line and the report say of a problem and of a solution of the athans family."""

from __future__ import annotations

from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution, gap_words
from occontrol.families.athans.inspection import inspect
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import AthansResult, TopNumbers
from occontrol.families.athans.rules.prices import prices


def describe(problem: SchedulingProblem) -> list[tuple[str, str]]:
    """What `check` prints: sizes, costs, observability, an estimate of work.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    if not problem.ruled:
        return inspect(problem)
    from occontrol.families.athans.rules.setting import frame_of
    from occontrol.families.athans.rules.text import describe_rules

    return [*inspect(problem), *describe_rules(frame_of(problem), problem.minimise)]


def summarise(solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    solution : Solution
    """
    r: AthansResult = solution.numbers  # type: ignore[assignment]
    top = r.top or TopNumbers(r.cost, r.lower_bound, r.relative_gap, "grid")
    which = "whenever it switches" if top.of == "continuous" else "for schedules that change at these edges"
    lines = [
        ("method", f"{solution.method}, {solution.iterations} iterations, {solution.seconds:.2f} s"),
        ("cost", f"{top.cost:.8g}"),
        ("lower bound", f"{rounded_down(top.lower_bound, 8)}   {gap_words(top.relative_gap, top.absolute)}, {which}"),
    ]
    if top.of == "continuous":
        text = f"cost {r.cost:.8g}   bound {rounded_down(r.lower_bound, 8)}   {gap_words(r.relative_gap, top.absolute)}"
        lines.append(("on the grid", text))
    elif r.continuous is not None and r.continuous.reason:
        lines.append(("continuous", f"not computed: {r.continuous.reason.splitlines()[0]}"))
    if r.nodes is not None:
        proven = "proven optimal" if r.proven_optimal else "not proven optimal"
        kept = "" if r.constraints is None else f"; rules kept, used up: {', '.join(r.constraints['active']) or 'none'}"
        lines.append(("search", f"{r.nodes} node{'s' * (r.nodes != 1)}, {proven}{kept}"))
        lines += prices(r)
    changed = f", changes {r.switching_cost:.6g}" if r.switching_cost else ""
    observed = f"observation {r.observation_cost:.6g} x {r.cost_weight:g}"
    last = f"prediction {r.prediction_error:.6g}"
    if r.criterion is not None:
        last = f"criterion {r.criterion:.8g}; trace at the end {r.prediction_error:.6g}"
    parts = f"{observed}, running {r.running_cost:.6g}, {last}{changed}"
    lines.append(("parts", parts))
    singular = "" if r.singular_fraction is None else f"   singular on {100 * r.singular_fraction:.3g} % of the horizon"
    lines.append(("switches", f"{r.switches}{singular}"))
    return lines
