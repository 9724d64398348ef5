"""Sensitivities of every shipped problem of family athans against differences; one line of markdown a problem.

    python scripts/campaign_sensitivity.py [problem ...] [--again 3]

'fixed' is the worst relative difference from central differences of the cost of the optimal policy held fixed (the
envelope theorem says that these are the derivatives of the optimum); 'again' from problems that are solved again, for
at most so many sensors, whose differences are only as good as the gap of the relaxation allows. Prices and noises.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest import mock

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402  (after the number of threads is set)

import occontrol as oc  # noqa: E402
import occontrol.families.athans.readings.sensitivity as of_readings  # noqa: E402
import occontrol.families.athans.sensitivity as of_rate  # noqa: E402
from occontrol.api import sensitivity  # noqa: E402
from occontrol.core.errors import OccontrolError  # noqa: E402
from occontrol.core.monitor import Monitor  # noqa: E402
from occontrol.core.scaled_signal import scaled  # noqa: E402
from occontrol.families.athans.integration.integrator import Integrator  # noqa: E402
from occontrol.families.athans.integration.relaxed import relax  # noqa: E402
from occontrol.families.athans.readings.fill import feasible_set, fill  # noqa: E402
from occontrol.families.athans.sensitivity import Sensitivities  # noqa: E402
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed  # noqa: E402
from occontrol.scheduling.sweep import Sweep  # noqa: E402

PROBLEMS = Path(__file__).resolve().parent.parent / "problems"
STEP = 2e-3  # of the logarithm of a noise
GAP, MOST = 1e-9, 3000


def optimum(problem, start: np.ndarray | None = None) -> tuple[float, np.ndarray]:
    """Cost and policy (N, M) of the relaxation, in the user's own states."""
    options = RelaxedOptions(GAP, MOST)
    if problem.takes_readings:
        filled = fill(problem)
        found = minimise_relaxed(Sweep(filled.recursion), feasible_set(problem), start, options, Monitor())
        return found.cost + filled.constant, found.weights
    found = relax(Integrator(problem, GAP), options, Monitor(), start).outcome
    return found.cost, found.weights


def differentiated(problem) -> tuple[Sensitivities, np.ndarray]:
    """Sensitivities of a problem, and the policy (N, M) that they are the derivatives at."""
    module, name = (of_readings, "minimise_relaxed") if problem.takes_readings else (of_rate, "relax")
    original, kept = getattr(module, name), []

    def watched(*words):
        found = original(*words)
        kept.append(getattr(found, "outcome", found).weights)
        return found

    with mock.patch.object(module, name, watched):
        return sensitivity(problem), kept[0]


def held(problem, policy: np.ndarray) -> float:
    """The cost of a policy (N, M)."""
    if problem.takes_readings:
        filled = fill(problem)
        return Sweep(filled.recursion).cost(policy) + filled.constant
    return Integrator(problem, GAP).evaluate(policy).cost


def changed(problem, j: int, what: str, by: float):
    """The problem with noise of sensor j times exp(by), or its price plus by."""
    sensors = list(problem.sensors)
    if what == "noise":
        root = np.exp(by / 2) * np.ones(sensors[j].rows)
        sensors[j] = replace(sensors[j], noise=scaled(sensors[j].noise, root, root))
    else:
        sensors[j] = replace(sensors[j], cost=float(sensors[j].cost.at(0.0)[0, 0]) + by)
    return replace(problem, sensors=replace(problem.sensors, sensors=tuple(sensors)))


def worst(problem, found, names: list[str], value: Callable) -> float:
    """The largest relative difference of derivatives from central differences of `value`."""
    most, index = 0.0, {s.name: j for j, s in enumerate(problem.sensors)}
    for name in names:
        for what in ("noise", "price"):
            derivative = found.sensors[name][what]
            # prices: a change of the cost by about a five thousandth of itself, and none below 0
            step = STEP if what == "noise" else 2e-4 * abs(found.cost) / max(abs(derivative), 1e-300)
            cost = problem.sensors[index[name]].cost
            if not derivative or (what == "price" and not (cost.constant and cost.at(0.0)[0, 0] >= step)):
                continue
            ends = [value(changed(problem, index[name], what, by)) for by in (-step, step)]
            most = max(most, abs((ends[1] - ends[0]) / (2 * step) / derivative - 1))
    return most


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", nargs="*")
    parser.add_argument("--again", type=int, default=3)
    options = parser.parse_args()
    names = options.problems or [p.stem for p in sorted(PROBLEMS.glob("*.yaml"))]
    print("| problem | gap of the relaxation | sensors | fixed | again | s |\n|---|---|---|---|---|---|", flush=True)
    for name in names:
        problem = oc.read_problem(PROBLEMS / f"{name}.yaml")
        if problem.family != "athans":
            continue
        began = time.process_time()
        try:
            found, policy = differentiated(problem)
        except OccontrolError as error:
            print(f"| {name} | | | {str(error).splitlines()[0]} | | |", flush=True)
            continue
        used = [s for s, row in found.sensors.items() if row["share"] is None or row["share"] > 1e-3]
        fixed = worst(problem, found, used, lambda p, v=policy: held(p, v))
        again = worst(problem, found, used[: options.again], lambda p, v=policy: optimum(p, v)[0])
        gap = (found.cost - found.lower_bound) / abs(found.cost)
        spent = time.process_time() - began
        print(f"| {name} | {gap:.1e} | {len(used)} | {fixed:.1e} | {again:.1e} | {spent:.0f} |", flush=True)


if __name__ == "__main__":
    main()
