"""What `check` says of rules: what their times become on the edges."""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.rules.frame import Frame
from occontrol.scheduling.rules.grid import NEVER, Counts, Grid, counts
from occontrol.scheduling.rules.rules import Rules

ROUNDED = {"min_on": "need", "max_on": "most", "min_off": "off", "warm_up": "warm"}
LISTED = 6  # delays


def describe_rules(frame: Frame, minimise: str) -> list[tuple[str, str]]:
    """Label and text of every rule, with the times that it has on the grid.

    Parameters
    ----------
    frame : Frame of the problem
    minimise : what is minimised
    """
    rules, grid = frame.rules, Grid(frame.edges)
    on_grid = counts(rules, grid)
    found = []
    for j, name in enumerate(rules.names):
        parts = [
            f"{rule} {getattr(rules, rule)[j]:g} {_becomes(getattr(on_grid, field)[:, j], grid)}"
            for rule, field in ROUNDED.items()
            if 0 < getattr(rules, rule)[j] < np.inf
        ]
        for rule in ("max_uses", "max_time", "revisit"):
            if np.isfinite(getattr(rules, rule)[j]):
                parts.append(f"{rule} {getattr(rules, rule)[j]:g}")
        if np.isfinite(rules.duty_time[j]):
            parts.append(f"duty {rules.duty_time[j]:g} in every {rules.duty_window[j]:g}")
        if parts:
            found.append((f"rules of {name}", "; ".join(parts)))
    automaton = frame.oracle().automaton
    goal = {"cost": "cost", "error": "error", "observation": "observation cost"}[minimise]
    found.append(("rules", "; ".join(_general(rules, on_grid, grid))))
    found.append(("minimised", f"{goal}, over {automaton.states} states of the rules"))
    return found


def _general(rules: Rules, on_grid: Counts, grid: Grid) -> list[str]:
    """What is about all sensors."""
    found = []
    if rules.max_switches is not None:
        found.append(f"at most {rules.max_switches} change{'s' * (rules.max_switches != 1)}")
    if rules.costs_changes():
        dear = max(float(np.max(rules.switch_cost)), rules.start_cost)
        found.append(f"a change costs up to {dear:g}")
    delayed = np.argwhere(rules.switch_delay > 0)
    for i, j in delayed[:LISTED]:
        becomes = _becomes(on_grid.delay[:, i, j], grid)
        found.append(f"switch_delay from {rules.names[i]} to {rules.names[j]} {rules.switch_delay[i, j]:g} {becomes}")
    if len(delayed) > LISTED:
        found.append(f"{len(delayed) - LISTED} delays more")
    if rules.before is not None:
        found.append(f"before: {rules.names[rules.before[0]]} for {rules.before[1]:g}")
    found.append("after: enforce" if rules.enforce else "after: free, the end may cut the last use")
    for cap, word in ((rules.max_observation, "max_observation_cost"), (rules.max_error, "max_error")):
        if np.isfinite(cap):
            found.append(f"{word} {cap:g}")
    return found


def _becomes(count: np.ndarray, grid: Grid) -> str:
    """What a time becomes: "(3 intervals, 1.5)", or the range over the edges (N,)."""
    begins = np.flatnonzero((count != NEVER) & (count + np.arange(len(count)) <= grid.intervals))
    if not len(begins):
        return "(longer than the horizon)"
    inside = count[begins]
    times = grid.times[begins + inside] - grid.times[begins]
    few, many = int(inside.min()), int(inside.max())
    number = f"{few} interval{'s' * (few != 1)}" if few == many else f"{few} to {many} intervals"
    low, high = f"{times.min():.6g}", f"{times.max():.6g}"
    return f"({number}, {low})" if low == high else f"({number}, {low} to {high})"
