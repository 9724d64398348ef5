"""Our relaxation and its peers on one instance, in turn; every peer run in a process of its own.

python scripts/bench_compare.py --peer NAME STATES SENSORS INTERVALS LIMIT FILE      one pickled run (used below)
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from bench_peers import GAP, PEERS, Evaluator, Run, ours
from bench_targets import peak_memory
from instances import oscillators

from occontrol.core.monitor import Monitor
from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep

REPEATS = 5
QUICK_SECONDS = 6.0  # runs shorter than that are repeated


@dataclass
class Comparison:
    """All runs on one instance; `ratios` are the peers' seconds over ours, and whether that is a lower limit."""

    name: str
    ours: list[Run] = field(default_factory=list)
    peers: dict[str, list[Run]] = field(default_factory=dict)
    memory: dict[str, float] = field(default_factory=dict)
    ratios: dict[str, tuple[float, bool]] = field(default_factory=dict)
    trace: list[tuple[float, float]] = field(default_factory=list)

    @property
    def lines(self) -> list[list[str]]:
        """Rows of the table of peers."""
        own = median(run.seconds for run in self.ours)
        gap = max(run.gaps[-1][1] for run in self.ours)
        found = [
            [self.name, "this project", f"{own:.3g}", f"{gap:.1e}", "1", str(len(self.ours)), "", self.ours[0].more]
        ]
        for name, runs in self.peers.items():
            if not runs:
                found.append([self.name, name, "failed", *[""] * 5])
                continue
            ratio, lower = self.ratios[name]
            sign = ">= " if lower else ""
            seconds = f"{sign}{median(run.at_least for run in runs):.3g}"
            last = f"{runs[-1].gaps[-1][1]:.1e}" if runs[-1].gaps else "none"
            tail = [str(len(runs)), f"{self.memory[name]:.0f}", runs[-1].more]
            found.append([self.name, name, seconds, last, f"{sign}{ratio:.3g}", *tail])
        return found


def compare(states: int, sensors: int, intervals: int, limit: float, seed: int = 0) -> Comparison:
    """Run everything on oscillators(states, sensors, intervals, seed).

    Parameters
    ----------
    states, sensors, intervals, seed : of the instance
    limit : seconds for one run of a peer
    """
    problem = oscillators(states, sensors, intervals, seed)
    evaluator = Evaluator(problem)
    found = Comparison(f"({states},{sensors},{intervals})")
    for _ in range(2):
        ours(problem)
    monitor = Monitor()
    minimise_relaxed(Sweep(discretise(problem)), feasible_set(problem), options=RelaxedOptions(1e-6), monitor=monitor)
    found.trace = [(r["seconds"], (r["cost"] - r["lower_bound"]) / abs(r["cost"])) for r in monitor.history]
    for name in PEERS:
        runs: list[Run] = []
        own: list[float] = []
        while len(runs) < REPEATS:
            print(f"... {found.name} {name}", file=sys.stderr, flush=True)
            for _ in range(1 if runs else REPEATS):
                found.ours.append(evaluator.judge(ours(problem)))
                own.append(found.ours[-1].seconds)
            done = _apart(name, states, sensors, intervals, limit, seed)
            if done is None:
                break
            run, found.memory[name] = done
            runs.append(evaluator.judge(run))
            if run.seconds > QUICK_SECONDS:
                break
        found.peers[name] = runs
        if runs:
            lower = any(run.reached is None for run in runs)
            found.ratios[name] = (median(run.at_least for run in runs) / median(own), lower)
    return found


def _apart(name: str, *sizes: float) -> tuple[Run, float] | None:
    """A peer in a process of its own: its run and its peak MiB; None if the process fails."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run"
        words = [sys.executable, __file__, "--peer", name, *map(str, sizes), str(file)]
        limit = float(sizes[3])
        try:
            done = subprocess.run(words, env=dict(os.environ), capture_output=True, text=True, timeout=3 * limit + 120)
        except subprocess.TimeoutExpired:
            return Run(name, [], limit, "did not heed its time limit"), 0.0
        if done.returncode:
            print(done.stderr[-2000:], file=sys.stderr)
            return None
        return pickle.loads(file.read_bytes())


def _peer(name: str, states: int, sensors: int, intervals: int, limit: float, seed: int, file: Path) -> None:
    problem = oscillators(states, sensors, intervals, seed)
    ours(problem)  # compiled functions warm
    run = PEERS[name](problem, limit)
    file.write_bytes(pickle.dumps((run, peak_memory())))


if __name__ == "__main__":
    word, name, *rest = sys.argv[1:]
    if word != "--peer":
        sys.exit(__doc__)
    n, M, N = map(int, rest[:3])
    # pickled as members of their modules, not of __main__
    _peer(name, n, M, N, float(rest[3]), int(rest[4]), Path(rest[5]))

__all__ = ["GAP", "Comparison", "compare"]
