"""The panels of a schedule's page, continuous sensing and readings: who measures, why, and what is known for it."""

from __future__ import annotations

import numpy as np

from occontrol.core.solution import Solution
from occontrol.families.athans.figures import output_deviation
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.files.page.content import Bars, Curves, Group, Panel, Shades
from occontrol.files.page.usual import (
    MOST_CURVES,
    MOST_SENSORS,
    STEP,
    TIME,
    column_edges,
    curves_or_map,
    deviation_panels,
    deviations,
    schedule_bars,
)

IN_USE = 1e-3  # least share of the time


def rate_groups(problem: SchedulingProblem, solution: Solution) -> list[Group]:
    """The panels of a problem of continuous sensing.

    Parameters
    ----------
    problem : SchedulingProblem
    solution : Solution with a schedule
    """
    schedule, arrays, edges = solution.schedule, solution.arrays, problem.edges
    panels: list[Panel] = []
    if schedule is not None:
        middle = edges[:-1] + np.diff(edges) / 2
        rates = np.column_stack([sensor.cost.sample(middle)[:, 0, 0] for sensor in problem.sensors])
        title = "who measures when" + ("" if schedule.is_integer else "; height: share of the time")
        allowed = None if np.all(problem.upper > 0) else problem.upper > 0
        title += "" if allowed is None else "; pale: inside a window"
        panels.append(schedule_bars(schedule, title, allowed, rates))
    of, weights = ("relaxation", "relaxed_weights") if "relaxed_switching" in arrays else ("schedule", "weights")
    switching = arrays["relaxed_switching" if of == "relaxation" else "switching"]
    usable = np.where(problem.upper > 0, switching, np.nan)
    panels.append(switching_panel(f"switching functions of the {of}", "cost / time", edges, usable, arrays[weights],
                                  problem.sensors.names))  # fmt: skip
    panels += deviation_panels(problem, arrays["times"], deviations(arrays["covariance"]))
    predicted = output_deviation(problem, arrays["covariance"])
    if np.any(predicted > 0):
        names = [f"w{i + 1}" for i in range(predicted.shape[1])]
        at = f"standard deviation of the prediction for t = {problem.predict_at:g}, made at time t"
        panels.append(curves_or_map(at, "deviation", arrays["times"], predicted, names))
    return [Group(axis=TIME, panels=panels)]


def readings_groups(problem: ReadingsProblem, solution: Solution) -> list[Group]:
    """The panels of a problem of readings.

    Parameters
    ----------
    problem : ReadingsProblem
    solution : Solution with a schedule
    """
    times, arrays, names = problem.clock.times, solution.arrays, problem.sensors.names
    upper = problem.upper[problem.clock.owner]
    prices = np.column_stack([sensor.cost.sample(times)[:, 0, 0] for sensor in problem.sensors])
    panels: list[Panel] = []
    if solution.schedule is not None:
        allowed = None if np.all(upper > 0) else upper > 0
        panels.append(
            Bars(title="who is read when" + ("" if allowed is None else "; pale: may be read"), names=names,
                 edges=problem.edges, weights=solution.schedule.weights, allowed=allowed, rates=prices, rate="price",
                 instants=True)
        )  # fmt: skip
    switching = np.where(upper > 0, arrays["switching"], np.nan)
    panels.append(switching_panel("switching functions: price less first-order saving", "cost of a reading",
                                  times, switching, arrays["weights"], names))  # fmt: skip
    before = arrays["prior_covariance" if problem.prior else "covariance"][: len(times)]
    both = np.stack([before, arrays["covariance"]], axis=1)
    flat = deviations(both.reshape(-1, *both.shape[2:]))
    if flat.shape[1] <= MOST_CURVES:
        title = "standard deviation of the estimation error, before and after every reading"
        panels += deviation_panels(problem, np.repeat(times, 2), flat, title)
    else:
        title = "standard deviation of the estimation error just after every reading"
        panels += deviation_panels(problem, column_edges(times, len(times)), flat[1::2], title)
    return [Group(axis=STEP if problem.discrete else TIME, panels=panels, whole=problem.discrete)]


def switching_panel(
    title: str, label: str, times: np.ndarray, switching: np.ndarray, weights: np.ndarray, names: tuple[str, ...] | list
) -> Panel:
    """Switching functions of a few sensors as curves; of many how far each lies above the smallest.

    Parameters
    ----------
    title, label : of the panel and its values
    times : (N+1,) edges, or (N,) instants
    switching : (N, M), not-a-number where a sensor may not be used
    weights : (N, M) of the policy that they belong to
    names : of the M sensors
    """
    if len(names) <= MOST_SENSORS:
        return Curves(title=f"{title} (thick: in use)", label=label, times=times, values=switching, names=list(names),
                      used=weights > IN_USE, sensors=True)  # fmt: skip
    usable = np.isfinite(switching)
    smallest = np.min(np.where(usable, switching, np.inf), axis=1, keepdims=True)
    above = np.where(usable, switching - np.where(np.isfinite(smallest), smallest, 0.0), np.nan)
    floor = float(np.min(above[above > 0], initial=np.inf))
    shown = np.maximum(above, floor) if np.isfinite(floor) else above  # zero has no logarithm
    return Shades(title=f"{title}, above the smallest (dark: the best)", label=label, names=list(names),
                  edges=column_edges(times, len(switching)), values=shown, smallest=True)  # fmt: skip
