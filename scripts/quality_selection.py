"""Schedules of readings against greedy, exchanges from many starts and a minute of local search; and their bounds.

    python -m scripts.quality_selection [seconds]

Choose m of M scalar sensors at each of T steps, n random states of spectral radius rho; the sum of posterior traces
counts. Seconds are those of the process.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from occontrol.api import solve
from occontrol.families.athans.readings.fill import feasible_set, fill
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.sweep import Sweep
from scripts.instances import selection

INSTANCES = ((30, 30, 5, 3, 0.9), (30, 30, 10, 3, 1.05), (40, 20, 10, 5, 1.05), (50, 50, 10, 5, 1.05),
             (50, 25, 20, 5, 1.0))  # fmt: skip
STARTS = 10  # random schedules that exchanges begin at
KICK = 4  # swaps by which the best schedule is disturbed before exchanges begin again


def random_schedule(rng: np.random.Generator, T: int, M: int, m: int) -> np.ndarray:
    """(T, M) with m ones a row."""
    v = np.zeros((T, M))
    for k in range(T):
        v[k, rng.permutation(M)[:m]] = 1.0
    return v


def kicked(rng: np.random.Generator, v: np.ndarray) -> np.ndarray:
    """The schedule (T, M) after KICK random swaps."""
    w = v.copy()
    for _ in range(KICK):
        k = int(rng.integers(len(w)))
        out, new = rng.choice(np.flatnonzero(w[k] > 0)), rng.choice(np.flatnonzero(w[k] == 0))
        w[k, out], w[k, new] = 0.0, 1.0
    return w


def searched(problem, seconds: float, start: np.ndarray) -> tuple[float, float, int]:
    """The best cost of exchanges from random starts, of local search for so long, and how many exchanges it made."""
    filled, allowed, rng = fill(problem), feasible_set(problem), np.random.default_rng(0)
    sweep, (T, M), m = Sweep(filled.recursion), start.shape, problem.places
    several = [polish(sweep, allowed, random_schedule(rng, T, M, m)) for _ in range(STARTS)]
    best = min(several, key=lambda found: found.cost)
    exchange, count, began = best.cost, 0, time.process_time()
    weights, cost = best.weights, best.cost
    own = sweep.cost(start)
    if own < cost:
        weights, cost = start, own
    while time.process_time() - began < seconds:
        found = polish(sweep, allowed, kicked(rng, weights))
        count += 1
        if found.cost < cost:
            weights, cost = found.weights, found.cost
    return exchange + filled.constant, cost + filled.constant, count


def main() -> None:
    """Print one line an instance."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    print("| n, M, T, m, rho, seed | s | plain gap | gap | greedy | exchange, 10 starts | local search | its rounds |")
    print("|---|---|---|---|---|---|---|---|")
    for instance in INSTANCES:
        for seed in (0, 1):
            problem = selection(*instance, seed)
            began = time.process_time()
            ours = solve(problem)
            spent, r = time.process_time() - began, ours.result
            greedy = solve(problem, "greedy").cost
            start = np.asarray(ours.arrays["weights"])
            exchange, local, rounds = searched(problem, seconds, start)
            over = [f"{100 * (value - ours.cost) / ours.cost:+.3f} %" for value in (greedy, exchange, local)]
            gaps = [f"{100 * (r['cost'] - r[key]) / r['cost']:.1f} %" for key in ("relaxed_lower_bound", "lower_bound")]
            name = ", ".join(f"{x:g}" for x in (*instance, seed))
            print("| " + " | ".join([name, f"{spent:.1f}", *gaps, *over, str(rounds)]) + " |", flush=True)


if __name__ == "__main__":
    main()
