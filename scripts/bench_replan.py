"""How long a new plan takes on the way: loops flown on simulated truth, warm. Writes its part of docs/bench.md.

    python scripts/bench_replan.py [--print]

Seconds are of the processor, one thread. Every loop is flown once before it is measured; the plans of a flight start
from the shares of the one before, as on a target. 'step' is a step without a plan: filter, and the prediction.
"""

from __future__ import annotations

import argparse
import datetime
import os
import re
import tempfile
import time
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402  (after the number of threads is set)
from table_montecarlo import orbit, plane  # noqa: E402

import occontrol as oc  # noqa: E402
from occontrol.families.athans.nonlinear.linearise import Replanning  # noqa: E402
from occontrol.families.athans.replanning.online import ReplanningLoop  # noqa: E402
from occontrol.families.athans.replanning.runs import Truths, luck_of  # noqa: E402

BENCH = Path(__file__).resolve().parent.parent / "docs" / "bench.md"
BEGIN, END = "<!-- new plans: begin -->", "<!-- new plans: end -->"
FLIGHTS = 5
TARGETS = {(6, 100): 20.0, (12, 400): 100.0}  # milliseconds, up to so many states and readings


def linear(n: int, M: int, N: int, seed: int = 1) -> str:
    """A seeded linear plant in discrete time, M scalar sensors with prices, or none."""
    g = np.random.default_rng(seed)
    F = g.standard_normal((n, n))
    F *= 0.98 / np.max(np.abs(np.linalg.eigvals(F)))
    lines = [
        f"  - {{name: s{j}, H: {[np.round(g.standard_normal(n), 6).tolist()]}, R: [[{g.uniform(0.2, 2):.4f}]], "
        f"cost: {g.uniform(0.05, 0.3):.4f}}}"
        for j in range(M)
    ]
    return f"""\
family: athans
name: linear
horizon: {{steps: {N}}}
plant: {{F: {np.round(F, 6).tolist()}, Q: {{identity: {n}, scale: 0.2}}, initial: {{covariance: {{identity: {n}}}}}}}
sensors:
{chr(10).join(lines)}
  - idle
objective: {{output: {{identity: {n}}}, running: {{identity: {n}, scale: 0.05}}}}
"""


CASES = {
    "bearings, three stations": (plane("bearings", 8), 5),
    "bearings, three stations, longer": (
        plane("bearings", 8).replace("end: 29, samples: 30", "end: 99, samples: 100"), 10),
    "orbit, eight looks": (orbit(5), 10),
    "linear, four sensors": (linear(6, 4, 100), 10),
    "linear, eight sensors": (linear(12, 8, 400), 40),
}  # fmt: skip


def measured(text: str, every: int) -> dict:
    """Milliseconds of plans and of plain steps along a few flights."""
    with tempfile.TemporaryDirectory() as home:
        path = Path(home) / "problem.yaml"
        path.write_text(text, encoding="utf-8")
        problem = oc.read_problem(path)
    solution = oc.solve(problem)
    loop = ReplanningLoop(problem, solution.schedule, Replanning(every=every))
    truths = Truths(loop.chain, luck_of(loop.chain, np.random.SeedSequence(1).spawn(FLIGHTS)))
    plans, steps = [], []
    for flight in range(FLIGHTS):
        loop.restart()
        while not loop.finished:
            seen = {j: truths.reading(loop.k, j) for j in map(loop.names.index, loop.next_sensors)}
            readings = {loop.names[j]: z[flight] for j, (z, there) in seen.items() if there[flight]}
            began = time.process_time()
            step = loop.step(readings)
            took = 1e3 * (time.process_time() - began)
            if flight:  # the first one warms up
                (steps if step.replan is None else plans).append(took)
    n, N = problem.states, problem.readings
    return {"n": n, "M": len(problem.sensors), "N": N, "plans": np.array(plans), "steps": np.array(steps)}


def main() -> None:
    """Measure, print, and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--print", action="store_true", help="write nothing")
    options = parser.parse_args()
    lines = [
        "## New plans on the way",
        "",
        f"Made by `python scripts/bench_replan.py` on {datetime.date.today()}: milliseconds of the processor, one",
        "thread, of a step of the loop that makes a plan, and of one that does not. Plans start from the shares of the",
        "one before.",
        "",
        "| problem | n | M | N | plans | median | 95 % | target | | a step without |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, (text, every) in CASES.items():
        found = measured(text, every)
        n, N, plans = found["n"], found["N"], found["plans"]
        target = next(limit for (most, longest), limit in TARGETS.items() if n <= most and longest >= N)
        middle = float(np.median(plans))
        lines.append(
            f"| {name} | {n} | {found['M']} | {N} | {len(plans)} | {middle:.1f} | {np.quantile(plans, 0.95):.1f} | "
            f"{target:g} | {'met' if middle < target else 'missed'} | {np.median(found['steps']):.2f} |"
        )
        print(lines[-1], flush=True)
    if options.print:
        return
    whole, part = BENCH.read_text(encoding="utf-8"), "\n".join([BEGIN, *lines, END])
    pattern = re.compile(re.escape(BEGIN) + ".*?" + re.escape(END), re.DOTALL)
    whole = pattern.sub(lambda _: part, whole) if BEGIN in whole else whole.rstrip("\n") + "\n\n" + part + "\n"
    BENCH.write_text(whole, encoding="utf-8")


if __name__ == "__main__":
    main()
