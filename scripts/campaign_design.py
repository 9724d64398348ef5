"""Random experiments without a prior, against the enumeration of all their schedules.

    python -m scripts.campaign_design [COUNT] [SEED] [free | readings]

Of continuous sensing with rules of every kind, with the word `free` without any; of readings with rules. The judge is
tests/plain_design.py, which shares no code with the product.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from typing import Any

import numpy as np

import occontrol as oc
from occontrol.core.errors import InfeasibleError, OccontrolError, ProblemError, SolveFailed
from scripts.campaign_readings import as_read, enumerated
from tests.plain_design import BlindRules, blind_document, random_experiment

MOST = 800  # schedules of readings
EXACT = {"name": "schedule", "exact": {"relative_gap": 1e-6, "max_nodes": 20000, "time_limit": 60}}
ROOM = 1e-9  # of the cost, times what its outputs are conditioned by


def compared(seed: int, ruled: bool) -> str:
    """Proven, best, infeasible, refused, or what is wrong."""
    e = random_experiment(seed, 6, ruled)
    try:
        problem = as_read(e.document)
    except ProblemError as error:
        return f"refused: {error.mistakes[0].what}"
    best, count = e.optimum()
    return _judged(seed, problem, best, count, e.document)


def _judged(seed: int, problem: Any, best: float, count: int, document: dict) -> str:
    """What solve and certify say beside the truth."""
    try:
        solution = oc.solve(problem)
    except InfeasibleError:
        return "infeasible" if not count else f"WRONG {seed}: infeasible, enumeration has {best}"
    except SolveFailed:
        return "not decided" if not count else f"WRONG {seed}: none found, enumeration has {best}"
    r = solution.result
    signed = document["objective"]["criterion"]["name"] in ("logdet", "log-trace")
    size = max(1.0, abs(best)) if signed else abs(best)
    if not count:
        return f"WRONG {seed}: {r['cost']}, enumeration has none"
    if solution.status == "disagrees" or not abs(r["cost"] - best) <= 1e-6 * size:
        return f"WRONG {seed}: {solution.status} {r['cost']}, enumeration {best}, {count} words"
    if not r["lower_bound"] <= best + ROOM * size:
        return f"WRONG {seed}: bound {r['lower_bound']} above {best}"
    again = oc.certify(problem, solution.schedule)
    if again.status == "disagrees" or abs(again.cost - r["cost"]) > 1e-9 * size:
        return f"WRONG {seed}: certify says {again.status} {again.cost}, solve {r['cost']}"
    return "proven" if r["proven_optimal"] else "best, not proven"


def compared_readings(seed: int) -> str:
    """The same of readings; skipped where there are too many schedules."""
    rng = np.random.default_rng((seed, 31))
    document = blind_document(rng)
    judge = BlindRules(document)
    everything = enumerated(judge.plain, MOST)
    if everything is None:
        return "too many"
    costs = [judge.value(s) for s in everything if judge.keeps(s)]
    best, count = min(costs, default=np.inf), int(np.sum(np.isfinite(costs)))
    document["method"] = EXACT
    try:
        problem = as_read(document)
    except ProblemError as error:
        return f"refused: {error.mistakes[0].what}"
    return _judged(seed, problem, best, count, document)


def main() -> int:
    """Run and report; 1 where something differs."""
    given = [int(a) for a in sys.argv[1:] if a.isdigit()]
    count, first = given + [60, 0][len(given) :]
    began, found = time.perf_counter(), Counter()
    for seed in range(first, first + count):
        try:
            readings = "readings" in sys.argv
            said = compared_readings(seed) if readings else compared(seed, "free" not in sys.argv)
        except OccontrolError as error:
            said = f"WRONG {seed}: {error}"
        found[said.split(":")[0] if said.startswith("refused") else said] += 1
        if said.startswith("WRONG") or (said.startswith("refused") and found["refused"] < 6):
            print(said, flush=True)
    print(f"{dict(found)} in {time.perf_counter() - began:.0f} s")
    return int(any(said.startswith("WRONG") for said in found))


if __name__ == "__main__":
    sys.exit(main())
