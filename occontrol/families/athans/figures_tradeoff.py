"""Pictures of a trade-off: the front of observation cost against error above its bound, and the schedules along it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.families.athans.tradeoff import Front
from occontrol.files.figures import style


def draw(front: Front) -> dict[str, Figure]:
    """Every figure of one front.

    Parameters
    ----------
    front : Front

    Returns front and schedules.
    """
    with style.house_style():
        return {"front": _front(front), "schedules": _schedules(front)}


def _front(front: Front) -> Figure:
    gaps = (front.schedules.cost - front.lower_bound) / np.abs(front.schedules.cost)
    where = {"continuous": "", "grid": " on this grid", "problem": " of these readings"}[front.of]
    of = ", linearised" if linearisation_of(front.problem) is not None else ""
    subtitle = f"{len(gaps)} cost weights; no schedule{where} lies in the shaded region{of}"
    figure = style.new_figure((13.33, 6.8), front.problem.name, subtitle)
    left, right = figure.subplots(1, 2, width_ratios=[2, 1])
    q, e = front.schedules.observation_cost, front.schedules.error
    room = 0.05 * (np.max(q) - np.min(q) or 1.0)
    along = np.linspace(max(0.0, np.min(q) - room), np.max(q) + room, 800)
    bound = front.least_error(along)
    left.fill_between(along, 0, bound, color=style.PALE, lw=0)
    left.plot(along, bound, color=style.SECOND, lw=1.4, label="lower bound")
    left.plot(q, e, "o", color=style.ACCENT, ms=6, label="schedules")
    low = float(np.min(e[e > 0], initial=np.inf))
    if np.isfinite(low) and np.max(e) > 30 * low:
        left.set_yscale("log")
        left.set_ylim(bottom=0.6 * low)
    else:
        left.set_ylim(bottom=0)
    seen: list[tuple[float, float]] = []
    for alpha, x, y in zip(front.cost_weights, q, e, strict=True):
        if all(abs(x - u) > 0.04 * np.ptp(q) or abs(y - v) > 0.04 * np.ptp(e) for u, v in seen):
            left.annotate(f"{alpha:.2g}", (x, y), (5, 5), textcoords="offset points", fontsize=8, color="#666666")
            seen.append((x, y))
    running = " + running cost" if front.problem.running is not None else ""
    spent = "Σ q v" if front.of == "problem" else "∫ Σ q v dt"
    left.set_xlabel(f"observation cost  {spent}   (numbers: cost weight α)")
    left.set_ylabel(f"prediction error  tr(W Σ(T)){running}")
    left.legend(loc="upper right")
    left.grid()
    right.plot(front.cost_weights, 100 * np.maximum(gaps, 0), "o-", color=style.ACCENT, ms=4)
    right.set_xscale("log")
    right.set_ylim(bottom=0)
    right.set_xlabel("cost weight α")
    right.set_ylabel("proven gap of the schedule, %")
    right.grid()
    return figure


def _schedules(front: Front) -> Figure:
    """One row per alpha: who measures when."""
    count, names = len(front.cost_weights), front.problem.sensors.names
    figure = style.new_figure((13.33, min(10.0, 2.4 + 0.34 * count)), front.problem.name, "schedules along the front")
    axes = figure.subplots()
    colours = style.sensor_colours(names)
    for row, weights in enumerate(front.schedules.weights):
        _row(axes, front, weights, row, colours)
    axes.set_yticks(range(count), [f"{alpha:.2g}" for alpha in front.cost_weights], fontsize=9)
    axes.set_ylabel("cost weight α")
    axes.set_ylim(-0.6, count - 0.4)
    axes.tick_params(axis="y", length=0)
    edges = front.problem.edges
    style.tidy_time_axis(axes, float(edges[0]), float(edges[-1]))
    if front.problem.discrete:
        axes.set_xlabel("step k")
    used = [j for j in range(len(names)) if np.any(front.schedules.weights[:, :, j] > 0)]
    if len(set(colours)) > 2 or len(names) <= 3:
        handles = [Patch(color=colours[j], label=style.shorten(names[j])) for j in used]
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.3)
    return figure


def _row(axes: Axes, front: Front, weights: np.ndarray, row: int, colours: list[str]) -> None:
    """The sensors of one schedule, stacked where several are in use."""
    edges = front.problem.edges
    height = 0.8 / front.problem.places
    base = np.full(len(weights), row - 0.4)
    for j, colour in enumerate(colours):
        top = base + height * weights[:, j]
        if np.any(weights[:, j] > 0):
            low, high = np.append(base, base[-1]), np.append(top, top[-1])
            axes.fill_between(edges, low, high, step="post", color=colour, lw=0, alpha=0.95)
        base = top
