"""What the sweep and the relaxation cost: flop rate against dgemm, exponents, the switch, sweeps to a gap.

python scripts/bench_targets.py --one STATES SENSORS INTERVALS GAP SEED ...    one JSON line, for the memory of one case
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
from instances import oscillators

from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.scheduling import kernels_blas
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import SMALL, Sweep
from occontrol.scheduling.vectors import WIDTH, width

REPEATS = 9
ACTIVE = 2  # sensors that share every interval of the measured policies


def interleaved(
    calls: dict[str, Callable[[], object]], repeats: int = REPEATS, clock: Callable[[], float] = time.perf_counter
) -> dict[str, list[float]]:
    """Seconds of every call, the calls taking turns so that a busy machine is unfair to none of them.

    Parameters
    ----------
    calls : by name
    repeats : how often each, after one call that does not count
    clock : `time.thread_time` for what one thread computes, so that waiting for the processor does not count
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            started = clock()
            call()
            seconds[name].append(clock() - started)
    return seconds


def shares(intervals: int, sensors: int) -> np.ndarray:
    """A policy (N, M) in which ACTIVE random sensors share every interval."""
    rng, v = np.random.default_rng(0), np.zeros((intervals, sensors))
    for row in v:
        chosen = rng.choice(sensors, min(ACTIVE, sensors), replace=False)
        row[chosen] = 1.0 / len(chosen)
    return v


def flops(n: int, rows: int, active: int, p: int, small: bool) -> float:
    """Additions and multiplications of one interval of one forward and backward sweep, as executed (without padding).

    F S: 2n^3; F (F S)': 2n for every entry computed (tiles or panels down to or from the diagonal); update: 4n^2 per
    active row (loops), or 4mn^2 + 2m^2 n for m active rows at once (BLAS); V S+, V F: 2pn^2 each; C (V S+)': 2prn;
    their squares: 2pr; V K: 2pn per active row (twice for BLAS).
    """
    if small:
        ends = [min(i - i % 4 + 4, n) if i - i % 4 + 4 <= n else min(i + 2 - (i - n % 4) % 2, n) for i in range(n)]
        second = sum(2 * n * min(n, -(-end // WIDTH) * WIDTH) for end in ends)
        update = 4 * n * n * active
    else:
        wide = kernels_blas.panel_width(n)
        second = sum(2 * n * min(wide, n - j) * (n - j) for j in range(0, n, wide))
        update = 4 * active * n * n + 2 * active**2 * n + 2 * p * n * active
    return 2 * n**3 + second + update + 4 * p * n * n + 2 * p * rows * n + 2 * p * rows + 2 * p * n * active


def gemm(n: int) -> tuple[Callable[[], None], float]:
    """A call of dgemm, repeated to about 2e8 flops, and its flops."""
    rng = np.random.default_rng(0)
    a, b, c = rng.standard_normal((n, n)), rng.standard_normal((n, n)), np.empty((n, n))
    times = max(1, int(1e8 / n**3))

    def call() -> None:
        for _ in range(times):
            np.dot(a, b, out=c)

    return call, 2.0 * n**3 * times


def rates(cases: list[tuple[int, int, int]]) -> list[dict]:
    """Flop rate of one sweep and of dgemm, at the same n and at n = 1000, in Gflop/s and as a share of the larger.

    Parameters
    ----------
    cases : (n, M, N)
    """
    found = []
    for n, M, N in cases:
        sweep, v = Sweep(discretise(oscillators(n, M, N, 0))), shares(N, M)
        (same, same_flops), (large, large_flops) = gemm(n), gemm(1000)
        count = N * flops(n, sweep.recursion.rows.shape[1], min(ACTIVE, M), len(sweep._root), sweep.small)
        times = max(1, int(2e8 / count))
        calls = {"sweep": lambda s=sweep, v=v, t=times: [s.cost_and_gradient(v) for _ in range(t)], "same": same}
        seconds = interleaved({**calls, "large": large}, clock=time.thread_time)
        own = [times * count / s / 1e9 for s in seconds["sweep"]]
        beside = [
            max(same_flops / a, large_flops / b) / 1e9 for a, b in zip(seconds["same"], seconds["large"], strict=True)
        ]
        found.append(
            {
                "n": n, "M": M, "N": N,
                "flops_per_interval": count / N,
                "microseconds_per_interval": median(seconds["sweep"]) / times / N * 1e6,
                "sweep": median(own),
                "dgemm_same": median(same_flops / s for s in seconds["same"]) / 1e9,
                "dgemm": median(beside),
                "share": median(a / b for a, b in zip(own, beside, strict=True)),
            }
        )  # fmt: skip
    return found


def per_sweep(cases: list[tuple[int, int, int]]) -> list[float]:
    """Median seconds of one sweep of every (n, M, N), all cases taking turns."""
    calls = {}
    for i, (n, M, N) in enumerate(cases):
        sweep, v = Sweep(discretise(oscillators(n, M, N, 0))), shares(N, M)
        calls[str(i)] = lambda s=sweep, v=v: s.cost_and_gradient(v)
    return [median(s) for s in interleaved(calls, clock=time.thread_time).values()]


def exponents() -> dict[str, tuple[float, str]]:
    """Least-squares exponents of the time of one sweep in N, n and M, with the cases they come from."""
    lines = {
        "N": ([(12, 8, N) for N in (400, 800, 1600, 3200, 6400)], 2),
        "n": ([(n, 4, 40) for n in (16, 32, 64, 100, 140, 200)], 0),
        "M": ([(12, M, 400) for M in (8, 32, 128, 512)], 1),
    }
    found = {}
    for name, (cases, at) in lines.items():
        seconds = per_sweep(cases)
        slope = np.polyfit(np.log([c[at] for c in cases]), np.log(seconds), 1)[0]
        found[name] = (
            float(slope),
            ", ".join(f"{c[at]}: {1e3 * s:.3g} ms" for c, s in zip(cases, seconds, strict=True)),
        )
    return found


def crossover() -> list[dict]:
    """Seconds of one sweep by the loops and by BLAS, and which of them `Sweep` takes."""
    found = []
    for n in (2, 6, 16, 40, 60, 80, 100, 120, 200):
        r, v = discretise(oscillators(n, 4, 40, 0)), shares(40, 4)
        loops, blas = Sweep(r, small=n), Sweep(r, small=0)
        times = max(1, 3000 // n**2)
        calls = {
            "loops": lambda s=loops, v=v, t=times: [s.cost_and_gradient(v) for _ in range(t)],
            "blas": lambda s=blas, v=v, t=times: [s.cost_and_gradient(v) for _ in range(t)],
        }
        seconds = interleaved(calls, clock=time.thread_time)
        loops_us, blas_us = (median(seconds[k]) / times / 40 * 1e6 for k in calls)
        found.append({"n": n, "loops": loops_us, "blas": blas_us, "taken": "loops" if n <= SMALL else "BLAS"})
    return found


def peak_memory() -> float:
    """MiB that this process has held at its peak; Linux also lets getrusage show what its parent held when it began."""
    status = Path("/proc/self/status")
    if status.exists():
        return next(float(x.split()[1]) for x in status.read_text().splitlines() if x.startswith("VmHWM")) / 2**10
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10


def solve_here(n: int, M: int, N: int, gap: float, seeds: list[int]) -> dict:
    """Relax instances in this process: seconds, sweeps and gap of each seed, peak memory of the process."""
    warm = oscillators(n, 2, 4, 0)
    minimise_relaxed(Sweep(discretise(warm)), feasible_set(warm))  # compiled functions warm
    records = []
    for seed in seeds:
        problem = oscillators(n, M, N, seed)
        started = time.perf_counter()
        sweep = Sweep(discretise(problem))
        found = minimise_relaxed(sweep, feasible_set(problem), options=RelaxedOptions(gap))
        seconds = time.perf_counter() - started
        records.append(
            {
                "seconds": seconds,
                "sweeps": found.sweeps["gradients"],
                "gap": (found.cost - found.lower_bound) / abs(found.cost),
                "status": str(found.status),
            }
        )
    peak = peak_memory()
    p, rows = len(sweep._root), sweep.recursion.rows.shape[1]
    floor = N * flops(n, rows, ACTIVE, p, sweep.small) * records[-1]["sweeps"]
    largest = {"store_MiB": 8 * N * n * (width(n) if sweep.small else n) / 2**20}
    return {
        "n": n,
        "M": M,
        "N": N,
        "target": gap,
        "seeds": seeds,
        "runs": records,
        "peak_MiB": peak,
        "flops": floor,
    } | largest


def solve_apart(n: int, M: int, N: int, gap: float, seeds: list[int], threads: int = 1) -> dict:
    """`solve_here` in a process of its own, so that its peak memory is the case's."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    words = [sys.executable, __file__, "--one", *map(str, (n, M, N, gap, *seeds))]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    _, word, *sizes = sys.argv
    if word != "--one":
        sys.exit(__doc__)
    n, M, N = map(int, sizes[:3])
    print(json.dumps(solve_here(n, M, N, float(sizes[3]), [int(s) for s in sizes[4:]])))
