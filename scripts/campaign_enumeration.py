"""Whole solves of small random problems in far regimes against enumeration in 60 digits.

    python -m scripts.campaign_enumeration [count] [first seed]

Each problem is solved by the default method as a user would. Two judges share no code with the product. A third of the
problems has `substeps: 1` and is judged by the recursion (tests/decimal_recursion.py); a third is integrated on the
edges of the file (`refine: false`) and a third in every default, both judged by exact flows (tests/decimal_flow.py).
Every schedule on the solution's own grid is enumerated. Where the solver has added too many edges for that, bounds are
judged by the best of many: every schedule on the edges of the file, the solver's own, and its relaxed policy as a
schedule that switches fast, whose cost comes close to any true bound in continuous time. Counted by regime: statuses,
bounds above the optimum, costs that are off, certified and off, costs further from continuous time than the accuracy
that was asked for (with and without the message that says so), refusals, and solves that TIME_LIMIT ended (slow).
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import replace
from decimal import Decimal

import numpy as np

from occontrol import solve
from occontrol.core.errors import OccontrolError
from occontrol.core.solution import Solution
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.proof import MESHES
from tests.decimal_flow import Flows
from tests.decimal_recursion import REGIMES, Data, Judge, random_data
from tests.invariances import ORIGIN, coarse, far_problem

FAR = (*REGIMES, "plain", "short", "long", "unix")
MODES = ("one step", "integrated", "default")
MOST_EDGES = 6  # intervals of which every schedule is enumerated
PARTS = 4  # turns that a fast switching schedule takes on an interval
MOST_FLOWS = 150  # spans that it may consist of
SHORTEST = 1e-6  # share of an interval that it still switches for
TIME_LIMIT = 60.0
FASTER = 64.0  # horizons with very precise sensors are so much shorter: the exact check follows their fast transients
LIMITED = "was asked for"  # what the message says where the cost is less accurate than that
ROUNDING = 1e-9  # of J: what the continuous check states at least


def far_data(rng: np.random.Generator, regime: str, running: bool) -> tuple[Data, float]:
    """A random problem of one of FAR, and the start of its clock."""
    data = random_data(rng, regime)
    if not running:
        data = replace(data, running=None)
    if regime == "very precise":
        return replace(data, A=data.A * FASTER, edges=data.edges / FASTER), 0.0
    if regime == "unix":
        return replace(data, edges=coarse(data.edges)), ORIGIN
    if regime not in ("short", "long"):
        return data, 0.0
    unit = 10.0 ** (rng.uniform(-9, -3) if regime == "short" else rng.uniform(3, 9))
    sensors = [(C, theta * unit, q / unit) for C, theta, q in data.sensors]
    running_weight = None if data.running is None else data.running / unit
    parts = {"A": data.A / unit, "noise": data.noise / unit, "edges": data.edges * unit}
    return replace(data, sensors=sensors, running=running_weight, **parts), 0.0


def switching(weights: np.ndarray, lengths: list[float]) -> tuple[list[int], list[float]]:
    """A relaxed policy (N, M) as a schedule that gives each sensor its share of an interval in PARTS turns."""
    choice, spans = [], []
    for row, length in zip(weights, lengths, strict=True):
        used = np.flatnonzero(row > SHORTEST)
        turns = PARTS if len(used) > 1 else 1
        shares = row[used] / np.sum(row[used]) * (length / turns)
        choice += turns * [int(j) for j in used]
        spans += turns * [float(x) for x in shares]
    return choice, spans


def best_known(problem: SchedulingProblem, found: Solution, flows: Flows, row: Counter) -> tuple[Decimal, ...]:
    """The schedule's cost, the least J on its grid, and the least J of schedules on any, as far as they are known."""
    choice = [int(j) for j in np.argmax(found.schedule.weights, axis=1)]
    lengths = [float(h) for h in found.problem.steps]
    whole = len(lengths) <= MOST_EDGES
    row["enumerated" if whole else "best of many"] += 1
    true = flows.cost(choice, lengths)
    best = min(true, flows.optimum(lengths if whole else [float(h) for h in problem.steps]))
    fast = switching(found.arrays["relaxed_weights"], lengths)
    if len(set(zip(*fast, strict=True))) > MOST_FLOWS:
        return true, best, best
    row["switched fast"] += 1
    # spans add up to the horizon but for rounding; what a bound loses by that is far below the gap
    return true, best, min(best, flows.cost(*fast))


def examine(rng: np.random.Generator, regime: str, mode: str) -> tuple[Counter, list[str]]:
    """Counts of one problem, and what is wrong with it."""
    plain = mode == "one step"
    data, origin = far_data(rng, regime, plain)
    problem = far_problem(data, origin, mode)
    row = Counter(problems=1)
    began = time.monotonic()
    try:
        found = solve(problem, RelaxRoundPolish(time_limit=TIME_LIMIT))
    except OccontrolError as error:
        return row + Counter(refused=1), [f"refused: {str(error).splitlines()[0]}"]
    r = found.result
    row[str(found.status)] += 1
    row["slow"] += time.monotonic() - began > TIME_LIMIT
    if plain:
        judge = Judge(data)
        true, best = judge.cost(found.schedule.weights), judge.optimum()[0]
        anywhere = best
        row["enumerated"] += 1
    else:
        true, best, anywhere = best_known(problem, found, Flows(data), row)
    size = abs(float(true))
    stated = r["allowance"] + (0.0 if plain else MESHES * r["integration_error"])
    faults = []

    def fault(kind: str, by: float, limit: float) -> None:
        faults.append(f"{kind} by {by / size:.3g}, stated {limit / size:.3g}")
        row[kind] += 1

    off = abs(float(true - Decimal(r["cost"])))
    above = float(Decimal(r["lower_bound"]) - best)
    if off > stated:
        fault("cost off", off, stated)
        row["certified and off"] += str(found.status) == "certified"
    if above > stated:
        fault("bound above", above, stated)
    row["optimal to the target"] += float(true - best) <= 1e-4 * size
    if not plain and r["top"]["of"] == "continuous":
        row["checked in continuous time"] += 1
        limit = r["allowance"] + ROUNDING * size
        over = float(Decimal(r["top"]["lower_bound"]) - anywhere)
        wrong = abs(float(true - Decimal(r["top"]["cost"])))
        apart = abs(r["cost"] - r["top"]["cost"])
        if over > limit:
            fault("bound at the top above", over, limit)
        if wrong > 1e-6 * size + r["allowance"]:
            fault("cost at the top off", wrong, r["allowance"])
        if apart > 1e-5 * size:
            row["beyond accuracy, said so" if LIMITED in found.message else "beyond accuracy"] += 1
            faults.append(f"apart from continuous time by {apart / size:.3g}, said: {LIMITED in found.message}")
    return row, [f"{found.status}: {each}" for each in faults]


def main() -> None:
    """Run the campaign and print what was found."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    table: dict[str, Counter] = {regime: Counter() for regime in FAR}
    for i in range(first, first + count):
        regime, mode = FAR[i % len(FAR)], MODES[i // len(FAR) % len(MODES)]
        row, faults = examine(np.random.default_rng(i), regime, mode)
        table[regime] += row
        for fault in faults:
            print(i, regime, mode, fault, flush=True)
        if (i + 1 - first) % 10 == 0:
            print(i + 1 - first, "problems:", dict(sum(table.values(), Counter())), flush=True)
    for regime, row in table.items():
        print(regime, dict(row))
    print("all", dict(sum(table.values(), Counter())))


if __name__ == "__main__":
    main()
