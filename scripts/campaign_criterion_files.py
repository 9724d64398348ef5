"""Random problem files of readings by every criterion, against the enumeration of all their schedules.

The judges are tests/plain_readings.py and tests/plain_criteria.py, which share no code with the product. Run from the
project's folder:

    python -m scripts.campaign_criterion_files [count] [seed]

Counts costs that are off, bounds above the optimum, schedules that are not optimal, and wrong words on limits.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np

from occontrol.api import solve
from occontrol.core.errors import InfeasibleError, SolveFailed
from scripts.campaign_readings import as_read, enumerated
from tests.plain_readings import PlainReadings, random_document

MOST_SCHEDULES = 700
NAMES = ("trace", "log-trace", "logdet", "largest-eigenvalue", "schatten", "peak", "limit")


def stated(name: str, document: dict, rng: np.random.Generator) -> dict[str, Any]:
    """A criterion for a document; a limit is set where some schedules keep it and others do not."""
    if name in ("trace", "log-trace", "logdet", "largest-eigenvalue"):
        return {"name": name}
    if name == "schatten":
        return {"name": name, "p": float(rng.choice([1.0, 1.5, 4.0, 8.0]))}
    times = PlainReadings(document).times
    peak: dict[str, Any] = {"name": "peak", "at": str(rng.choice(["posterior", "prior"]))}
    if rng.random() < 0.5:
        peak["from"] = float(times[int(rng.integers(0, len(times)))])
    if name == "limit":
        plain = PlainReadings({**document, "objective": {**document["objective"], "criterion": peak}})
        free = {**document["objective"], "cost_weight": 0.0, "criterion": peak}
        free.pop("running", None)
        free.pop("running_at", None)
        values = [PlainReadings({**document, "objective": free}).cost(s) for s in plain.schedules()]
        peak["limit"] = float(np.quantile(values, 0.3)) * 1.0001 if rng.random() < 0.8 else 0.98 * min(values)
    return peak


def judged(document: dict, name: str, rng: np.random.Generator) -> dict | None:
    """What a solve says beside the truth; None where there are too many schedules, or no cost at all."""
    if "predict_at" in document["horizon"] and name in ("peak", "limit"):
        document = {**document, "horizon": {k: v for k, v in document["horizon"].items() if k != "predict_at"}}
    schedules = enumerated(PlainReadings(document), MOST_SCHEDULES)
    if not schedules:
        return None
    document = {**document, "objective": {**document["objective"], "criterion": stated(name, document, rng)}}
    plain = PlainReadings(document)
    costs = [plain.cost(s) for s in schedules]
    best = min(costs)
    if np.isneginf(best):
        return None
    problem = as_read(document)
    try:
        solution = solve(problem)
    except InfeasibleError as error:
        return {"off": 0.0, "above": 0.0, "excess": 0.0, "right": not np.isfinite(best) and "least peak" in str(error)}
    except SolveFailed:
        return {"off": 0.0, "above": 0.0, "excess": 0.0, "right": False}
    names, key = [s["name"] for s in plain.sensors], "k" if plain.discrete else "t"
    r = solution.result
    own = [tuple(names.index(x) for x in entry["sensors"] if x in names) for entry in r["schedule"]]
    assert [entry[key] for entry in r["schedule"]] == plain.times
    size, again = 1 + abs(best), plain.cost(own)
    # a volume loses the digits that its X is ill-conditioned by, here and in the judge
    room = np.finfo(float).eps * plain.condition if name == "logdet" else 0.0
    return {
        "off": max(abs(again - r["cost"]) / size - room, 0.0),
        "above": max(r["lower_bound"], r["relaxed_lower_bound"]) / size - best / size,
        "excess": (r["cost"] - best) / size,
        "right": str(solution.status) in ("certified", "feasible", "limit") and own in schedules,
    }


def main() -> None:
    """Run the campaign and print one line a criterion; ends with exit code 1 where something is wrong."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    found: dict[str, list[dict]] = {name: [] for name in NAMES}
    while min(len(each) for each in found.values()) < count:
        document = random_document(rng, 4, budget=rng.random() < 0.2)
        for name in NAMES:
            one = judged(document, name, rng)
            if one is not None and len(found[name]) < count:
                found[name].append(one)
                if one["off"] > 1e-12 or one["above"] > 1e-10 or not one["right"]:
                    print(name, one, json.dumps(document)[:2000])
    wrong = 0
    for name, each in found.items():
        off, above, excess, right = (np.array([e[k] for e in each]) for k in ("off", "above", "excess", "right"))
        wrong += int(np.sum(above > 1e-10)) + int(np.sum(~right))
        print(
            f"{name:20s} {len(each)} problems, cost off by at most {off.max():.1e} ({int(np.sum(off > 1e-12))} above "
            f"1e-12), bounds above the optimum {int(np.sum(above > 1e-10))}, best schedule {int(np.sum(excess < 1e-9))}"
            f", wrong words {int(np.sum(~right))}"
        )
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
