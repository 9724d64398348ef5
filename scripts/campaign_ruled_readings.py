"""Random problems of readings with rules, against the enumeration of all their schedules.

    python -m scripts.campaign_ruled_readings [count] [seed] [criteria]

With the word criteria every problem has another one than the trace, in turn, and one of them is a limit of the peak.
The judges are tests/plain_readings.py and tests/plain_rules_of_readings.py, which share no code with the product.
"""

from __future__ import annotations

import json
import sys
from collections import Counter

import numpy as np

from occontrol.api import certify, solve
from occontrol.core.errors import InfeasibleError, ProblemError
from scripts.campaign_criterion_files import NAMES, stated
from scripts.campaign_readings import as_read, enumerated
from tests.plain_readings import PlainReadings, random_document
from tests.plain_rules_of_readings import PlainRules, with_rules

MOST_SCHEDULES = 800


def judged(document: dict, most: int = MOST_SCHEDULES, tried: int = 3) -> dict | None:
    """What solve and certify say beside the truth; None where there are too many schedules."""
    plain = PlainRules(document)
    everything = enumerated(plain.plain, most)
    if everything is None:
        return None
    kept = [s for s in everything if plain.keeps(s)]
    problem = as_read(document)
    try:
        solution = solve(problem)
    except InfeasibleError:
        return {"infeasible": True, "right": not kept, "schedules": len(everything)}
    best = min((plain.value(s) for s in kept), default=np.inf)
    absolute = document["objective"].get("criterion", {}).get("name") in ("logdet", "log-trace")
    names = [s["name"] for s in plain.plain.sensors]
    own = [tuple(names.index(x) for x in entry["sensors"] if x in names) for entry in solution.result["schedule"]]
    r, scale = solution.result, 1 + abs(best) if absolute else max(abs(best), 1e-12)
    refused = 0
    for s in everything[:: max(1, len(everything) // tried)]:
        weights = np.zeros((len(s), len(problem.sensors)))
        for k, chosen in enumerate(s):
            weights[k, list(chosen)] = 1.0
            if problem.sensors[len(problem.sensors) - 1].is_idle:
                weights[k, -1] = plain.places - len(chosen)
        try:
            found = certify(problem, problem.make_schedule(problem.edges, weights))
            right = plain.keeps(s) and abs(found.cost - plain.value(s)) <= 1e-9 * (absolute + abs(plain.value(s)))
            right = right and found.result["lower_bound"] <= best + 1e-9 * scale
        except ProblemError:
            right = not plain.keeps(s)
        refused += not right
    again = plain.value(own)
    # a volume loses the digits that its X is ill-conditioned by
    room = np.finfo(float).eps * plain.plain.condition if absolute else 0.0
    return {
        "infeasible": False,
        "status": str(solution.status),
        "legal": own in kept,
        "off": max(abs(again - r["cost"]) / scale - room, 0.0),
        "above": (r["lower_bound"] - best) / scale,
        "relaxed above": (r["relaxed_lower_bound"] - best) / scale,
        "excess": (r["cost"] - best) / scale,
        "proven": r["proven_optimal"],
        "switching": abs(r["switching_cost"] - plain.switching(own)),
        "certify wrong": refused,
        "schedules": len(everything),
    }


def with_criterion(rng: np.random.Generator, name: str, most_readings: int = 5) -> dict:
    """A random problem with rules, by a criterion that is not the trace; "limit" is one of a peak."""
    while True:
        document = random_document(rng, most_readings)
        if name in ("peak", "limit"):
            document["horizon"].pop("predict_at", None)
        ruled = with_rules(rng, document)
        if ruled["objective"]["minimise"] != "observation" and "max_error" not in ruled["constraints"]:
            break
    if enumerated(PlainReadings(document), MOST_SCHEDULES):
        ruled["objective"]["criterion"] = stated(name, document, rng)
    return ruled


def wrong(found: dict) -> bool:
    """Whether anything that a solve says is not so."""
    if found["infeasible"]:
        return not found["right"]
    return (
        found["status"] != "certified" or not found["legal"] or not found["proven"] or found["certify wrong"] > 0
        or found["off"] > 1e-11 or found["switching"] > 1e-12 or found["excess"] > 2e-6
        or found["above"] > 1e-9 or found["relaxed above"] > 1e-9
    )  # fmt: skip


def main() -> None:
    """Run the campaign and print the counts."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    criteria = NAMES[1:] if "criteria" in sys.argv else ()
    rng, counts, done = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0), Counter(), 0
    while done < count:
        if criteria:
            document = with_criterion(rng, criteria[done % len(criteria)])
        else:
            document = with_rules(rng, random_document(rng, 5))
        found = judged(document)
        if found is None or (criteria and "criterion" not in document["objective"]):
            continue
        done += 1
        counts["schedules"] += found["schedules"]
        counts["infeasible" if found["infeasible"] else found["status"]] += 1
        if wrong(found):
            counts["WRONG"] += 1
            print(done, found, json.dumps(document), flush=True)
    print(done, dict(counts))


if __name__ == "__main__":
    main()
