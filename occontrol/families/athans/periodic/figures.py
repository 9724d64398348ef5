"""Pictures of a cycle: its word round a clock face, deviations over one cycle, costs and bounds against the period,
bound against time, the way in from the initial covariance."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import BarContainer
from matplotlib.figure import Figure

from occontrol.core.printed import rounded_down
from occontrol.core.sensor import IDLE
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_labels
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.files.figures import style
from occontrol.files.figures.panels import curves_panel, legend, map_panel

MOST_WEDGES = 60  # of which each carries its step
INNER, RING = 0.45, 0.5
FORMAT = "{:.7g}"


def draw(problem: PeriodicProblem, solution: Solution) -> dict[str, Figure]:
    """Every figure of one solution.

    Parameters
    ----------
    problem : PeriodicProblem
    solution : Solution with a cycle

    Returns overview, cycle, deviations, periods, and, where there is one, proof and transient.
    """
    with style.house_style():
        figures = {
            "overview": _overview(problem, solution),
            "cycle": _one(problem, solution, _draw_word, (7.5, 7.5), polar=True),
            "deviations": _one(problem, solution, _draw_deviations, (12, 5.5)),
        }
        if len(solution.result.get("by_period") or {}) > 1:
            figures["periods"] = _one(problem, solution, _draw_periods, (10, 5.5))
        if len(_proof_history(solution)[0]) > 1:
            figures["proof"] = _one(problem, solution, _draw_proof, (10, 5.5))
        if "transient_covariance" in solution.arrays:
            figures["transient"] = _one(problem, solution, _draw_transient, (12, 5.5))
        return figures


def draw_compare(problem: PeriodicProblem, solutions: Mapping[str, Solution]) -> Figure:
    """Costs of several methods beside the best bound that any of them proved, and the mean over draws.

    Parameters
    ----------
    problem : PeriodicProblem
    solutions : Solution by method name
    """
    best = max(s.numbers.lower_bound for s in solutions.values())
    count = len(solutions)
    with style.house_style():
        text = f"line: no schedule costs less than {rounded_down(best, 7)} a {problem.per}"
        figure = style.new_figure((13.33, min(12.0, 2.4 + 0.7 * count)), problem.name, text)
        axes, places = figure.subplots(), np.arange(count)[::-1]
        costs = np.array([s.cost for s in solutions.values()])
        axes.barh(places, costs, height=0.6, color=style.ACCENT, alpha=0.85)
        for place, solution in zip(places, solutions.values(), strict=True):
            apart = f"{100 * (solution.cost - best) / abs(best):.3g} % above the bound" if best else ""
            mean = solution.result.get("mean_at_most")
            beside = f", in the mean at most {mean:.6g}" if mean is not None else ""
            axes.text(solution.cost, place, f" {solution.cost:.6g}  ({apart}{beside})", va="center", fontsize=10)
        axes.axvline(best, color=style.SECOND, lw=1.5)
        axes.set_yticks(places, list(solutions))
        axes.set_xlim(0, 1.6 * float(np.max(costs)) if np.max(costs) > 0 else None)
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel(f"cost a {problem.per}")
        return figure


def _subtitle(problem: PeriodicProblem, solution: Solution) -> str:
    r = solution.numbers
    bound = rounded_down(r.lower_bound, 7)
    pair = f"cost {r.cost:.7g} a {problem.per}, proven bound {bound}, gap {100 * r.relative_gap:.2g} %"
    return f"method {solution.method} · cycle of {r.period} · {pair}"


def _one(
    problem: PeriodicProblem,
    solution: Solution,
    panel: Callable[[Axes, PeriodicProblem, Solution], None],
    size: tuple[float, float],
    polar: bool = False,
) -> Figure:
    figure = style.new_figure(size, problem.name, _subtitle(problem, solution))
    panel(figure.subplots(subplot_kw={"projection": "polar"} if polar else None), problem, solution)
    return figure


def _overview(problem: PeriodicProblem, solution: Solution) -> Figure:
    figure = style.new_figure(style.SLIDE, problem.name, _subtitle(problem, solution))
    grid = figure.add_gridspec(2, 3, width_ratios=[1.35, 1.5, 0.85])
    _draw_word(figure.add_subplot(grid[:, 0], projection="polar"), problem, solution)
    _draw_deviations(figure.add_subplot(grid[0, 1:]), problem, solution)
    if len(solution.result.get("by_period") or {}) > 1:
        _draw_periods(figure.add_subplot(grid[1, 1]), problem, solution)
    elif len(_proof_history(solution)[0]) > 1:
        _draw_proof(figure.add_subplot(grid[1, 1]), problem, solution)
    text = figure.add_subplot(grid[1, 2])
    text.axis("off")
    text.text(0, 1, "certificate", fontweight="bold", fontsize=12, va="top")
    text.text(0, 0.9, "\n".join(_lines(problem, solution)), va="top", fontsize=11, linespacing=1.4)
    return figure


def _lines(problem: PeriodicProblem, solution: Solution) -> list[str]:
    r, bounds = solution.numbers, solution.result.get("bounds") or {}
    whom = "changes at multiples of the step" if problem.sensing == "rate" else "every schedule, periodic or not"
    lines = [f"status {solution.status}", whom, f"cost {r.cost:.7g}", f"proven bound {rounded_down(r.lower_bound, 7)}",
             f"gap {100 * r.relative_gap:.3g} %", ""]  # fmt: skip
    named = (("averaged", "averaged bound"), ("tree", f"proof, {r.leaves} words"))
    return lines + [f"{words}: {rounded_down(bounds[key], 7)}" for key, words in named if bounds.get(key) is not None]


def _draw_word(axes: Axes, problem: PeriodicProblem, solution: Solution) -> None:
    """The sensors of each step as wedges, clockwise from the top; several at a time share a wedge's width."""
    weights, names = solution.arrays["weights"], problem.sensors.names
    p = len(weights)
    colours = dict(zip(names, style.sensor_colours(names), strict=True))
    axes.set_theta_zero_location("N")  # type: ignore[attr-defined]
    axes.set_theta_direction(-1)  # type: ignore[attr-defined]
    shown: dict[str, BarContainer] = {}
    for k in range(p):
        used = [name for j, name in enumerate(names) if weights[k, j] > 0.5 and name != IDLE] or [IDLE]
        for i, name in enumerate(used):
            height = RING / len(used)
            bar = axes.bar(
                2 * np.pi * (k + 0.5) / p, height, width=2 * np.pi / p * (0.97 if p > 1 else 1.0),
                bottom=INNER + i * height, color=colours.get(name, style.GREY), lw=0,
            )  # fmt: skip
            shown.setdefault(name, bar)
        if p <= MOST_WEDGES:
            axes.text(2 * np.pi * (k + 0.5) / p, INNER + RING + 0.09, str(k), ha="center", va="center", fontsize=10)
    axes.set_ylim(0, INNER + RING + 0.15)
    axes.set_axis_off()
    what = f"{p} step{'s' * (p != 1)}" + ("" if problem.discrete else f"\n{p * problem.step:.4g} units of time")
    axes.text(0, 0, what, ha="center", va="center", fontsize=12)
    ordered = [name for name in names if name in shown] + [name for name in shown if name not in names]
    axes.legend(
        [shown[name] for name in ordered], [style.shorten(name) for name in ordered], loc="upper center",
        bbox_to_anchor=(0.5, 0.02), ncols=min(4, len(ordered)),
    )  # fmt: skip


def _draw_deviations(axes: Axes, problem: PeriodicProblem, solution: Solution) -> None:
    """Deviations over one cycle; with readings, just before and just after each."""
    priors, h, p = solution.arrays["prior_covariance"], problem.step, len(solution.arrays["weights"])
    before = np.sqrt(np.maximum(np.einsum("kii->ki", priors), 0.0))
    names = state_labels(problem)
    label = "step k" if problem.discrete else "time in the cycle"
    if problem.sensing == "rate":
        times, values, title = h * np.arange(p + 1), before, "at the changes"
    else:
        after = np.sqrt(np.maximum(np.einsum("kii->ki", solution.arrays["covariance"]), 0.0))
        both = np.stack([before[:-1], after], axis=1).reshape(2 * p, -1)
        times, values = np.append(np.repeat(h * np.arange(p), 2), h * p), np.vstack([both, before[-1:]])
        title = "before and after every reading"
    axes.set_title(f"standard deviations over one cycle, {title}")
    if problem.states <= style.MOST_LINES:
        curves_panel(axes, times, values, names, "deviation")
        axes.set_xlim(0, h * p)
    else:
        relative = before[:-1] / np.maximum(np.max(before, axis=0), 1e-300)
        map_panel(axes, h * np.arange(p + 1), relative, names, "share of its largest")
    axes.set_xlabel(label)


def _draw_periods(axes: Axes, problem: PeriodicProblem, solution: Solution) -> None:
    """The least cost of every length, and what is proven for all schedules."""
    listed = sorted((int(p), float(c)) for p, c in (solution.result["by_period"] or {}).items())
    periods, costs = np.array([p for p, _ in listed]), np.array([c for _, c in listed])
    r, bounds = solution.numbers, solution.result.get("bounds") or {}
    complete = int(solution.result.get("complete_to") or 0)
    all_ = periods <= complete
    axes.set_title("cost of the best cycle against its length")
    axes.plot(periods, costs, color=style.ACCENT, lw=0.8, alpha=0.5)
    axes.plot(periods[all_], costs[all_], "o", color=style.ACCENT, ms=5, label="best of all of this length")
    if not np.all(all_):
        axes.plot(periods[~all_], costs[~all_], "o", mfc="white", color=style.ACCENT, ms=5, label="best that was found")
    axes.axhline(r.lower_bound, color=style.SECOND, label=f"proven for all, {rounded_down(r.lower_bound, 6)}")
    averaged = bounds.get("averaged")
    lowest = r.lower_bound
    if averaged is not None and r.cost - averaged < 4 * (np.median(costs) - r.cost) + 20 * (r.cost - r.lower_bound):
        axes.axhline(averaged, color=style.GREY, ls="--", lw=1.2, label=f"averaged bound, {rounded_down(averaged, 6)}")
        lowest = averaged
    # cycles that are far from the best would flatten all others
    high = max(np.median(costs), r.cost + 0.5 * (r.cost - lowest))
    room = 0.12 * (high - lowest)
    axes.set_ylim(lowest - room, high + 3 * room)
    axes.set_xlabel("steps of the cycle")
    axes.set_ylabel(f"cost a {problem.per}")
    axes.grid(axis="y")
    axes.legend(loc="best", fontsize=9)


def _proof_history(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Seconds and relative gap of the proof's reports."""
    records = [r for r in solution.history if r.get("stage") == "proof" and np.isfinite(float(r["lower_bound"]))]
    gaps = [(float(r["cost"]) - float(r["lower_bound"])) / abs(float(r["cost"])) for r in records]
    return np.array([float(r["seconds"]) for r in records]), np.array(gaps)


def _draw_proof(axes: Axes, problem: PeriodicProblem, solution: Solution) -> None:
    """How the proof closed over time."""
    seconds, gaps = _proof_history(solution)
    axes.set_title("distance of the proven bound from the best cycle")
    axes.semilogy(seconds, np.maximum(100 * gaps, 1e-9), "o-", ms=4, color=style.SECOND)
    axes.set_xlabel("seconds")
    axes.set_ylabel("gap, %")
    axes.grid(axis="y", which="both")


def _draw_transient(axes: Axes, problem: PeriodicProblem, solution: Solution) -> None:
    """From the initial covariance into the cycle."""
    priors, h = solution.arrays["transient_covariance"], problem.step
    values = np.sqrt(np.maximum(np.einsum("kii->ki", priors), 0.0))
    times, steps = h * np.arange(len(priors)), solution.result.get("transient_steps")
    near = "" if steps is None else f": within 1 % of the cycle from step {steps} on"
    axes.set_title(f"standard deviations before each step, from the initial covariance{near}")
    if problem.states <= style.MOST_LINES:
        curves_panel(axes, times, values, state_labels(problem), "deviation")
    else:
        axes.semilogy(times, np.max(values, axis=1), color=style.ACCENT, label="largest")
        legend(axes, 1)
    if steps is not None:
        axes.axvline(steps * h, color=style.GREY, ls="--", lw=1)
    axes.set_xlabel("step k" if problem.discrete else "time")
