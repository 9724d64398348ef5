"""The panels that every family can have, and what they are made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from occontrol.core.look_schedule import LookSchedule
from occontrol.core.problem import BaseProblem
from occontrol.core.reading_schedule import ReadingSchedule
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_names, state_units
from occontrol.files.page.content import Bars, Curves, Group, Panel, Shades

MOST_CURVES = 12  # names beside a panel; more are drawn as a map
MOST_TARGETS = 60  # of which every one has a row
MOST_SENSORS = 7  # the same for sensors, each of which has its colour
TIME, STEP = "time t, in the problem's unit", "step k"


def usual_groups(problem: BaseProblem, solution: Solution) -> list[Group]:
    """The schedule and the standard deviations, as far as a solution has them.

    Parameters
    ----------
    problem, solution : of any family
    """
    panels: list[Panel] = []
    if solution.schedule is not None:
        panels.append(schedule_bars(solution.schedule, "who measures when"))
    arrays = solution.arrays
    if "times" in arrays and "covariance" in arrays:
        panels += deviation_panels(problem, arrays["times"], deviations(arrays["covariance"]))
    return [Group(axis=TIME, panels=panels)] if panels else []


def deviations(covariance: np.ndarray) -> np.ndarray:
    """Standard deviations (K, n) of the states.

    Parameters
    ----------
    covariance : (K, n, n)
    """
    return np.sqrt(np.maximum(np.einsum("kii->ki", covariance), 0.0))


def schedule_bars(
    schedule: Schedule, title: str, allowed: np.ndarray | None = None, rates: np.ndarray | None = None
) -> Bars:
    """Who measures when.

    Parameters
    ----------
    schedule : Schedule
    title : of the panel
    allowed : (K, M) of bool, or None
    rates : (K, M) what it costs, or None
    """
    return Bars(title=title, edges=schedule.edges, weights=schedule.weights, names=schedule.names, allowed=allowed,
                rates=rates)  # fmt: skip


def deviation_panels(
    problem: BaseProblem,
    times: np.ndarray,
    values: np.ndarray,
    title: str = "standard deviation of the estimation error",
    label: str = "deviation",
) -> list[Panel]:
    """Standard deviations of the states, as curves or, of many, as a map; one panel for every unit.

    Parameters
    ----------
    problem : whose states may have names and units
    times : (K,) nodes, or (K+1,) edges
    values : (K, n)
    title : of the panels
    label : of the values
    """
    names, units = state_names(problem), state_units(problem)
    panels: list[Panel] = []
    for unit in dict.fromkeys(units):
        columns = [i for i, other in enumerate(units) if other == unit]
        with_unit = f"{label} [{unit}]" if unit else label
        panels.append(curves_or_map(title, with_unit, times, values[:, columns], [names[i] for i in columns]))
    return panels


def curves_or_map(
    title: str, label: str, times: np.ndarray, values: np.ndarray, names: Sequence[str], sensors: bool = False
) -> Panel:
    """A few curves, or a map of many.

    Parameters
    ----------
    title, label : of the panel and its values
    times : (K,) nodes, or (K+1,) edges
    values : (K, C)
    names : of the C curves
    sensors : whether the names are sensors
    """
    if len(names) <= MOST_CURVES:
        return Curves(title=title, label=label, times=times, values=values, names=names, sensors=sensors)
    return Shades(title=title, label=label, edges=column_edges(times, len(values)), values=values, names=names)


def column_edges(times: np.ndarray, count: int) -> np.ndarray:
    """Ends (K+1,) of the columns of a map of values at the nodes `times` (K,); edges stay what they are."""
    if len(times) == count + 1:
        return times
    if count == 1:
        return np.array([times[0] - 0.5, times[0] + 0.5])
    return np.concatenate([times[:1], (times[1:] + times[:-1]) / 2, times[-1:]])


def compared_groups(solutions: Mapping[str, Solution], curve: tuple[str, str, str] | None, axis: str) -> list[Group]:
    """What several methods chose, one panel each, and one curve of each beside each other.

    Parameters
    ----------
    solutions : Solution by method name
    curve : names of the arrays of times and values of one curve of a solution, and what it is; None without
    axis : name of the horizontal axis
    """
    panels: list[Panel] = []
    if curve is not None:
        times, values, label = curve
        found = {name: s.arrays[values] for name, s in solutions.items() if values in s.arrays and times in s.arrays}
        grids = [solutions[name].arrays[times][-len(found[name]) :] for name in found]
        if found and all(np.array_equal(grid, grids[0]) for grid in grids):
            panels.append(Curves(title=f"{label}, by method", label=label, times=grids[0], names=list(found),
                                 values=np.column_stack(list(found.values()))))  # fmt: skip
    for name, solution in solutions.items():
        if solution.schedule is not None:
            instants = isinstance(solution.schedule, ReadingSchedule)
            schedule, weights = solution.schedule, solution.schedule.weights
            if isinstance(schedule, LookSchedule):
                if len(schedule.targets) > MOST_TARGETS:
                    continue
                weights = schedule.by_target
            panels.append(Bars(title=name, edges=schedule.edges, weights=weights, names=schedule.names,
                               instants=instants))  # fmt: skip
    return [Group(axis=axis, panels=panels, whole=axis == STEP)] if panels else []
