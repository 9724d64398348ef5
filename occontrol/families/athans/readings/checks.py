"""What can be wrong with a problem of readings: how many are chosen, windows without any, values at their times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.checks import check_covariance_signal, check_finite
from occontrol.core.errors import Collector, Mistake, plural
from occontrol.core.sensor import Sensor

if TYPE_CHECKING:
    from occontrol.families.athans.readings.clock import SampleTimes, Steps
    from occontrol.families.athans.readings.problem import ReadingsProblem


def selection(
    value: int | Sequence[int],
    budget: Mapping[str, int] | None,
    sensors: Sequence[Sensor],
    readings: int,
    epoch: int = 1,
) -> tuple[tuple[int, int], list[Mistake]]:
    """How many sensors give a reading at a time, (least, most), and what is wrong with the statement.

    Parameters
    ----------
    value : a number, or (least, most); with idle among the sensors a number is the most
    budget : exact numbers of readings, or None; then `value` is an upper limit
    sensors : the problem's
    readings : N
    epoch : readings of one choice
    """
    found = Collector()
    real = sum(not s.is_idle for s in sensors)
    idle = real < len(sensors)
    ends = [value, value] if isinstance(value, int | np.integer) else list(value)
    whole = len(ends) == 2 and all(isinstance(x, int | np.integer) and not isinstance(x, bool) for x in ends)
    if not whole or not 0 <= ends[0] <= ends[1] or not 1 <= ends[1] <= max(real, 1 if idle else 0):
        shown = f"{ends[0]}..{ends[1]}" if len(ends) == 2 and ends[0] != ends[1] else f"{ends[0]}"
        what = f"select is {shown}, there are {plural(real, 'sensor')}{' besides idle' if idle else ''}"
        found.add(("select",), what, f"a number from 1 to {real}, or a range such as 0..{real}")
        return (0, 1), found.mistakes
    if budget is not None and epoch > 1:
        what = "a budget counts single readings, and an epoch makes several of one choice"
        found.add(("budget",), what, "leave epoch or budget out", True)
    least = 0 if budget is not None or (idle and ends[0] == ends[1]) else int(ends[0])
    if budget is not None:
        found.mistakes += _budget(budget, [s.name for s in sensors if not s.is_idle], readings, int(ends[1]))
    return (least, int(ends[1])), found.mistakes


def _budget(budget: Mapping[str, int], names: Sequence[str], readings: int, at_a_time: int) -> list[Mistake]:
    found = Collector()
    if not budget or ("total" in budget and len(budget) > 1):
        hint = "{total: 6}, or {radar: 3, sonar: 5}"
        found.add(("budget",), "a budget is either of all readings together or of single sensors", hint)
        return found.mistakes
    for key, value in budget.items():
        most = readings * at_a_time if key == "total" else readings
        if key != "total" and key not in names:
            found.add(("budget", key), f"there is no sensor '{key}'", f"total, or one of: {', '.join(names)}", True)
        elif isinstance(value, bool) or not isinstance(value, int | np.integer) or not 0 <= value <= most:
            what = f"the budget of {key} is {value}, {plural(readings, 'instant')} allow {most} readings"
            found.add(("budget", key), what, f"a whole number from 0 to {most}")
    return found.mistakes


def missed_readings(sensors: Sequence[Sensor], clock: Steps | SampleTimes) -> tuple[list[Mistake], list[str]]:
    """Sensors that no window lets read, as mistakes, and single windows without any reading, as warnings.

    Parameters
    ----------
    sensors : in the user's order
    clock : of the problem
    """
    found, warnings = [], []
    times, t = clock.times, clock.variable
    for j, sensor in enumerate(sensors):
        if sensor.windows is None:
            continue
        good = [any(replace(sensor, windows=[w]).readable(x) for x in times) for w in sensor.windows]
        listed = [f"[{a:g}, {b:g}]" for a, b in sensor.windows]
        if not any(good):
            what = f"no window of sensor '{sensor.name}' holds a reading: {', '.join(listed[:3])}"
            hint = f"readings are at {t} = {times[0]:g} .. {times[-1]:g}"
            found.append(Mistake(("sensors", j, "windows"), what, hint))
            continue
        warnings += [
            f"the window {text} of sensor '{sensor.name}' holds no reading"
            for text, holds in zip(listed, good, strict=True)
            if not holds
        ]
    return found, warnings


def values(problem: ReadingsProblem) -> list[Mistake]:
    """Definiteness and finiteness wherever a signal is looked at.

    Parameters
    ----------
    problem : whose shapes are right
    """
    clock, t, found = problem.clock, problem.clock.variable, []
    times = clock.times
    C, R = ("H", "R") if problem.discrete else ("C", "noise")
    for path, signal in problem.plant_signals.items():
        start, end = problem.needed(path)
        grid = times if problem.discrete else np.linspace(start, end, max(65, 2 * len(times)))
        if path[-1] in ("Q", "noise"):
            found += check_covariance_signal("noise of the plant", signal, grid, path, variable=t)
        else:
            found += check_finite(str(path[-1]), signal, grid, path, t)
    for j, sensor in enumerate(problem.sensors):
        where, of = ("sensors", j), f"of sensor '{sensor.name}'"
        found += check_finite(f"{C} {of}", sensor.C, times, (*where, C), t)
        found += check_covariance_signal(f"{R} {of}", sensor.noise, times, (*where, R), True, t)
        wrong = check_finite(f"cost {of}", sensor.cost, times, (*where, "cost"), t)
        prices = np.zeros(1) if wrong else sensor.cost.sample(times)[:, 0, 0]
        if np.any(prices < 0):
            k = int(np.argmax(prices < 0))
            what = f"cost of sensor '{sensor.name}' is {prices[k]:g} at {t} = {times[k]:.6g}"
            wrong = [Mistake((*where, "cost"), what, "the price of a reading is not negative")]
        found += wrong
    first, last = problem.needed(("objective", "output"))
    counted = np.array([problem.output_at]) if first == last else times
    found += check_finite("output", problem.output, counted, ("objective", "output"), t)
    if problem.running is not None:
        path = ("objective", "running")
        found += check_covariance_signal("running", problem.running, problem.running_times, path, variable=t)
    return found
