"""Many targets: a sweep, the relaxation to its gap, memory; one process a case. Prints rows for docs/bench.md.

    python scripts/bench_many_targets.py            all cases, a few minutes
    python scripts/bench_many_targets.py 1000 200 50 1e-4      targets, intervals, capacity, gap
    python scripts/bench_many_targets.py 2000 720 1 1e-3 72    the same with 72 sites, each open for 2 % of the time
    python scripts/bench_many_targets.py 20000 720 1 1e-3 72 schedule    a whole solve, with a schedule and its check

Targets are those of docs/bench.md: three axes with drag, position looks with independent errors, seeded. Seconds are of
the processor, so that a busy machine changes them little, and by the clock on the wall.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.targets.fill import fill
from occontrol.families.athans.targets.groups import LookSet, TargetGroup
from occontrol.families.athans.targets.problem import Resource, TargetsProblem
from occontrol.families.athans.targets.solve import relaxed_task, solve
from occontrol.scheduling.blocks.relaxation import relax

CASES = ((104, 200, 5, 1e-4), (1000, 200, 50, 1e-4), (1000, 500, 50, 1e-4), (10_000, 200, 100, 1e-3),
         (10_000, 200, 500, 1e-4))  # fmt: skip
HORIZON, OPEN = 20.0, 0.02


def problem(count: int, intervals: int, capacity: int, seed: int = 3, sites: int = 1) -> TargetsProblem:
    """Seeded targets of three axes, and one radar or several sites with windows.

    Parameters
    ----------
    count, intervals, capacity : targets, N, looks on one interval of each site
    seed : of the numbers
    sites : one that sees everything, or several that see each target in one window of OPEN of the time
    """
    g = np.random.default_rng(seed)
    shape, position, rate = (count, 6, 6), range(3), range(3, 6)
    A, noise, start, running = (np.zeros(shape) for _ in range(4))
    A[:, position, rate], A[:, rate, rate] = 1.0, -g.uniform(0.05, 0.3, count)[:, None]
    noise[:, rate, rate] = g.uniform(0.3, 1, (count, 3)) * 10 ** g.uniform(-1, 0, (count, 1))
    start[:, position, position], start[:, rate, rate] = g.uniform(1, 5, count)[:, None], 0.5
    running[:, position, position] = 1 / HORIZON
    theta = np.zeros((count, 3, 3))
    theta[:, position, position] = g.uniform(0.05, 0.5, (count, 3))
    looks = []
    for site in range(sites):
        length = intervals if sites == 1 else round(OPEN * intervals)
        first = np.zeros(count, dtype=int) if sites == 1 else g.integers(0, intervals - length, count)
        target = np.repeat(np.arange(count, dtype=np.int32), length)
        interval = (np.repeat(first, length) + np.tile(np.arange(length), count)).astype(np.int32)
        C = np.broadcast_to(np.eye(3, 6), (count, 3, 6))
        looks.append(LookSet(site, C, theta, np.zeros(count), target, interval, target))
    names = tuple(f"t{i}" for i in range(count))
    weight, zero = 10 ** g.uniform(-0.5, 0.5, count), np.zeros(shape)
    group = TargetGroup("m", names, A, noise, np.zeros((count, 6)), start, weight, running, zero, tuple(looks))
    edges = np.linspace(0, HORIZON, intervals + 1)
    radars = tuple(Resource(f"radar_{i}", np.full(intervals, capacity)) for i in range(sites))
    options = Integration(substeps=1, windows="cover", refine=False)
    return TargetsProblem("bench", edges, radars, (group,), {}, 0.0, integration=options)


def run(count: int, intervals: int, capacity: int, gap: float, sites: int = 1) -> None:
    """Print one row of the table."""
    warm = fill(problem(40, 10, 3))
    relax(warm.sweep(), warm.allowed, 1e-3, 30, Monitor())
    began, clock = time.process_time(), time.perf_counter()
    filled = fill(problem(count, intervals, capacity, sites=sites))
    task = relaxed_task(filled, gap, 3000, Monitor(), lean=True)
    found, v, took = task.relaxed, filled.allowed.uniform(), []
    seconds, peak = time.process_time() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    wall = time.perf_counter() - clock
    for _ in range(3):
        start = time.process_time()
        task.sweep.cost_and_gradient(v)
        took.append(time.process_time() - start)
    reached = 1 - found.lower_bound / found.cost
    each = f"{capacity} x {sites} sites" if sites > 1 else f"{capacity}"
    print(
        f"| {count} | {intervals} | {each} | {gap:g} | {found.status}, {reached:.2e} | {found.sweeps['gradients']} "
        f"| {seconds:.3g} | {wall:.3g} | {1e9 * min(took) / count / intervals:.0f} | {peak:.0f} |"
    )


def run_whole(count: int, intervals: int, capacity: int, gap: float, sites: int) -> None:
    """Print what a whole solve gives and takes."""
    began, clock = time.process_time(), time.perf_counter()
    method = RelaxRoundPolish(relative_gap=gap)
    found = solve(problem(count, intervals, capacity, sites=sites), method, Monitor())
    seconds, wall = time.process_time() - began, time.perf_counter() - clock
    r, peak = found.result, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    relaxed = 1 - r["relaxed_lower_bound"] / r["relaxed_cost"]
    print(f"{found.status}; {found.message}")
    print(f"relaxed gap {relaxed:.2e}, bound {r['lower_bound']:.8g}")
    print(f"schedule {r['cost']:.8g}, gap {r['relative_gap']:.3g}; {r['continuous']['reason']}")
    clocks = f"{seconds:.4g} s of the processor, {wall:.4g} s on the wall"
    print(f"{found.iterations} steps, {clocks}, peak {peak:.0f} MiB")


def main() -> None:
    """All cases, each in a process of its own; or the one that is named."""
    if sys.argv[-1] == "schedule":
        run_whole(*(int(x) for x in sys.argv[1:4]), float(sys.argv[4]), int(sys.argv[5]))
        return
    if len(sys.argv) > 4:
        count, intervals, capacity = (int(x) for x in sys.argv[1:4])
        run(count, intervals, capacity, float(sys.argv[4]), *(int(x) for x in sys.argv[5:]))
        return
    print("| targets | N | capacity | gap | reached | sweeps | seconds | wall | ns per interval | peak MiB |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for case in CASES:
        subprocess.run([sys.executable, __file__, *map(str, case)], check=True)


if __name__ == "__main__":
    main()
