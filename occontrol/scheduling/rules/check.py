"""Which rules a schedule breaks, found from its uses in real time and from nothing that the search knows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from occontrol.scheduling.rules.grid import TOLERANCE, Grid
from occontrol.scheduling.rules.rules import Rules

RELATIVE = 1e-9  # of a cap on cost or error


@dataclass(frozen=True)
class Violation:
    """One rule that is broken.

    Parameters
    ----------
    rule : as in Rules
    sensor : its name, empty where the rule is about all of them
    time : at which it is broken
    text : what the user reads
    """

    rule: str
    sensor: str
    time: float
    text: str


def uses(on: np.ndarray) -> list[tuple[int, int]]:
    """[(a, b)]: the maximal runs a .. b-1 of true in `on` (N,)."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    return list(zip(change[::2].tolist(), change[1::2].tolist(), strict=True))


def violations(rules: Rules, edges: np.ndarray, on: np.ndarray) -> list[Violation]:
    """Every rule that a schedule breaks, caps on cost and error apart.

    Parameters
    ----------
    rules : Rules
    edges : (N+1,) times
    on : (N, M) whether a sensor is in use; 'idle' counts where select is 1
    """
    found = [v for j in range(rules.sensors) for v in _of_sensor(rules, edges, on, j)]
    found += list(_of_changes(rules, edges, on))
    return sorted(found, key=lambda v: v.time)


def keeps(rules: Rules, edges: np.ndarray, on: np.ndarray) -> bool:
    """Whether (N, M) breaks no rule on edges (N+1,), caps on cost and error apart."""
    return not any(True for j in range(rules.sensors) for _ in _of_sensor(rules, edges, on, j)) and not any(
        True for _ in _of_changes(rules, edges, on)
    )


def _of_sensor(rules: Rules, edges: np.ndarray, on: np.ndarray, j: int) -> Iterator[Violation]:
    t, T, x, name = edges, edges[-1], rules.variable, rules.names[j]
    slack = TOLERANCE * (T - t[0])
    runs = uses(on[:, j])
    past = rules.before[1] if rules.before is not None and rules.before[0] == j else None

    def broken(rule: str, time: float, text: str) -> Violation:
        return Violation(rule, name, float(time), f"sensor '{name}' {text}")

    if past is not None and not on[0, j] and past < rules.min_on[j] - slack:
        yield broken("min_on", t[0], f"stops at {x} = {t[0]:g} after {past:g}, min_on is {rules.min_on[j]:g}")
    for a, b in runs:
        begins = t[a] - past if a == 0 and past is not None else t[a]
        length, where = t[b] - begins, f"is on from {x} = {t[a]:.6g} to {t[b]:.6g}"
        cut = b == len(t) - 1 and not rules.enforce
        if length < rules.min_on[j] - slack and not cut:
            yield broken("min_on", t[a], f"{where}, min_on is {rules.min_on[j]:g}")
        if length > rules.max_on[j] + slack:
            yield broken("max_on", t[a], f"{where}, max_on is {rules.max_on[j]:g}")
    if rules.min_off[j] > 0:
        ends = [t[b] for _, b in runs]
        starts = [t[a] for a, _ in runs]
        if past is not None and not on[0, j]:
            ends.insert(0, t[0])
        else:
            starts = starts[1:]
        for stop, start in zip(ends, starts, strict=False):
            if start - stop < rules.min_off[j] - slack:
                text = f"is off from {x} = {stop:.6g} to {start:.6g} only, min_off is {rules.min_off[j]:g}"
                yield broken("min_off", stop, text)
    count = len(runs) - (past is not None and bool(on[0, j]))
    if rules.reads is not None:
        read = np.cumsum(rules.reads * on[:, j])
        if read[-1] > rules.max_uses[j]:
            late = int(np.argmax(read > rules.max_uses[j]))
            yield broken("max_uses", t[late], f"gives {read[-1]:g} readings, max_uses is {rules.max_uses[j]:g}")
    elif count > rules.max_uses[j]:
        late = runs[int(rules.max_uses[j]) + len(runs) - count]
        yield broken("max_uses", t[late[0]], f"has {count} uses, max_uses is {rules.max_uses[j]:g}")
    total = float(np.diff(t) @ on[:, j])
    if total > rules.max_time[j] + slack:
        yield broken("max_time", t[0], f"is on for {total:.6g} in all, max_time is {rules.max_time[j]:g}")
    yield from (broken(*v) for v in _duty(rules, t, runs, j, slack))
    yield from (broken(*v) for v in _gaps(rules, t, runs, j, slack))


def within_windows(t: np.ndarray, runs: list[tuple[int, int]], window: float) -> tuple[np.ndarray, np.ndarray]:
    """Where windows begin in which the time in use may be largest, (W,), and that time, (W,); none too long to fit.

    Parameters
    ----------
    t : (N+1,) edges
    runs : first interval of a use and the one after its last
    window : length
    """
    spans = np.array([(t[a], t[b]) for a, b in runs]).reshape(-1, 2)
    # it is largest where the window begins with a use or ends with one
    begins = np.concatenate([spans[:, 0], spans[:, 1] - window])
    begins = np.unique(np.clip(begins, t[0], max(t[-1] - window, t[0])))
    inside = np.minimum(spans[None, :, 1], begins[:, None] + window) - np.maximum(spans[None, :, 0], begins[:, None])
    return begins, np.sum(np.maximum(inside, 0.0), axis=1)


def _duty(rules: Rules, t: np.ndarray, runs: list[tuple[int, int]], j: int, slack: float) -> Iterator[tuple]:
    window, most, x = rules.duty_window[j], rules.duty_time[j], rules.variable
    if not np.isfinite(most) or not runs:
        return
    if window > t[-1] - t[0] + slack:
        return
    begins, used = within_windows(t, runs, window)
    if np.any(used > most + slack):
        i = int(np.argmax(used > most + slack))
        text = (
            f"is on for {used[i]:.6g} within {x} = {begins[i]:.6g} to {begins[i] + window:.6g}, duty.time is {most:g}"
        )
        yield "duty_time", begins[i], text


def _gaps(rules: Rules, t: np.ndarray, runs: list[tuple[int, int]], j: int, slack: float) -> Iterator[tuple]:
    if not np.isfinite(rules.revisit[j]):
        return
    x = rules.variable
    ends = [t[0], *(t[b] for _, b in runs)]
    starts = [*(t[a] for a, _ in runs), t[-1]]
    for end, start in zip(ends, starts, strict=True):
        if start - end > rules.revisit[j] + slack:
            text = f"is not used from {x} = {end:.6g} to {start:.6g}, revisit is {rules.revisit[j]:g}"
            yield "revisit", end, text


def segments(on: np.ndarray) -> list[tuple[int, int]]:
    """[(a, b)]: the maximal runs a .. b-1 of equal rows of `on` (N, M)."""
    cuts = np.flatnonzero(np.any(on[1:] != on[:-1], axis=1)) + 1
    ends = [0, *cuts.tolist(), len(on)]
    return list(pairwise(ends))


def changes(rules: Rules, on: np.ndarray) -> list[tuple[int, tuple[int, ...], tuple[int, ...], int]]:
    """[(a, stopped, started, b)]: every change, from edge a to edge b where slewing lies between.

    Parameters
    ----------
    rules : Rules
    on : (N, M) whether a sensor is in use
    """
    runs = [(a, b, tuple(np.flatnonzero(on[a]).tolist())) for a, b in segments(on)]
    if rules.before is not None:
        runs.insert(0, (0, 0, (rules.before[0],)))
    if rules.select == 1:
        runs = [run for run in runs if run[2]]
    found = []
    for (_, end, old), (start, _, new) in pairwise(runs):
        stopped, started = tuple(set(old) - set(new)), tuple(set(new) - set(old))
        if stopped or started or end != start:
            found.append((end, stopped, started, start))
    return found


def switching_cost(rules: Rules, on: np.ndarray) -> float:
    """What the changes of the schedule `on` (N, M) cost."""
    total = 0.0
    for _, stopped, started, _ in changes(rules, on):
        if rules.select > 1:
            total += rules.start_cost * len(started)
        elif stopped and started:
            total += float(rules.switch_cost[stopped[0], started[0]])
    return total


def _of_changes(rules: Rules, edges: np.ndarray, on: np.ndarray) -> Iterator[Violation]:
    t, x, found = edges, rules.variable, changes(rules, on)
    if rules.max_switches is not None and len(found) > rules.max_switches:
        text = f"there are {len(found)} changes, max_switches is {rules.max_switches}"
        yield Violation("max_switches", "", float(t[found[rules.max_switches][0]]), text)
    if rules.select > 1:
        return
    lost = [(a, b) for a, b in segments(on) if not np.any(on[a])]
    slewed = {(a, b) for a, _, _, b in found if b > a}
    grid = Grid(t)
    for a, stopped, started, b in found:
        if not stopped or not started:
            continue
        i, j = stopped[0], started[0]
        delay = float(rules.switch_delay[i, j])
        count = int(grid.up(delay)[a]) if delay > 0 and a < grid.intervals else 0
        if b - a != count:
            between = f"between sensors '{rules.names[i]}' and '{rules.names[j]}'"
            need = f"the switch_delay of {delay:g} lasts to {x} = {t[min(a + count, grid.intervals)]:.6g} here"
            text = f"nothing is in use from {x} = {t[a]:.6g} to {t[b]:.6g} {between}, {need}"
            yield Violation("switch_delay", rules.names[j], float(t[a]), text)
    for a, b in lost:
        if (a, b) not in slewed:
            text = f"nothing is in use from {x} = {t[a]:.6g} to {t[b]:.6g}, and no change of sensor lies there"
            yield Violation("switch_delay", "", float(t[a]), text)
    for a, b in lost:
        for c, stopped, started, d in found:
            if (c, d) == (a, b) and not (stopped and started):
                text = f"sensor '{rules.names[int(np.flatnonzero(on[b])[0])]}' goes on after a pause"
                yield Violation("switch_delay", "", float(t[c]), text)
