"""Random small problems with rules of every kind: branch and bound against full enumeration, which shares no code.

    .venv/bin/python scripts/campaign_rules.py [FIRST] [COUNT] [INTERVALS]

Prints what differs, and at the end how many problems were equal, how many had no schedule, and the nodes needed.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.rules.tree import Search, TreeOptions
from tests.scheduling.rules.enumeration import allowed, error, optimum, words
from tests.scheduling.rules.small_problems import small, task_of

LIMIT = 120.0  # seconds a problem


def compared(seed: int, most: int) -> tuple[bool, bool, int]:
    """Whether tree and enumeration agree, whether there was a schedule, and the nodes of the tree."""
    p, alpha, goal = small(seed, most)
    if goal == "observation":
        errors = [error(p, list(w)) for w in list(words(p))[::7] if allowed(p, list(w))]
        goal = goal if errors else "cost"
        p.rules["max_error"] = float(np.quantile(errors, 0.3)) if errors else np.inf
    best, count = optimum(p, alpha, goal)
    task = task_of(p, alpha, goal)
    start = np.full(task.oracle.shape, 1.0 / task.oracle.shape[1])
    tree = Search(task, TreeOptions(gap=1e-7, most=50_000), Monitor(time_limit=LIMIT), []).run(start)
    slack = 1e-9 * abs(best) + 1e-12 if count else 0.0
    if not count:
        right = tree.best is None and tree.lower_bound == np.inf
    else:
        right = tree.best is not None and abs(tree.best.value - best) <= 1e-7 * abs(best)
        right = right and best * (1 - 1e-6) - slack <= tree.lower_bound <= best + slack
        right = right and tree.root.lower_bound <= best + slack
    if not right:
        got = None if tree.best is None else tree.best.value
        print(f"seed {seed}: {goal}, enumeration {best}, tree {got}, bound {tree.lower_bound}, {tree.nodes} nodes")
    return right, bool(count), tree.nodes


def main() -> int:
    """Run and report; 1 where something differs."""
    given = [int(a) for a in sys.argv[1:]]
    first, count, most = given + [1000, 500, 9][len(given) :]
    began = time.perf_counter()
    found = [compared(seed, most) for seed in range(first, first + count)]
    right = sum(r for r, _, _ in found)
    without = sum(not some for _, some, _ in found)
    nodes = [n for _, _, n in found]
    took = time.perf_counter() - began
    print(f"{right} of {count} equal, {without} of them without any schedule; nodes {np.mean(nodes):.1f} on average, "
          f"{max(nodes)} at most; {took:.0f} s")  # fmt: skip
    return 0 if right == count else 1


if __name__ == "__main__":
    sys.exit(main())
