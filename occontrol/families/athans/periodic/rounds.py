"""Windows that come again and again: which choices there are at every step of one round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import Mistake
from occontrol.core.sensor import Sensor

if TYPE_CHECKING:
    from occontrol.families.athans.periodic.problem import PeriodicProblem

MOST_PHASES = 1_000
NEAR = 1e-6  # of a step: what times may be off


def steps_of(repeat: float | None, step: float) -> int:
    """The number P of steps of one round, 1 without windows.

    Parameters
    ----------
    repeat : time of a round, or None
    step : length of a step
    """
    return 1 if repeat is None else round(repeat / step)


def round_mistakes(sensors: Sequence[Sensor], repeat: float | None, step: float, sensing: str) -> list[Mistake]:
    """What is wrong with windows and the time after which they come again; paths in a problem file.

    Parameters
    ----------
    sensors : of the problem
    repeat : time of a round, or None
    step : length of a step
    sensing : of the problem
    """
    path, windowed = ("horizon", "repeat"), [j for j, s in enumerate(sensors) if s.windows is not None]
    if repeat is None:
        what, hint = "has windows, and nothing says when they come again", "horizon: {infinite: true, repeat: ..}"
        return [Mistake(("sensors", j, "windows"), f"sensor '{sensors[j].name}' {what}", hint) for j in windowed]
    if not windowed:
        return [Mistake(path, "repeat says when windows come again, and no sensor has any", "leave it out", key=True)]
    if not (np.isfinite(repeat) and repeat > 0) or abs(repeat / step - round(repeat / step)) > NEAR:
        return [Mistake(path, f"repeat is {repeat:g}, it must be a multiple of the step {step:g}")]
    if repeat / step > MOST_PHASES:
        return [Mistake(path, f"repeat is {round(repeat / step)} steps", f"{MOST_PHASES} at most")]
    found = []
    for j in windowed:
        sensor = sensors[j]
        for i, (a, b) in enumerate(sensor.windows or ()):
            where, window = ("sensors", j, "windows", i), f"window [{a:g}, {b:g}] of sensor '{sensor.name}'"
            if a < 0 or b > repeat:
                found.append(Mistake(where, f"{window} does not lie in one round", f"times from 0 to {repeat:g}"))
            elif sensing == "rate" and any(abs(x / step - round(x / step)) > NEAR for x in (a, b)):
                found.append(Mistake(where, f"{window} does not begin and end with a step", f"multiples of {step:g}"))
        if not found and not np.any(open_steps(sensor, steps_of(repeat, step), step, sensing)):
            found.append(Mistake(("sensors", j, "windows"), f"no window of sensor '{sensor.name}' holds a step"))
    return found


def open_steps(sensor: Sensor, steps: int, step: float, sensing: str) -> np.ndarray:
    """(P,) whether a sensor may be used in each step of a round.

    Parameters
    ----------
    sensor : with its windows
    steps : P
    step : length of one
    sensing : of the problem; readings lie at the starts of steps
    """
    if sensing == "rate":
        return sensor.available_between(step * np.arange(steps + 1))
    return np.array([sensor.readable(step * k) for k in range(steps)])


def opened(problem: PeriodicProblem) -> np.ndarray:
    """(P, A) which choices there are at every step of a round.

    Parameters
    ----------
    problem : PeriodicProblem
    """
    P = problem.phases
    single = {s.name: open_steps(s, P, problem.step, problem.sensing) for s in problem.sensors}
    columns = [np.all([np.ones(P, dtype=bool), *(single[n] for n in c)], axis=0) for c in problem.choices]
    return np.array(columns).T


def shut(problem: PeriodicProblem) -> list[Mistake]:
    """A mistake where some step of a round has no choice at all.

    Parameters
    ----------
    problem : PeriodicProblem
    """
    none = np.flatnonzero(~np.any(problem.opened, axis=1))
    if not len(none):
        return []
    listed = ", ".join(f"{problem.step * k:g}" for k in none[:5]) + (", .." if len(none) > 5 else "")
    what = f"too few sensors are open in the step{'s' * (len(none) > 1)} from {problem.variable} = {listed}"
    return [Mistake(("sensors",), what, "add idle, or widen windows")]


def out_of_round(problem: PeriodicProblem, word: Sequence[int]) -> list[str]:
    """In words, where a cycle does not keep to the windows.

    Parameters
    ----------
    problem : PeriodicProblem
    word : letters from the start of a round on
    """
    P, opened = problem.phases, problem.opened
    if len(word) % P:
        return [f"the cycle has {len(word)} steps, windows come again every {P}: a multiple of that is needed"]
    closed = [(k, a) for k, a in enumerate(word) if not opened[k % P, a]]
    return [f"{problem.letters[a]} is not open at {problem.variable} = {problem.step * k:.9g}" for k, a in closed[:3]]


def without_windows(sensors: Sequence[Sensor]) -> list[Sensor]:
    """The same sensors, always open.

    Parameters
    ----------
    sensors : in the user's order
    """
    return [s if s.windows is None else replace(s, windows=None) for s in sensors]
