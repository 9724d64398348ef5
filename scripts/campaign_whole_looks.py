"""The bounds on whole looks against the enumerated optimum of small random problems: violations and how near they are.

    python -m scripts.campaign_whole_looks             200 problems, about a minute
    python -m scripts.campaign_whole_looks 500 700     those with these seeds

Two or three targets, at most 14 intervals, precise and weak looks, capacities 1 and 2, windows, one or two sites
(tests/plain_looks.py, which shares no code with the product). Printed are quantiles of bound / optimum. `prices` is the
bound by prices alone, with the forgetful programme and its levels, before the tree.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import occontrol as oc
from occontrol.core.monitor import Monitor
from occontrol.families.athans.targets.solve import relaxed_task, resolved
from occontrol.families.athans.targets.whole import bound_whole
from tests.plain_looks import optimum, small
from tests.target_problems import read

ROUNDING = 1e-9
NAMES = "relaxed", "prices", "whole looks, with the tree", "lower_bound", "cost"
SHARES = (0, 1, 5, 10, 25, 50, 100)


def main() -> None:
    """Solve them all; exit 1 where a bound lies above the optimum or a cost below it."""
    first, last = (int(x) for x in sys.argv[1:3]) if len(sys.argv) > 2 else (0, 200)
    rows, wrong = [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, last):
            document = small(seed)
            best = optimum(document)
            problem = read(document, Path(folder))
            solution = oc.solve(problem)
            r = solution.result
            filled, _ = resolved(problem, 1e-4, Monitor())
            task = relaxed_task(filled, 1e-4, 2000, Monitor())
            whole = bound_whole(filled, task.sweep, task.relaxed, np.nan, Monitor(), walk=False)
            assert whole is not None
            bounds = r["bounds"]["relaxed"], whole.bound, r["bounds"]["integer"], r["lower_bound"]
            rows.append([*(b / best for b in bounds), solution.cost / best])
            if max(bounds) > best * (1 + ROUNDING) or solution.cost < best * (1 - ROUNDING):
                wrong.append(seed)
    table = np.array(rows)
    print(f"{len(rows)} problems, {len(wrong)} with a bound above the optimum or a cost below it: {wrong}")
    print("| quantile | " + " | ".join(f"{s} %" for s in SHARES) + " | below .98 |")
    print("|---" * (len(SHARES) + 2) + "|")
    for name, column in zip(NAMES, table.T, strict=True):
        quantiles = " | ".join(f"{q:.6f}" for q in np.percentile(column, SHARES))
        print(f"| {name} / optimum | {quantiles} | {np.sum(column < 0.98)} |")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
