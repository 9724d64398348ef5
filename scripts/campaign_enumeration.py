"""Whole solves of small random problems in far regimes against enumeration in 60 digits.

    python -m scripts.campaign_enumeration [count] [first seed]

Each problem is solved by the default method as a user would. Two judges share no code with the product: half of the
problems have `substeps: 1` and are judged by the recursion (tests/decimal_recursion.py), half are integrated as by
default and judged by exact flows (tests/decimal_flow.py). Every schedule on the solution's own grid is enumerated;
where the solver has added too many edges for that, every schedule on the edges of the file, whose costs no bound may
exceed either. Counted by regime: statuses, bounds above the optimum, costs that are off, certified and off,
costs further from continuous time than the accuracy that was asked for, refusals.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from decimal import Decimal

import numpy as np

from occontrol import solve
from occontrol.core.errors import OccontrolError
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.proof import MESHES
from tests.decimal_flow import Flows
from tests.decimal_problems import as_problem
from tests.decimal_recursion import REGIMES, Data, Judge, random_data

FAR = (*REGIMES, "plain", "short", "long", "unix")
ORIGIN = 1.7e9
MOST_EDGES = 6  # intervals of which every schedule is enumerated
ROUNDING = 1e-9  # of J: what the continuous check states at least


def far_data(rng: np.random.Generator, regime: str, running: bool) -> tuple[Data, float]:
    """A random problem of one of FAR, and the start of its clock."""
    data = random_data(rng, regime)
    if not running:
        data = replace(data, running=None)
    if regime == "unix":
        # lengths that a double at the origin resolves
        end = np.ceil(data.edges[-1] * 64) / 64
        return replace(data, edges=np.linspace(0.0, end, len(data.edges))), ORIGIN
    if regime not in ("short", "long"):
        return data, 0.0
    unit = 10.0 ** (rng.uniform(-9, -3) if regime == "short" else rng.uniform(3, 9))
    sensors = [(C, theta * unit, q / unit) for C, theta, q in data.sensors]
    running_weight = None if data.running is None else data.running / unit
    parts = {"A": data.A / unit, "noise": data.noise / unit, "edges": data.edges * unit}
    return replace(data, sensors=sensors, running=running_weight, **parts), 0.0


def far_problem(data: Data, origin: float, plain: bool) -> SchedulingProblem:
    """The product's problem of the judge's data."""
    problem = replace(as_problem(data), edges=origin + data.edges, predict_at=None)
    return problem if plain else replace(problem, integration=Integration())


def examine(rng: np.random.Generator, regime: str, plain: bool) -> tuple[Counter, list[str]]:
    """Counts of one problem, and what is wrong with it."""
    data, origin = far_data(rng, regime, plain)
    problem = far_problem(data, origin, plain)
    row = Counter(problems=1)
    try:
        found = solve(problem)
    except OccontrolError as error:
        return row + Counter(refused=1), [f"refused: {str(error).splitlines()[0]}"]
    r = found.result
    row[str(found.status)] += 1
    choice = [int(j) for j in np.argmax(found.schedule.weights, axis=1)]
    lengths = [float(h) for h in found.problem.steps]
    whole = len(lengths) <= MOST_EDGES
    row["enumerated on its grid" if whole else "enumerated on the file's edges"] += 1
    if plain:
        judge = Judge(data)
        true, best = judge.cost(found.schedule.weights), judge.optimum()[0]
    else:
        flows = Flows(data)
        true = flows.cost(choice, lengths)
        best = flows.optimum(lengths if whole else [float(h) for h in problem.steps])
        best = min(best, true)
    cost, size = r["cost"], abs(float(true))
    stated = r["allowance"] + (0.0 if plain else MESHES * r["integration_error"])
    top_stated = r["allowance"] + ROUNDING * size
    faults = []
    off = abs(float(true - Decimal(cost)))
    above = float(Decimal(r["lower_bound"]) - best)
    if off > stated:
        faults.append(f"cost off by {off / size:.3g}, stated {stated / size:.3g}")
        row["cost off"] += 1
        row["certified and off"] += str(found.status) == "certified"
    if above > stated:
        faults.append(f"bound above by {above / size:.3g}, stated {stated / size:.3g}")
        row["bound above"] += 1
    top = r["top"]
    if not plain and top["of"] == "continuous":
        over = float(Decimal(top["lower_bound"]) - best)
        if over > top_stated:
            faults.append(f"bound at the top above by {over / size:.3g}")
            row["bound at the top above"] += 1
        wrong = abs(float(true - Decimal(top["cost"])))
        if wrong > 1e-6 * size + r["allowance"]:
            faults.append(f"cost at the top off by {wrong / size:.3g}")
            row["cost at the top off"] += 1
        apart = abs(cost - top["cost"])
        row["checked in continuous time"] += 1
        if apart > 1e-5 * size:
            faults.append(f"further than the accuracy from continuous time: {apart / size:.3g}")
            row["beyond accuracy"] += 1
    if whole:
        row["optimal to the target"] += float(true - best) <= 1e-4 * size
    return row, [f"{found.status}: {fault}" for fault in faults]


def main() -> None:
    """Run the campaign and print what was found."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    table: dict[str, Counter] = {regime: Counter() for regime in FAR}
    for i in range(first, first + count):
        regime, plain = FAR[i % len(FAR)], bool(i // len(FAR) % 2)
        row, faults = examine(np.random.default_rng(i), regime, plain)
        table[regime] += row
        for fault in faults:
            print(i, regime, "one step" if plain else "integrated", fault, flush=True)
        if (i + 1 - first) % 10 == 0:
            print(i + 1 - first, "problems:", dict(sum(table.values(), Counter())), flush=True)
    for regime, row in table.items():
        print(regime, dict(row))
    print("all", dict(sum(table.values(), Counter())))


if __name__ == "__main__":
    main()
