"""Problem x method: cost, bound, gap, switches, seconds; written to docs/results.md.

    python scripts/table.py [problem ...] [--limit 180]

Runs every method of the athans family on every shipped problem of that family (collocation up to six states, with a
time limit), and prints the table as it grows.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import os
import platform
from pathlib import Path

from occontrol.api import choose_method, solve
from occontrol.core.errors import OccontrolError
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.core.versions import versions

ROOT = Path(__file__).resolve().parent.parent
HEAD = (
    "problem",
    "n",
    "M",
    "N",
    "method",
    "status",
    "cost",
    "bound",
    "gap %",
    "continuous cost",
    "bound",
    "gap %",
    "switches",
    "s",
)


def athans_problems() -> list[str]:
    """Names of the shipped problems of the athans family, those of many targets apart."""
    texts = {p.stem: p.read_text() for p in sorted((ROOT / "problems").glob("*.yaml"))}
    return [name for name, text in texts.items() if "family: athans" in text and "target_models:" not in text]


def row(name: str, problem, method: str, solution: Solution | str) -> list[str]:
    """One line of the table; a string instead of a solution is the reason why there is none."""
    number = problem.readings if problem.takes_readings else problem.intervals
    sizes = [name, str(problem.states), str(len(problem.sensors)), str(number), method]
    if isinstance(solution, str):
        return [*sizes, solution, *[""] * (len(HEAD) - len(sizes) - 1)]
    r = solution.result
    continuous = ["", "", ""]
    if not problem.takes_readings:
        c = r["continuous"]
        continuous = [f"{c['cost']:.7g}", rounded_down(c["lower_bound"], 7), f"{100 * c['relative_gap']:.3g}"]
    return [
        *sizes,
        str(solution.status),
        f"{r['cost']:.7g}",
        rounded_down(r["lower_bound"], 7),
        f"{100 * r['relative_gap']:.3g}",
        *continuous,
        str(r["switches"]),
        f"{solution.seconds:.1f}",
    ]


def main() -> None:
    """Fill the table."""
    from occontrol.api import read_problem
    from occontrol.families.athans.methods import METHODS

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problems", nargs="*", default=athans_problems())
    parser.add_argument("--limit", type=float, default=180.0, help="seconds for collocation")
    options = parser.parse_args()
    rows = []
    for name in options.problems:
        problem = read_problem(ROOT / "problems" / f"{name}.yaml")
        for method in METHODS:
            if method == "collocation" and problem.states > 6:
                continue
            chosen = choose_method(problem, method)
            if method == "collocation":
                chosen = dataclasses.replace(chosen, time_limit=options.limit)
            try:
                solution: Solution | str = solve(problem, chosen)
            except OccontrolError as error:
                solution = str(error).splitlines()[0]
            rows.append(row(name, problem, method, solution))
            print(" | ".join(rows[-1]), flush=True)
    if options.problems != athans_problems():
        return
    used = versions()
    lines = [
        "# Results: problem by method",
        "",
        f"Made by `python scripts/table.py` on {datetime.date.today()}: {platform.machine()}, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, " + ", ".join(f"{k} {v}" for k, v in used.items()) + ".",
        "",
        "Cost, bound and gap are of the problem on its grid; the second three are of the independent re-integration",
        "in continuous time; discrete time and readings have none, there N is the number of readings. The bound of a",
        "schedule is the better of its own and the relaxation's. `collocation` stands on its own bound only, so its",
        "gap says how far its policy is proven, not how far it is off.",
        "",
        "| " + " | ".join(HEAD) + " |",
        "|" + "---|" * len(HEAD),
        *("| " + " | ".join(r) + " |" for r in rows),
        "",
    ]
    (ROOT / "docs" / "results.md").write_text("\n".join(lines))


if __name__ == "__main__":
    main()
