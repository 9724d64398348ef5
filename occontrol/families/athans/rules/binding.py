"""Which rules bind a schedule, and what one more unit of a budget would be worth."""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.rules.frame import spelt
from occontrol.scheduling.rules.check import changes
from occontrol.scheduling.rules.hull import Hull
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.rows import Rows
from occontrol.scheduling.rules.task import Task

USED_UP = 1e-6  # of a cap: what counts as none left


def active_rules(task: Task, plan: Plan | None, error: float) -> list[str]:
    """The budgets of which a schedule leaves nothing, in the user's words.

    Parameters
    ----------
    task : Task
    plan : the schedule, or None
    error : its E
    """
    rules, grid = task.rules, task.oracle.grid
    if plan is None:
        return []
    found = []
    if rules.max_switches is not None and len(changes(rules, plan.on)) >= rules.max_switches:
        found.append(spelt("max_switches", None))
    shortest = float(np.min(grid.steps))
    starts, used = np.sum(plan.starts, axis=0), grid.steps @ plan.on
    starts = starts if rules.reads is None else rules.reads @ plan.on
    for j, name in enumerate(rules.names):
        if starts[j] >= rules.max_uses[j]:
            found.append(spelt("max_uses", name))
        if used[j] > rules.max_time[j] - shortest:
            found.append(spelt("max_time", name))
    spent = float(np.vdot(task.spend, plan.on))
    positive = task.spend[task.spend > 0]
    if spent > rules.max_observation - (float(np.min(positive)) if len(positive) else 0.0):
        found.append(spelt("max_observation", None))
    if error > rules.max_error * (1 - 1e-2):
        found.append("max_error")
    return found


def multipliers_of(task: Task, rows: Rows, root: Hull) -> dict[str, float]:
    """{rule: what one more unit of it lowers the bound by}: one more use, unit of time, or unit of cost or error.

    Parameters
    ----------
    task : Task
    rows : of the search
    root : hull of the first node
    """
    multipliers = root.proof[1]
    names = task.rules.names
    found: dict[str, float] = {}
    for row, mu in zip(rows.known, multipliers.rows, strict=False):
        if row.rule in ("max_uses", "max_time", "max_observation"):
            found[spelt(row.rule, None if row.sensor is None else names[row.sensor])] = float(mu / row.unit)
    if np.isfinite(task.rules.max_error):
        found["max_error"] = float(multipliers.error)
    return found
