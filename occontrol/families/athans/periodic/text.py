"""What the command line and the report say of a problem without an end and of its solution."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import plural
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.result import AthansResult

MOST_SENSORS = 12
MOST_STEPS = 40  # of a word that is shown


def describe(problem: PeriodicProblem) -> list[tuple[str, str]]:
    """What `check` prints: sizes, clock, choices, prices, deviations.

    Parameters
    ----------
    problem : PeriodicProblem
    """
    sensors, (least, most) = [s for s in problem.sensors if not s.is_idle], problem.select
    kinds = {
        "steps": "steps of discrete time, for ever",
        "samples": f"a reading every {problem.step:g}, for ever",
        "rate": f"continuous sensing for ever, changes at multiples of {problem.step:g}",
    }
    rows = sum(s.rows for s in sensors)
    prices = [float(s.cost.at(0.0)[0, 0]) for s in sensors]
    found = [
        ("sizes", f"{plural(problem.states, 'state')}, {plural(len(sensors), 'sensor')} with {rows} rows"),
        ("horizon", kinds[problem.sensing]),
        ("select", f"{least} to {most} at a time" if least < most else f"{most} at a time"),
        ("choices", f"{len(problem.choices)} at every step"),
        ("observation cost", f"{min(prices):.6g} to {max(prices):.6g}, times cost_weight {problem.cost_weight:g}"),
    ]
    if problem.repeat is not None:
        found.insert(2, ("windows", f"come again every {problem.repeat:g}, {plural(problem.phases, 'step')}"))
    for s in sensors[:MOST_SENSORS]:
        shown = ", ".join(f"{d:.3g}" for d in np.sqrt(np.diagonal(s.noise.at(0.0))))
        rate = f"noise is an intensity, its root is {shown}"
        reading = f"one reading has deviation {shown}: noise is its covariance"
        found.append((f"sensor {s.name}", rate if problem.sensing == "rate" else reading))
    return found


def summarise(problem: PeriodicProblem, solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    problem : PeriodicProblem
    solution : Solution
    """
    r: AthansResult = solution.numbers  # type: ignore[assignment]
    bounds, word = r.bounds or {}, r.word or []
    shown = " ".join(word[:MOST_STEPS]) + (" .." if len(word) > MOST_STEPS else "")
    proof = f", {plural(r.nodes, 'word')} of a proof" if r.nodes else ""
    lines = [
        ("method", f"{solution.method}{proof}, {solution.seconds:.2f} s"),
        ("cycle", f"{shown}   ({plural(len(word), 'step')})"),
        ("cost", f"{r.cost:.8g} a {problem.per}"),
        ("lower bound", f"{rounded_down(r.lower_bound, 8)}   gap {100 * r.relative_gap:.3g} %, {_for_whom(problem)}"),
    ]
    if bounds.get("averaged") is not None:
        shares = ", ".join(f"{name} {100 * x:.3g} %" for name, x in (r.shares or {}).items())
        lines.append(("averaged bound", f"{rounded_down(bounds['averaged'], 8)}, of sensors used in shares: {shares}"))
    if solution.result.get("mean_at_most") is not None:
        lines.append(
            ("mean", f"{solution.result['mean_at_most']:.8g} at most over all draws; the cost is that of this one")
        )
    if bounds.get("tree") is not None:
        words = plural(r.leaves or 0, "word")
        lines.append(("proof", f"{rounded_down(bounds['tree'], 8)} by {words} that stand for all schedules"))
    if r.continuous is not None and r.continuous.cost is not None:
        gap = f"gap {100 * float(r.continuous.relative_gap or 0.0):.3g} %, whenever it switches"
        bound = rounded_down(r.continuous.lower_bound, 8)
        lines.append(("continuous", f"cost {r.continuous.cost:.8g}   bound {bound}   {gap}"))
    lines.append(("parts", f"observation {r.observation_cost:.6g} x {r.cost_weight:g}, running {r.running_cost:.6g}"))
    return lines


def _for_whom(problem: PeriodicProblem) -> str:
    if problem.sensing == "rate":
        kept = "" if problem.repeat is None else " and keep to the windows"
        return f"for schedules that change at multiples of {problem.step:g}{kept}"
    return "for every schedule, periodic or not" + ("" if problem.repeat is None else ", that keeps to the windows")
