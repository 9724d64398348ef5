#!/usr/bin/env python3
"""Random schedules, legal and illegal: the library and the command line must say the same of each.

    scripts/campaign_callers.py --count 100

Families athans, vlambda and robust; illegal in weights, windows, horizon, names and numbers of sensors. Compared are
status, cost, bound and the class of the exit code, and for a refusal its words without the place. The exit code is 1
when any two differ.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import occontrol as oc
from occontrol.cli import run
from occontrol.core.solution import Status

ATHANS = """\
family: athans
horizon: {{start: 0, end: 4, intervals: {intervals}}}
plant: {{A: [[0, 1], [{stiffness}, -0.4]], noise: [[0, 0], [0, 0.5]], initial: {{covariance: {{diag: [1, 2]}}}}}}
sensors:
  - {{name: one, C: [[1, 0]], noise: [[{noise}]], cost: 0.3}}
  - {{name: two, C: [[0, 1]], noise: [[0.4]], cost: 0.1}}
  - {{name: three, C: [[1, 1]], noise: [[0.2]], cost: 0.5{windows}}}
{idle}select: {select}
objective: {{output: [[1, 0]]}}
"""
VLAMBDA = """\
family: vlambda
horizon: {{steps: 4, epoch: {epoch}}}
plant: {{F: [[1, 0.1], [{stiffness}, 1]], Q: {{diag: [0.1, 0.2]}}, initial: {{covariance: {{diag: [1, 2]}}}}}}
sensors: [{{name: one, H: [[1, 0]], R: {noise}}}, {{name: two, H: [[0, 1]], R: 0.4}},
          {{name: three, H: [[1, 1]], R: 0.7}}]
select: {select}
criterion: {{name: trace}}
"""
ROBUST = """\
family: robust
horizon: {{end: 4, slots: {slots}}}
plant: {{A: [[0, 1], [{stiffness}, -0.4]], B: [[0], [1]], K: [[{noise}, 0.1]],
        initial: {{center: [1, 0], weight: {{diag: [2, 1]}}, level: 1}}}}
sensors: [{{name: one, C: [[1, 0]]}}, {{name: two, C: [[0, 1]]}}, {{name: three, C: [[1, 1]]}}]
"""
NAMES = ("one", "two", "three")


def problem_text(family: str, draw: np.random.Generator) -> tuple[str, int, int]:
    """A problem file with the number of sensors at a time and the choices that fit its grid."""
    # few different ones: what is compared is the judgement of schedules
    select, values = int(draw.integers(1, 3)), {"stiffness": -1.0, "noise": float(draw.choice([0.1, 0.3]))}
    if family == "athans":
        idle = "  - idle\n" if draw.random() < 0.4 else ""
        windows = ", windows: [[0, 1.5], [2.5, 4]]" if draw.random() < 0.3 else ""
        return ATHANS.format(intervals=8, idle=idle, windows=windows, select=select, **values), select, 8
    if family == "vlambda":
        epoch = int(draw.integers(1, 3))
        return VLAMBDA.format(epoch=epoch, select=select, **values), select, 4 // epoch
    return ROBUST.format(slots=2, **values), 1, 2


def random_schedule(select: int, cells: int, draw: np.random.Generator) -> tuple[oc.Schedule, str]:
    """A schedule that is legal, but perhaps for a window, and then made wrong in one way or in none."""
    edges, weights = np.linspace(0.0, 4.0, cells + 1), np.zeros((cells, 3))
    usual = draw.permutation(3)[:select]
    for k in range(cells):
        weights[k, usual if draw.random() < 0.6 else draw.permutation(3)[:select]] = 1.0
    names: tuple[str, ...] = NAMES
    kind = str(draw.choice([
        "none", "none", "none", "between", "shares", "order", "sum", "range", "nothing", "late", "early", "beyond",
        "name", "unused", "twice",
    ]))  # fmt: skip
    k = int(draw.integers(cells))
    if kind == "between":
        edges[1:-1] += draw.uniform(-0.1, 0.1, cells - 1)
    elif kind == "shares":
        weights[:] = select / 3
    elif kind == "order":
        names, weights = names[::-1], weights[:, ::-1]
    elif kind == "sum":
        weights[k] = [1, 1, 1] if draw.random() < 0.5 else [0.4, 0, 0]
    elif kind == "range":
        weights[k, draw.integers(3)] = float(draw.choice([5.0, 1.01]))
    elif kind == "nothing":
        weights[k] = 0.0
    elif kind == "late":
        edges[0] += 0.2
    elif kind == "early":
        edges[-1] -= 0.2
    elif kind == "beyond":
        edges[-1] += 1.0
    elif kind in ("name", "unused"):
        names = ("one", "two", "thre")
        if kind == "unused":
            weights[:, 2] = 0.0
    elif kind == "twice":
        names = ("one", "two", "one")
    return oc.Schedule(edges, weights, names), kind


def write_csv(path: Path, schedule: oc.Schedule) -> None:
    """Write a schedule as somebody would by hand, neighbours that are alike on one line."""
    lines, first = ["start,end,sensors,weights"], 0
    for k, weights in enumerate(schedule.weights, 1):
        if k < len(schedule.weights) and np.array_equal(weights, schedule.weights[k]):
            continue
        used = [j for j in range(len(weights)) if weights[j] != 0]
        shares = "" if all(weights[j] == 1 for j in used) else ";".join(repr(float(weights[j])) for j in used)
        start, end = float(schedule.edges[first]), float(schedule.edges[k])
        lines.append(f"{start!r},{end!r},{';'.join(schedule.names[j] for j in used)},{shares}")
        first = k
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def words(lines: list[str]) -> tuple[str, ...]:
    """Messages without file and line, or the times that stand for them; the order is that of the places."""
    return tuple(sorted(line if line.startswith("  hint") else line.split(": ", 1)[-1] for line in lines))


def by_library(problem: Any, schedule: oc.Schedule) -> tuple:
    """(exit code, words) of a refusal, (exit code, status, cost, bound, message) otherwise."""
    try:
        solution = oc.certify(problem, schedule)
    except oc.OccontrolError as error:
        return error.exit_code, words(str(error).splitlines())
    numbers = solution.as_dict()
    return (solution.status.exit_code, numbers["status"], numbers["cost"], numbers["lower_bound"], numbers["message"])


def by_command(file: Path, schedule: Path) -> tuple:
    """The same from `occontrol certify`."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(["certify", str(file), str(schedule), "--json"])
    if not out.getvalue():
        quiet = ("certifying ", "compiling ")
        lines = [line for line in err.getvalue().splitlines() if not line.startswith(quiet)]
        return code, words(lines)
    numbers = json.loads(out.getvalue())
    return (code, numbers["status"], numbers["cost"], numbers["lower_bound"], numbers["message"])


def compare(family: str, count: int, seed: int = 1) -> tuple[Counter, list[str]]:
    """Try `count` schedules; how many ended how, and what differed."""
    ended: Counter = Counter()
    differences = []
    with tempfile.TemporaryDirectory() as folder:
        file, path = Path(folder) / "p.yaml", Path(folder) / "s.csv"
        for number in range(count):
            draw = np.random.default_rng([seed, number])
            text, select, cells = problem_text(family, draw)
            file.write_text(text, encoding="utf-8")
            schedule, kind = random_schedule(select, cells, draw)
            write_csv(path, schedule)
            library, command = by_library(oc.read_problem(file), schedule), by_command(file, path)
            ended["refused" if library[0] == 3 else str(library[1])] += 1
            same = len(library) == len(command) and all(
                abs(a - b) <= 1e-9 * abs(b) if isinstance(b, float) and b == b else a == b
                for a, b in zip(library, command, strict=True)
            )
            if not same:
                differences.append(f"{family} {number} ({kind}):\n  library {library}\n  command {command}")
    return ended, differences


def main() -> int:
    """Compare, count, say what differed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    wrong = 0
    for family in ("athans", "vlambda", "robust"):
        ended, differences = compare(family, options.count, options.seed)
        wrong += len(differences)
        usable = {str(status) for status in Status} & set(ended)
        print(f"{family}: {dict(ended)}, {len(differences)} different" + ("" if usable else ": nothing was certified"))
        print("\n".join(differences), end="\n" if differences else "")
    return 1 if wrong else 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
