"""What the command line and the report say of a problem of readings and of its solution."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import Mistake, plural
from occontrol.core.printed import rounded_down
from occontrol.core.sensor import IDLE
from occontrol.core.solution import Solution, gap_words
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.result import AthansResult
from occontrol.families.athans.rules.prices import prices

MOST_SENSORS = 12  # of which one reading is described
RANK = 1e-9


def describe(problem: ReadingsProblem) -> list[tuple[str, str]]:
    """What `check` prints: sizes, when readings are taken, costs, deviations, an estimate of work.

    Parameters
    ----------
    problem : ReadingsProblem
    """
    clock, n, N = problem.clock, problem.states, problem.readings
    sensors = [s for s in problem.sensors if not s.is_idle]
    rows, least_most = sum(s.rows for s in sensors), problem.select
    epochs = len(problem.upper)
    every = f", a choice every {clock.epoch}" if clock.epoch > 1 else ""
    kind = "steps of discrete time" if problem.discrete else "readings of a continuous plant"
    varying = [".".join(map(str, path)) for path, signal in problem.signals.items() if not signal.constant]
    several = f"{least_most[0]} to {least_most[1]}" if least_most[0] != least_most[1] else f"{least_most[1]}"
    found = [
        ("sizes", f"{n} states, {plural(len(sensors), 'sensor')} with {rows} rows, {N} {kind}, {epochs} choices"),
        ("select", f"{several} at a time"),
        ("readings", f"at {clock.variable} = {clock.times[0]:g} .. {clock.times[-1]:g}{every}"),
        ("time-varying", ", ".join(varying[:6]) if varying else "nothing"),
    ]
    prices = np.column_stack([s.cost.sample(clock.times)[:, 0, 0] for s in problem.sensors])
    low, high = np.sum(np.min(prices, axis=1)), np.sum(np.max(prices, axis=1)) * least_most[1]
    found.append(("observation cost", f"{low:.6g} to {high:.6g}, times cost_weight {problem.cost_weight:g}"))
    for s in sensors[:MOST_SENSORS]:
        deviations = np.sqrt(np.maximum(np.diagonal(s.noise.at(float(clock.times[0]))), 0.0))
        shown = ", ".join(f"{d:.3g}" for d in deviations)
        found.append((f"reading of {s.name}", f"one reading has deviation {shown}: noise is its covariance"))
    open_ = [
        f"{s.name} {100 * float(np.mean(problem.upper[:, j])):.3g} %"
        for j, s in enumerate(problem.sensors)
        if s.windows is not None
    ]
    if open_:
        found.append(("availability", "inside windows: " + ", ".join(open_)))
    if problem.criterion is not None:
        found.append(("criterion", problem.criterion.text))
    if not problem.prior:
        found.append(("prior", "none: nothing is known before the readings"))
    if problem.budget is not None:
        found.append(("budget", ", ".join(f"{key} {value}" for key, value in problem.budget.items())))
    if problem.ruled:
        from occontrol.families.athans.readings.rules import frame_of
        from occontrol.families.athans.rules.text import describe_rules

        found += describe_rules(frame_of(problem), problem.minimise)
    flops = N * (4 * n**3 + 6 * n * n * max(1, problem.output.shape[0]) + 4 * rows * n)
    found.append(("work", f"about {flops / 1e6:.3g} Mflop a sweep, tens of sweeps"))
    return found


def summarise(problem: ReadingsProblem, solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    problem : ReadingsProblem
    solution : Solution
    """
    r: AthansResult = solution.numbers  # type: ignore[assignment]
    lines = [
        ("method", f"{solution.method}, {solution.iterations} iterations, {solution.seconds:.2f} s"),
        ("cost", f"{r.cost:.8g}"),
        (
            "lower bound",
            f"{rounded_down(r.lower_bound, 8)}   {gap_words(r.relative_gap, problem.logarithmic)}, "
            "for every schedule of these readings",
        ),
    ]
    if problem.criterion is not None and r.criterion is not None:
        lines.append(("criterion", f"{r.criterion:.8g}, {problem.criterion.text}"))
    lines += equivalence(r)
    if r.relaxed_lower_bound < r.lower_bound:
        lines.append(("relaxed bound", f"{rounded_down(r.relaxed_lower_bound, 8)}, which may split readings"))
    if r.constraints is not None:
        proven = "proven optimal" if r.proven_optimal else "not proven optimal"
        kept = f"rules kept, used up: {', '.join(r.constraints['active']) or 'none'}"
        lines.append(("search", f"{plural(r.nodes or 0, 'node')}, {proven}; {kept}"))
        lines += prices(r)
    observed = f"observation {r.observation_cost:.6g} x {r.cost_weight:g}"
    changed = f", changes {r.switching_cost:.6g}" if r.switching_cost else ""
    last = f"prediction {r.prediction_error:.6g}"
    if problem.measured and r.criterion is not None:
        last = f"criterion {r.criterion:.6g} (not in the cost)" if problem.capped else f"criterion {r.criterion:.6g}"
        last += f"; trace at the end {r.prediction_error:.6g}"
    lines.append(("parts", f"{observed}, running {r.running_cost:.6g}{changed}, {last}"))
    if solution.schedule is not None:
        used = np.sum(solution.schedule.weights, axis=0)
        counts = [
            f"{name} {count:.6g}"
            for name, count in zip(solution.schedule.names, used, strict=True)
            if name != IDLE and count > RANK
        ]
        lines.append(("readings", ", ".join(counts) or "none"))
    return lines


def equivalence(numbers: AthansResult) -> list[tuple[str, str]]:
    """The check of the General Equivalence Theorem for problems without a prior, in one line.

    Parameters
    ----------
    numbers : of a solution
    """
    check = numbers.extra.get("equivalence")
    if not isinstance(check, dict):
        return []
    if "used_save_at_least" not in check:
        return [("equivalence", f"the shares are within {check['excess']:.3g} of where no reading could do better")]
    used, others = check["used_save_at_least"], check["others_save_at_most"]
    text = f"every reading that the shares use saves {used:.6g} or more, every other {others:.6g} or less"
    return [("equivalence", f"{text} (at the optimum the second is not above the first)")]


def warnings_of(problem: ReadingsProblem) -> list[Mistake]:
    """Windows that hold no reading, and growing modes that no sensor sees.

    Parameters
    ----------
    problem : ReadingsProblem
    """
    letter = "F" if problem.discrete else "A"
    found = []
    for j, sensor in enumerate(problem.sensors):
        for what in problem.warnings:
            if f"of sensor '{sensor.name}'" in what:
                hint = f"windows are in {problem.clock.variable} of the horizon"
                found.append(Mistake(("sensors", j, "windows"), what, hint))
    plant, n = problem.plant, problem.states
    middle = float(problem.clock.times[problem.readings // 2])
    A = (plant.F if problem.discrete else plant.A).at(middle)
    rows = [s.C.at(middle) for j, s in enumerate(problem.sensors) if s.rows and np.any(problem.upper[:, j] > 0)]
    C = np.vstack([row / max(float(np.abs(row).max()), 1e-300) for row in rows]) if rows else np.zeros((0, n))
    scale = max(float(np.linalg.norm(A, 2)), 1e-300)
    lost = set()
    for value in np.linalg.eigvals(A):
        grows = abs(value) > 1 + RANK if problem.discrete else value.real > RANK * scale
        stacked = np.vstack([(A - value * np.eye(n)) / scale, C])
        if grows and np.linalg.svd(stacked, compute_uv=False)[-1] < RANK:
            lost.add(f"{abs(value) if problem.discrete else value.real:.4g}")
    if lost:
        what = f"not observable and unstable: no sensor sees a mode of the plant that grows ({', '.join(sorted(lost))})"
        hint = "its variance grows whatever the schedule; add a sensor that sees it"
        found.append(Mistake(("plant", letter), what, hint))
    return found
