"""How long a whole solve takes beside another checkout of this project, problem by problem, in turn.

    python -m scripts.bench_before OTHER [--runs 7] [--write]

OTHER is a folder with an earlier edition. One process for each edition, one thread, everything compiled before the
first run that counts; each problem is read and solved once by the one, once by the other, and so on. Seconds are those
of the process, not of the clock. With --write the table goes into docs/bench.md, between its marks.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parent.parent
BEGIN, END = "<!-- whole solves: begin -->", "<!-- whole solves: end -->"
HEAD = ("problem", "n", "M", "N", "before, s", "now, s", "ratio, median", "ratio, least", "cost before", "cost now")
WORK = """
import json, sys, time
from occontrol.api import read_problem, solve
for line in sys.stdin:
    problem = read_problem(line.strip())
    began = time.process_time()
    found = solve(problem)
    spent = time.process_time() - began
    sizes = [problem.states, len(problem.sensors), problem.intervals]
    print(json.dumps({"seconds": spent, "cost": found.result["cost"], "sizes": sizes}), flush=True)
"""


class Edition:
    """A process that solves problems with the package of one folder.

    Parameters
    ----------
    folder : with `occontrol` and `problems`
    """

    def __init__(self, folder: Path):
        self.folder = folder
        threads = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
        where = {**os.environ, **threads, "PYTHONPATH": str(folder)}
        command = [sys.executable, "-c", WORK]
        self.process = subprocess.Popen(command, env=where, stdin=-1, stdout=-1, text=True, cwd=folder)

    def solve(self, name: str) -> dict:
        """Seconds, cost and sizes of one solve."""
        to, back = self.process.stdin, self.process.stdout
        if to is None or back is None:
            raise RuntimeError("the process has no pipes")
        to.write(f"{self.folder / 'problems' / name}.yaml\n")
        to.flush()
        return json.loads(back.readline())


def main() -> None:
    """Time both editions and print the table."""
    from scripts.table import athans_problems

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path)
    parser.add_argument("problems", nargs="*", help="all that both have, if left out")
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--write", action="store_true", help="into docs/bench.md")
    options = parser.parse_args()
    before, now = Edition(options.other.resolve()), Edition(ROOT)
    rows = []
    both = [name for name in athans_problems() if (options.other / "problems" / f"{name}.yaml").exists()]
    for name in options.problems or both:
        pairs = [(before.solve(name), now.solve(name)) for _ in range(options.runs + 2)][2:]
        old, new = ([p[i]["seconds"] for p in pairs] for i in (0, 1))
        ratios = [b / a for a, b in zip(old, new, strict=True)]
        sizes = [str(s) for s in pairs[0][1]["sizes"]]
        seconds = [f"{median(old):.3f}", f"{median(new):.3f}", f"{median(ratios):.2f}", f"{min(new) / min(old):.2f}"]
        costs = [f"{pairs[0][i]['cost']:.8g}" for i in (0, 1)]
        rows.append([name, *sizes, *seconds, *costs])
        print(" | ".join(rows[-1]), flush=True)
    if options.write:
        write(rows, options.runs)


def write(rows: list[list[str]], runs: int) -> None:
    """Put the table between its marks in docs/bench.md, or at its end."""
    path = ROOT / "docs" / "bench.md"
    text = path.read_text()
    lines = [
        BEGIN,
        "## Whole solves beside the edition without integration steps",
        "",
        f"Made by `python -m scripts.bench_before` on {datetime.date.today()}: {runs} runs of each edition in turn",
        "after two that do not count, one thread, processor seconds of `solve` (default method).",
        "'before' has one step of integration an interval, so its costs are further from those of continuous time.",
        "'ratio, median' is of the pairs, 'ratio, least' that of the fastest runs.",
        "",
        "| " + " | ".join(HEAD) + " |",
        "|" + "---|" * len(HEAD),
        *("| " + " | ".join(row) + " |" for row in rows),
        END,
    ]
    block = "\n".join(lines)
    if BEGIN in text:
        head, rest = text.split(BEGIN)
        text = head + block + rest.split(END)[1]
    else:
        text = text.rstrip("\n") + "\n\n" + block + "\n"
    path.write_text(text)


if __name__ == "__main__":
    main()
