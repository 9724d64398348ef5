"""Where a node is parted: the interval whose sensors are torn most, one set of them after the other."""

from __future__ import annotations

import numpy as np

from occontrol.scheduling.rules.hull import Hull, filled
from occontrol.scheduling.rules.task import Task

CHILDREN = 3  # sets that get a child of their own, beside the one for all others
USED = 0.02  # share from which a set gets one


def children_of(
    task: Task, found: Hull, mask: np.ndarray, useful: np.ndarray
) -> list[tuple[np.ndarray, int, np.ndarray]]:
    """(mask, interval, (A,) actions there) that part the schedules of a node; empty where it is a single one.

    Parameters
    ----------
    task : Task
    found : hull of the node
    mask : (N, A) actions that branching alone allows
    useful : (N, A) of those, the ones that may better the best schedule
    """
    oracle = task.oracle
    groups, wide = (
        np.stack([np.any((oracle.open & m)[:, oracle.group == g], axis=1) for g in range(len(oracle.sets))], axis=1)
        for m in (useful, mask)
    )
    free = np.sum(groups, axis=1) > 1
    if not np.any(free):
        return []
    share = np.zeros(groups.shape)
    for plan, s in zip(found.plans, filled(found), strict=True):
        share[np.arange(len(share)), oracle.group[plan.actions]] += s
    at = _where(task, found, wide, free, share)
    order = [int(g) for g in np.argsort(-share[at], kind="stable") if groups[at, g]]
    own = [g for g in order if share[at, g] > USED][:CHILDREN] or order[:1]
    children = []
    for part in [*([g] for g in own), [g for g in order if g not in own]]:
        if part:
            child = useful.copy()
            child[at] &= np.isin(oracle.group, part)
            children.append((child, at, child[at].copy()))
    return children


def _where(task: Task, found: Hull, groups: np.ndarray, free: np.ndarray, share: np.ndarray) -> int:
    """The interval to branch on."""
    steps = task.oracle.grid.steps
    if found.line is not None:
        g = found.line[1]
    else:
        g = task.goal.observation * task.price + max(task.goal.error, 1e-3) * found.tangent.slope
    cost = g @ task.oracle.automaton.columns.T
    worth = np.stack([np.min(cost[:, task.oracle.group == i], axis=1) for i in range(groups.shape[1])], axis=1)
    high = np.max(np.where(groups, worth, -np.inf), axis=1)
    low = np.min(np.where(groups, worth, np.inf), axis=1)
    spread = np.sqrt(np.maximum(np.where(free, high - low, 0.0), 0.0))
    torn = steps * np.sum(share * (1 - share), axis=1)
    width = min(5, len(torn))
    smooth = np.convolve(torn, np.full(width, 1 / width), mode="same")
    score = np.where(free, (smooth + 1e-3 * torn) * (spread + 1e-12 * np.max(spread, initial=0.0)), -1.0)
    if np.max(score) > 1e-12 * float(np.max(steps)):
        return int(np.argmax(score))
    return int(np.argmax(np.where(free, spread + 1e-300, -1.0)))
