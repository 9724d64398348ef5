"""The V-Lambda filter against filterpy's plain Kalman filter, and the exact search against enumeration."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from occontrol.api import read_problem
from occontrol.families.vlambda.candidates import candidate_set
from occontrol.families.vlambda.family import FAMILY
from occontrol.families.vlambda.filter import EigenfactorFilter
from occontrol.families.vlambda.methods import Optimal
from occontrol.families.vlambda.sequence_search import SequenceProblem, search

PROBLEMS = Path(__file__).parents[1] / "problems"
REPEATS = 5


def _interleaved(calls: dict[str, Callable[[], Any]], repeats: int = REPEATS) -> dict[str, float]:
    """Median seconds of every call, the calls taking turns so that a busy machine is unfair to none of them."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()  # compile and fill the caches
    for _ in range(repeats):
        for name, call in calls.items():
            started = time.perf_counter()
            call()
            seconds[name].append(time.perf_counter() - started)
    return {name: median(values) for name, values in seconds.items()}


def _filters(n: int, m: int, steps: int) -> dict[str, Any]:
    from filterpy.kalman import KalmanFilter

    g = np.random.default_rng(n)
    F, H = 0.98 * np.linalg.qr(g.standard_normal((n, n)))[0], g.standard_normal((m, n))
    root, values = 0.3 * np.eye(n), g.standard_normal((steps, m))

    def eigenfactor() -> EigenfactorFilter:
        state = EigenfactorFilter.start(250 * np.eye(n), np.zeros(n))
        for y in values:
            state.measure(H, y)
            state.propagate(F, root)
        return state

    def plain() -> Any:
        state = KalmanFilter(n, m)
        state.F, state.H, state.R, state.Q, state.P = F, H, np.eye(m), root @ root.T, 250 * np.eye(n)
        for y in values:
            state.update(y)
            state.predict()
        return state

    ours, theirs = eigenfactor(), plain()
    difference = np.max(np.abs(ours.factors.covariance - theirs.P)) / np.max(np.abs(theirs.P))
    seconds = _interleaved({"eigenfactor": eigenfactor, "filterpy": plain})
    return {
        "case": f"filter, n = {n}, m = {m}, {steps} steps with estimates",
        "eigenfactor_steps_per_second": steps / seconds["eigenfactor"],
        "filterpy_steps_per_second": steps / seconds["filterpy"],
        "slower_by": seconds["eigenfactor"] / seconds["filterpy"],
        "relative_difference": float(difference),
    }


def _enumerate(problem: SequenceProblem, epochs: int) -> float:
    """Every sequence of the first `epochs` epochs by depth-first search without any cut; the smallest cost."""
    from occontrol.families.vlambda.epoch_kernel import expand

    def below(root: np.ndarray, epoch: int) -> float:
        if epoch == epochs:
            return 0.0
        s = problem.slice(epoch)
        rows = np.ascontiguousarray(problem.rows[:, s])
        after, costs = expand(root[None], problem.transition[s], problem.noise_root[s], rows, problem.kind)
        return min(float(c) + below(r, epoch + 1) for c, r in zip(costs[0], after[0], strict=True))

    return below(problem.root, 0)


def _search(quick: bool) -> dict[str, Any]:
    oshman = read_problem(PROBLEMS / "oshman_example.yaml")
    problem = candidate_set(oshman, 9).problem
    epochs, count = problem.epochs, len(problem.rows)
    walked = sum(count**e for e in range(1, epochs + 1))
    found = search(problem)
    seconds = _interleaved({"search": lambda: search(problem)})["search"]
    row = {
        "case": f"exact search, {count}^{epochs} sequences, every one of {walked} epochs for enumeration",
        "search_nodes": found.nodes,
        "search_seconds": seconds,
        "proven": found.proven,
    }
    if quick:
        part, started = 6, time.perf_counter()
        _enumerate(problem, part)
        spent = time.perf_counter() - started
        row["enumeration_seconds_estimated"] = spent * walked / sum(count**e for e in range(1, part + 1))
        return row
    started = time.perf_counter()
    cost = _enumerate(problem, epochs)
    row["enumeration_seconds"] = time.perf_counter() - started
    row["relative_difference"] = float(abs(cost - found.cost) / cost)
    return row


def _long_search() -> dict[str, Any]:
    problem = read_problem(PROBLEMS / "oshman_every_step.yaml")
    started = time.perf_counter()
    solution = FAMILY.solve(problem, Optimal())
    return {
        "case": "exact search stopped by its width, 3^300 sequences",
        "search_nodes": solution.result["nodes"],
        "search_seconds": time.perf_counter() - started,
        "proven": False,
        "cost": solution.cost,
        "relative_gap": solution.result["relative_gap"],
    }


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """One record per case: filter steps per second at n = 3, 10, 50; the search's nodes and seconds.

    Parameters
    ----------
    quick : estimate the time of enumeration from its first six epochs, leave the search over 3^300 sequences out
    """
    found = [_filters(3, 2, 300), _filters(10, 3, 300), _filters(50, 10, 100), _search(quick)]
    return found if quick else [*found, _long_search()]


if __name__ == "__main__":
    import sys

    for record in rows("--quick" in sys.argv):
        print(record)
