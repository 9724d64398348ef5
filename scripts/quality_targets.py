"""Many targets and whole looks: bounds and schedules on seeded instances, as rows for docs/targets.md.

    python -m scripts.quality_targets              all rows, a few minutes
    python -m scripts.quality_targets 0 3          rows number 0 and 3

Columns: both bounds, the cost of the schedule, how far it lies above the larger bound, processor seconds of the bound
on whole looks and of the whole solve (compiled functions warm). Rules of thumb in per cent above the same bound.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import occontrol as oc
from occontrol.core.monitor import Monitor
from occontrol.families.athans.targets.methods import METHODS
from occontrol.families.athans.targets.solve import relaxed_task, resolved
from occontrol.families.athans.targets.whole import bound_whole
from tests.target_problems import five, read, tracking

ROWS = (
    (16, 60, 1, 20.0, 0.05), (40, 120, 2, 60.0, 0.05), (104, 120, 5, 20.0, 0.05), (40, 120, 2, 20.0, 0.05),
    (40, 120, 2, 20.0, 1.0), ("five", 200),
)  # fmt: skip
RULES = ("round-robin", "largest-trace", "information", "greedy", "costate-index")


def row(arguments: tuple, folder: Path) -> str:
    """One line of the table."""
    document = five(arguments[1]) if arguments[0] == "five" else tracking(*arguments)
    problem = read(document, folder)
    filled, _ = resolved(problem, 1e-4, Monitor())
    task = relaxed_task(filled, 1e-4, 2000, Monitor())
    began = time.process_time()
    whole = bound_whole(filled, task.sweep, task.relaxed, np.nan, Monitor(), walk=False)
    bound_seconds = time.process_time() - began
    began = time.process_time()
    solution = oc.solve(problem)
    seconds = time.process_time() - began
    r, best = solution.result, solution.result["lower_bound"]
    rules = []
    for name in RULES:
        other = oc.solve(problem, METHODS[name]())
        rules.append(f"{100 * (other.cost / best - 1):.1f}")
    bounds = f"{r['bounds']['relaxed']:.2f} | {r['bounds']['integer']:.2f}"
    rounds = whole.rounds if whole is not None else np.nan
    return (
        f"| {', '.join(map(str, arguments))} | {bounds} | {rounds} | {bound_seconds:.1f} | {solution.cost:.3f} "
        f"| {100 * (solution.cost / best - 1):.2f} | {seconds:.1f} | {' | '.join(rules)} |"
    )


def main() -> None:
    """The rows that are named, or all."""
    numbers = [int(x) for x in sys.argv[1:]] or range(len(ROWS))
    print("| instance | relaxed | whole looks | prices | s | cost | above, % | s | " + " | ".join(RULES) + " |")
    print("|---" * (8 + len(RULES)) + "|")
    with tempfile.TemporaryDirectory() as folder:
        row((4, 12, 1, 6.0, 0.05), Path(folder))  # compiles
        for i in numbers:
            print(row(ROWS[i], Path(folder)), flush=True)


if __name__ == "__main__":
    main()
