"""What the command line prints about selection problems and their solutions."""

from __future__ import annotations

from itertools import groupby
from math import comb, log10

import numpy as np

from occontrol.core.errors import plural
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.result import EpochEntry, numbers_of
from occontrol.families.vlambda.sensor import Region

MOST_ENTRIES = 40


def describe(problem: Problem) -> list[tuple[str, str]]:
    """Label and text of what `check` prints: sizes, sensors, observability, an estimate of the work."""
    n, M = problem.states, len(problem.sensors)
    groups = comb(M, problem.select)
    every = "step" if problem.epoch == 1 else f"{problem.epoch} steps"
    lines = [
        ("states", f"{n}, driven by {plural(problem.plant.Q.shape[0], 'noise')}"),
        ("horizon", f"k = 0 .. {problem.steps - 1}, a choice every {every}: {plural(problem.epochs, 'choice')}"),
        ("sensors", f"{M}, {problem.select} at a time"),
    ]
    for sensor in problem.sensors:
        rows = plural(sensor.rows, "value")
        if sensor.location is not None:
            box = " x ".join(f"[{low:g}, {high:g}]" for low, high in sensor.location.bounds)
            limits = (
                f", {plural(len(sensor.location.constraints), 'constraint')}" if sensor.location.constraints else ""
            )
            rows += f", movable in {box}{limits}"
        lines.append((f"  {sensor.name}", rows))
    lines.append(("criterion", f"{problem.criterion} of P(k|k), summed over k"))
    if np.any(problem.scales != 1):
        lines.append(("scales", ", ".join(f"{s:g}" for s in problem.scales)))
    lines.append(("observability", _observability(problem)))
    exponent = problem.epochs * log10(groups)
    lines.append(("sequences", f"{groups}^{problem.epochs} = 1e{exponent:.1f} (optimal cuts most of them)"))
    lines.append(("work", f"{problem.steps} filter steps of order {n}; about {_seconds(problem):.2g} s for a rule"))
    return lines


def _seconds(problem: Problem) -> float:
    """A rough time of one walk over the horizon."""
    return problem.steps * (6e-5 + 1e-8 * problem.states**3) + problem.epochs * 0.02 * sum(
        s.movable for s in problem.sensors
    )


def _places(region: Region | None) -> list[np.ndarray | None]:
    """A few places inside of a box, none of them at a point of symmetry."""
    if region is None:
        return [None]
    low, high = region.bounds[:, 0], region.bounds[:, 1]
    return [low + share * (high - low) for share in (0.17, 0.41, 0.73)]


def _observability(problem: Problem) -> str:
    """Rank of C(k) Phi(k, 0), k = 0 .. n-1, with all sensors (movable ones at a few places) together."""
    plant, n = problem.sampled, problem.states
    product, blocks = np.eye(n), []
    for k in range(min(n, plant.steps)):
        for sensor in plant.sensors:
            for place in _places(sensor.sensor.location):
                try:
                    block = sensor.whitened(k, k + 1, place)[0] @ product
                except np.linalg.LinAlgError:
                    continue
                blocks.append(block / max(float(np.linalg.norm(block)), 1e-300))
        product = plant.transition[k] @ product
        product /= max(float(np.linalg.norm(product)), 1e-300)
    rank = int(np.linalg.matrix_rank(np.concatenate(blocks), tol=1e-10)) if blocks else 0
    within = plural(min(n, plant.steps), "step")
    if rank == n:
        return f"all {n} states within {within} when every sensor measures"
    return f"only {rank} of {n} directions within {within}, even when every sensor measures"


def summarise(problem: Problem, solution: Solution) -> list[tuple[str, str]]:
    """Label and text of what `solve` prints."""
    r, when = numbers_of(solution), "k >= 1" if problem.steps > 1 else "k = 0, the only step"
    lines = [
        ("method", f"{solution.method}, {plural(problem.epochs, 'choice')} over k = 0 .. {problem.steps - 1}"),
        ("selected", _runs(r.schedule)),
        ("cost", f"{r.cost:.10g}  (sum over k of {_word(problem.criterion)} of P(k|k))"),
    ]
    if r.lower_bound is not None:
        gap = "" if r.relative_gap is None else f", gap {100 * r.relative_gap:.3g} %"
        lines.append(("lower bound", f"{rounded_down(r.lower_bound, 10)}{gap}"))
    if r.nodes is not None:
        text = f"{r.nodes} epochs walked"
        if r.log10_sequences is not None:
            text += f", 1e{r.log10_sequences:.1f} sequences"
        lines.append(("search", text))
    lines += [
        ("sum of traces", f"{r.sum_trace:.10g}"),
        ("sum of largest eigenvalues", f"{r.sum_largest_eigenvalue:.10g}"),
        ("peak largest eigenvalue", f"{r.peak_largest_eigenvalue:.10g}  ({when})"),
        ("standard deviations at the end", ", ".join(f"{s:.6g}" for s in r.standard_deviations[:12])),
    ]
    lines += [("note", text) for text in r.notes or ()]
    lines.append(("seconds", f"{solution.seconds:.3g}"))
    return lines


def _word(criterion: str) -> str:
    return "the trace" if criterion == "trace" else "the largest eigenvalue"


def _runs(schedule: list[EpochEntry]) -> str:
    """Who is used, neighbours joined: 'three, two x3, one'; locations beside movable ones."""

    def word(entry: EpochEntry) -> str:
        where = entry.locations or {}
        return "+".join(
            name + (f" at ({', '.join(f'{x:.4g}' for x in where[name])})" if name in where else "")
            for name in entry.sensors
        )

    parts = []
    for text, group in groupby(word(entry) for entry in schedule):
        count = len(list(group))
        parts.append(text if count == 1 else f"{text} x{count}")
    if len(parts) > MOST_ENTRIES:
        parts = [*parts[:MOST_ENTRIES], f".. ({len(parts) - MOST_ENTRIES} more changes)"]
    return ", ".join(parts)
