"""Random problems of readings, in discrete time and sampled, against the enumeration of all their schedules.

The judge is tests/plain_readings.py, which shares no code with the product. Run from the project's folder:

    python -m scripts.campaign_readings [count] [seed]

Counts costs that are off, bounds above the optimum, schedules that are not optimal, and the gaps of the plain and of
the strengthened bound.
"""

from __future__ import annotations

import json
import sys
import tempfile
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from occontrol.api import read_problem, solve
from occontrol.core.errors import InfeasibleError
from tests.plain_readings import PlainReadings, random_document

MOST_SCHEDULES = 5000


def enumerated(plain: PlainReadings, most: int) -> list | None:
    """All schedules; None where there are more than `most`."""
    schedules = list(islice(plain.schedules(), most + 1))
    return schedules if len(schedules) <= most else None


def as_read(document: dict) -> Any:
    """The problem that a file with this document is."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "p.json"
        path.write_text(json.dumps(document))
        return read_problem(path)


def judged(document: dict, most: int = MOST_SCHEDULES) -> dict | None:
    """What a solve says of a problem beside the truth; None where there are too many schedules."""
    plain = PlainReadings(document)
    schedules = enumerated(plain, most)
    if schedules is None:
        return None
    problem = as_read(document)
    try:
        solution = solve(problem)
    except InfeasibleError:
        return {"infeasible": True, "right": not schedules}
    best = min(plain.cost(s) for s in schedules)
    names = [s["name"] for s in plain.sensors]
    key = "k" if plain.discrete else "t"
    own = [tuple(names.index(x) for x in entry["sensors"] if x in names) for entry in solution.result["schedule"]]
    assert [entry[key] for entry in solution.result["schedule"]] == plain.times
    r = solution.result
    return {
        "infeasible": False,
        "status": str(solution.status),
        "legal": own in schedules,
        "off": abs(plain.cost(own) - r["cost"]) / abs(r["cost"]),
        "above": (r["lower_bound"] - best) / abs(best),
        "relaxed above": (r["relaxed_lower_bound"] - best) / abs(best),
        "excess": (r["cost"] - best) / abs(best),
        "plain gap": (r["cost"] - r["relaxed_lower_bound"]) / abs(r["cost"]),
        "gap": r["relative_gap"],
        "schedules": len(schedules),
    }


def main() -> None:
    """Run the campaign and print the counts."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    found: list[dict] = []
    while len(found) < count:
        document = random_document(rng, budget=rng.random() < 0.3)
        result = judged(document)
        if result is not None:
            found.append(result)
            if result["infeasible"]:
                print(len(found), "infeasible", "as it is" if result["right"] else "WRONG")
            elif result["off"] > 1e-12 or result["above"] > 1e-9 or not result["legal"] or result["excess"] > 1e-9:
                print(len(found), {k: v for k, v in result.items() if k != "schedules"}, json.dumps(document)[:100])
    solved = [f for f in found if not f["infeasible"]]

    def column(name: str) -> np.ndarray:
        return np.array([f[name] for f in solved])

    off, above, excess = column("off"), column("above"), column("excess")
    plain, gap = 100 * np.median(column("plain gap")), 100 * np.median(column("gap"))
    statuses = np.unique([f["status"] for f in solved], return_counts=True)
    print(f"{len(found)} problems, {len(found) - len(solved)} infeasible, {int(column('schedules').sum())} schedules")
    print("statuses:", ", ".join(f"{name} {number}" for name, number in zip(*statuses, strict=True)))
    print(f"cost off by at most {off.max():.2g} relative, by more than 1e-12 in {(off > 1e-12).sum()}")
    print(f"bounds above the optimum by more than 1e-9: {(above > 1e-9).sum()}, the largest {above.max():.2g}")
    print(f"optimal schedules: {(excess <= 1e-9).sum()} of {len(solved)}, worst {100 * excess.max():.3g} %")
    print(f"median gap: plain {plain:.3g} %, with all bounds {gap:.3g} %")


if __name__ == "__main__":
    main()
