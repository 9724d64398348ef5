"""Edges that a schedule needs beside those of the file: ends of windows, and jumps of tables that are held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from occontrol.core.clock import nearest_edge, tolerance
from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.sensor import Sensor
from occontrol.core.signal import ExpressionSignal, Signal, TableSignal

WINDOW, JUMP = "window of {} {}", "jump of {}"


def jumps(signal: Signal, start: float, end: float) -> np.ndarray:
    """Times (K,) at which a held table takes another value, or a formula jumps.

    Parameters
    ----------
    signal : Signal
    start, end : of the horizon
    """
    if isinstance(signal, ExpressionSignal):
        try:
            return signal.breaks(start, end)
        except ProblemError:  # whoever checks its values says so
            return np.empty(0)
    if not isinstance(signal, TableSignal) or signal.interpolation != "previous":
        return np.empty(0)
    changed = np.any(np.diff(signal.values, axis=0) != 0, axis=(1, 2))
    return signal.times[1:][changed]


def fitted_edges(
    edges: np.ndarray, sensors: Sequence[Sensor], signals: Mapping[tuple, Signal], windows: bool, tables: bool
) -> tuple[np.ndarray, list[tuple[float, str]]]:
    """The edges of a file with those that were missing, and (time, why) of each of these.

    Parameters
    ----------
    edges : (N+1,) increasing; all of them stay
    sensors : whose windows end
    signals : of the problem, by their places in a problem file
    windows, tables : whether ends of windows, and jumps of tables, become edges
    """
    wanted: list[tuple[float, str]] = []
    ends = float(edges[0]), float(edges[-1])
    for sensor in sensors if windows else ():
        for start, end in sensor.windows or ():
            wanted += [(start, WINDOW.format(sensor.name, "begins")), (end, WINDOW.format(sensor.name, "ends"))]
    for path, signal in signals.items() if tables else ():
        name = ".".join(str(part + 1 if isinstance(part, int) else part) for part in path)
        wanted += [(float(t), JUMP.format(name)) for t in jumps(signal, *ends)]
    added: list[tuple[float, str]] = []
    for time, why in sorted(w for w in wanted if edges[0] < w[0] < edges[-1]):
        if not nearest_edge(np.array([time]), edges)[1][0]:
            edges = np.insert(edges, np.searchsorted(edges, time), time)
            added.append((time, why))
    return edges, added


def missed_windows(sensors: Sequence[Sensor], edges: np.ndarray) -> tuple[list[Mistake], list[str]]:
    """Sensors that can never be used, as mistakes, and single windows that miss the horizon, as warnings.

    Parameters
    ----------
    sensors : in the user's order
    edges : (N+1,) of the horizon
    """
    mistakes, warnings = [], []
    start, end = float(edges[0]), float(edges[-1])
    for j, sensor in enumerate(sensors):
        if sensor.windows is None:
            continue
        inside = [_overlap(window, start, end) for window in sensor.windows]
        if not any(inside):
            listed = ", ".join(f"[{a:g}, {b:g}]" for a, b in sensor.windows[:3])
            what = f"no window of sensor '{sensor.name}' meets the horizon [{start:g}, {end:g}]: {listed}"
            mistakes.append(Mistake(("sensors", j, "windows"), what, "move a window, or leave the sensor out"))
            continue
        for (a, b), good in zip(sensor.windows, inside, strict=True):
            if not good:
                what = f"the window [{a:g}, {b:g}] of sensor '{sensor.name}' lies outside the horizon"
                warnings.append(f"{what} [{start:g}, {end:g}]")
    return mistakes, warnings


def _overlap(window: tuple[float, float], start: float, end: float) -> bool:
    a, b = max(window[0], start), min(window[1], end)
    return b - a > tolerance(window[1] - window[0], start, end)
