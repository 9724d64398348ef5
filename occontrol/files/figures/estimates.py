"""Pictures of a filter run: states with their bands, the prediction of w closing in, NIS and NEES."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.measurement import Estimate
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.core.state_labels import default_names, state_labels
from occontrol.core.trajectory import Trajectory
from occontrol.files.figures import style
from occontrol.files.figures.axes import value_axis
from occontrol.numerics.consistency import average_band, judge_run

MOST_STATES, MOST_OUTPUTS = 48, 12
GROUPS = 60  # points of the averaged NIS


def draw(problem, solution: Solution, estimate: Estimate, truth: Trajectory | None = None) -> dict[str, Figure]:
    """Every figure of one filter run.

    Parameters
    ----------
    problem : the problem that the run belongs to
    solution : Solution whose schedule was followed
    estimate : Estimate, one row per node
    truth : true states at the same times, where they are known

    Returns estimates, prediction (where something is predicted that is not known) and consistency.
    """
    with style.house_style():
        figures = {"estimates": _estimates(problem, solution.schedule, estimate, truth)}
        if np.any(estimate.predicted_deviation > 0):
            figures["prediction"] = _prediction(problem, solution.schedule, estimate)
        figures["consistency"] = _consistency(problem, estimate, truth)
        return figures


def _estimates(problem, schedule: Schedule | None, estimate: Estimate, truth: Trajectory | None) -> Figure:
    """Error with a known truth, the estimate itself otherwise, each with +-2 sigma."""
    n = estimate.mean.shape[1]
    shown, names = min(n, MOST_STATES), state_labels(problem)
    names = names if len(names) == n else default_names(n)
    rows, columns = style.grid_of(shown)
    what = "error of the estimate" if truth is not None else "estimate"
    subtitle = f"{what} with its ±2σ band" + (f"; the first {shown} of {n} states" if shown < n else "")
    subtitle += _about_passes(problem)
    height = 2.0 + rows * (1.75 if rows <= 4 else 1.3)
    figure = style.new_figure((13.33, height), problem.name, subtitle)
    panels = np.atleast_1d(figure.subplots(rows, columns, sharex=True)).reshape(rows, columns).T.ravel()
    for i, axes in enumerate(panels):
        if i >= shown:
            axes.set_visible(False)
            continue
        band = 2 * estimate.standard_deviation[:, i]
        if truth is None:
            middle, line = estimate.mean[:, i], estimate.mean[:, i]
        else:
            middle, line = np.zeros(len(band)), estimate.mean[:, i] - truth.values[:, i]
        axes.fill_between(estimate.times, middle - band, middle + band, color=style.PALETTE[4], alpha=0.35, lw=0)
        axes.plot(estimate.times, line, color=style.ACCENT, lw=1.2)
        if truth is not None:
            axes.axhline(0, color=style.GREY, lw=0.6)
        axes.set_ylabel(("error of " if truth is not None else "") + names[i])
        _zoom(axes, middle, band)
        _passes(axes, problem, schedule)
        last = i == shown - 1 or (i + 1) % rows == 0
        _time_axis(axes, problem, estimate, last)
    return figure


def _time_axis(axes: Axes, problem, estimate: Estimate, label: bool) -> None:
    """Time t, or the step k of a problem in discrete time."""
    start, end = float(estimate.times[0]), float(estimate.times[-1])
    if isinstance(getattr(problem, "steps", None), int):
        style.step_axis(axes, max(int(end), 1), label)
        style.dot_if_alone(axes)
    else:
        style.tidy_time_axis(axes, start, end, label)


def _zoom(axes: Axes, middle: np.ndarray, band: np.ndarray) -> None:
    """The vertical axis after the first transient: a wide start would flatten all that follows."""
    settled = float(np.quantile(band, 0.8))
    if np.max(band) > 8 * settled > 0:
        low, high = np.min(middle - settled), np.max(middle + settled)
        room = 0.6 * (high - low)
        axes.set_ylim(low - room, high + room)


def _about_passes(problem) -> str:
    windowed = any(getattr(s, "windows", None) for s in getattr(problem, "sensors", ()))
    return "; grey: a sensor is available, marks at the foot: one is in use" if windowed else ""


def _passes(axes: Axes, problem, schedule: Schedule | None) -> None:
    """Pale stripes where some sensor with windows may be used, ticks where one is in use."""
    sensors = getattr(problem, "sensors", ())
    windows = [w for s in sensors for w in (getattr(s, "windows", None) or ())]
    for start, end in windows:
        axes.axvspan(start, end, color=style.PALE, lw=0, zorder=0)
    if schedule is None or not windows:
        return
    colours = style.sensor_colours(schedule.names)
    for j, sensor in enumerate(sensors):
        if getattr(sensor, "windows", None) is None:
            continue
        used = schedule.weights[:, j] > 0.5
        for k in np.flatnonzero(used):
            span = schedule.edges[k], schedule.edges[k + 1]
            axes.axvspan(*span, ymin=0, ymax=0.06, color=colours[j], lw=0)


def _prediction(problem, schedule: Schedule | None, estimate: Estimate) -> Figure:
    """The prediction of w(Tp) as it was made at every time, with its band, about the last one."""
    p = estimate.predicted.shape[1]
    shown = min(p, MOST_OUTPUTS)
    at = getattr(problem, "predict_at", estimate.times[-1])
    subtitle = f"w at t = {at:g} as predicted at time t: deviation from the last prediction with its ±2σ band"
    subtitle += _about_passes(problem)
    subtitle += f"; the first {shown} of {p} outputs" if shown < p else ""
    figure = style.new_figure((13.33, 2.2 + shown * (2.0 if shown <= 4 else 1.4)), problem.name, subtitle)
    panels = np.atleast_1d(figure.subplots(shown, 2, sharex=True, width_ratios=[1.7, 1])).reshape(shown, 2)
    for i, (left, right) in enumerate(panels):
        deviation = estimate.predicted_deviation[:, i]
        middle = estimate.predicted[:, i] - estimate.predicted[-1, i]
        band = 2 * deviation
        left.fill_between(estimate.times, middle - band, middle + band, color=style.PALETTE[5], alpha=0.35, lw=0)
        left.plot(estimate.times, middle, color=style.SECOND, lw=1.3)
        left.axhline(0, color=style.GREY, lw=0.6)
        _zoom(left, middle * 0, band)
        left.set_ylabel(f"w{i + 1} − last")
        _passes(left, problem, schedule)
        note = f"last: {estimate.predicted[-1, i]:.4g} ± {2 * deviation[-1]:.2g}"
        left.annotate(note, (0.99, 0.93), xycoords="axes fraction", ha="right", va="top", fontsize=10)
        right.plot(estimate.times, deviation, color=style.SECOND)
        value_axis(right, deviation)
        right.set_ylabel(f"σ of w{i + 1}")
        right.grid(axis="y")
        _passes(right, problem, schedule)
        for axes in (left, right):
            style.tidy_time_axis(axes, float(estimate.times[0]), float(estimate.times[-1]), label=i == shown - 1)
    return figure


def _consistency(problem, estimate: Estimate, truth: Trajectory | None) -> Figure:
    """NIS averaged over groups of samples and, with a truth, NEES at every time; each with its 99 % band."""
    subtitle = "filter consistency: 1 is right; 99 % of the points belong into the band"
    figure = style.new_figure((13.33, 4.2 if truth is None else 6.5), problem.name, subtitle)
    panels = np.atleast_1d(figure.subplots(1 if truth is None else 2, 1, sharex=True))
    used = np.flatnonzero(estimate.dimension > 0)
    groups = np.array_split(used, min(GROUPS, max(1, len(used) // 3))) if len(used) else []
    if groups:
        degrees = np.array([np.sum(estimate.dimension[g]) for g in groups])
        value = np.array([np.sum(estimate.nis[g]) for g in groups]) / degrees
        bands = np.array([average_band(d) for d in degrees])
        at = np.array([np.mean(estimate.times[g]) for g in groups])
        panels[0].fill_between(at, bands[:, 0], bands[:, 1], color=style.PALE, step="mid", lw=0)
        panels[0].plot(at, value, "o", color=style.ACCENT, ms=4)
    panels[0].set_ylabel("NIS per value")
    if truth is not None:
        judged = judge_run(estimate, truth)
        low, high = judged.nees_band
        panels[1].axhspan(low, high, color=style.PALE, lw=0)
        panels[1].plot(judged.times, judged.average_nees, color=style.SECOND, lw=1.2)
        panels[1].set_ylabel("NEES per state")
    for i, axes in enumerate(panels):
        axes.axhline(1, color=style.GREY, lw=0.8)
        _time_axis(axes, problem, estimate, i == len(panels) - 1)
    return figure


def truth_remark(estimate: Estimate, truth: Trajectory, source: object) -> str:
    """One sentence on the errors of an estimate, measured by its own covariance.

    Parameters
    ----------
    estimate : Estimate, one row per node
    truth : true states at the same times
    source : the file they came from
    """
    judged = judge_run(estimate, truth)
    if not judged.degrees.any():
        return f"NEES against {source}: none, the covariance is zero throughout"
    average = float(judged.nees.sum() / judged.degrees.sum())
    low, high = judged.nees_band
    return (
        f"NEES against {source}: {average:.4g} per state on average; the 99 % band of a "
        f"single time is [{low:.3g}, {high:.3g}], {100 * judged.nees_inside:.0f} % of the times lie inside"
    )
