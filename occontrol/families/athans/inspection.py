"""What can be said of a scheduling problem without solving it: sizes, costs, observability, availability, work."""

from __future__ import annotations

import numpy as np

from occontrol.core.clock import tolerance
from occontrol.core.errors import plural
from occontrol.core.memory import size
from occontrol.families.athans.need import need
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.sensor_noise import sample_deviations
from occontrol.numerics.transition import transitions

RANK = 1e-10
SAMPLES = 40
FALLS = 12  # states from which it matters that a plant falls into parts
MOST_SENSORS = 12  # of which one sample is described


def inspect(problem: SchedulingProblem) -> list[tuple[str, str]]:
    """Label and text of each finding.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    n, N, sensors = problem.states, problem.intervals, problem.sensors
    rows = sum(s.rows for s in sensors)
    steps = problem.steps
    spacing = (
        f"{steps[0]:.4g} each"
        if np.ptp(steps) <= tolerance(steps.min(), problem.edges)
        else f"{steps.min():.4g} to {steps.max():.4g}"
    )
    edges = [f"{why} at t = {t:.10g}" for t, why in problem.added_edges]
    varying = [".".join(map(str, p)) for p, s in problem.signals.items() if not s.constant]
    found = [
        ("sizes", f"{n} states, {len(sensors)} sensors with {rows} rows, {N} intervals of {spacing}"),
        ("select", f"{problem.select} at a time"),
        ("horizon", f"t = {problem.edges[0]:g} to {problem.edges[-1]:g}, prediction for {problem.predict_at:g}"),
        ("time-varying", _listed(varying, 6) if varying else "nothing"),
        *([("edges added", f"{len(edges)}: {_listed(edges, 6)}")] if edges else []),
    ]  # fmt: skip
    found += _blocks(problem)
    rates = np.column_stack([s.cost.sample(problem.midpoints)[:, 0, 0] for s in sensors])
    low, high = _spend(rates, problem, np.min), _spend(rates, problem, np.max)
    found.append(
        ("observation cost", f"{low:.6g} to {high:.6g} over the horizon, times cost_weight {problem.cost_weight:g}")
    )
    samples = sample_deviations(problem)
    for name, h, deviations in samples[:MOST_SENSORS]:
        values = ", ".join(f"{d:.3g}" for d in deviations)
        found.append((f"sample of {name}", f"the average over {h:.4g} has deviation {values}: noise is an intensity"))
    if samples:
        found.append(("readings", "of variance R, one every h: write variance: R, every: h in place of noise"))
    lacking = np.sum(problem.upper, axis=1) < problem.select - 1e-9
    windows = [
        f"{s.name} {100 * float(steps @ problem.upper[:, j]) / steps.sum():.3g} %"
        for j, s in enumerate(sensors)
        if s.windows is not None
    ]
    text = (
        f"{int(lacking.sum())} of {N} intervals have too few sensors"
        if np.any(lacking)
        else "every interval can be filled"
    )
    found.append(("availability", text + (f"; inside windows: {', '.join(windows)}" if windows else "")))
    together, worst = _observability(problem)
    found.append(("observability", f"all sensors together: rank {together} of {n} over the horizon{worst}"))
    flops = N * (4 * n**3 + 6 * n * n * max(1, problem.output.shape[0]) + 4 * rows * n)
    least, most = need(problem, 1), need(problem)
    span = size(most) if least == most else f"{size(least)} to {size(most)}"
    work = f"about {flops / 1e6:.3g} Mflop a sweep, tens of sweeps; {span} of memory, libraries included"
    found.append(("work", work))
    return found


def _listed(names: list[str], most: int) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _spend(rates: np.ndarray, problem: SchedulingProblem, pick) -> float:
    """Cheapest or dearest spending when `select` places are filled by one and the same kind of choice."""
    open_ = problem.upper > 0
    chosen = [pick(r[o]) if np.any(o) else 0.0 for r, o in zip(rates, open_, strict=True)]
    return float(problem.select * np.asarray(chosen) @ problem.steps)


def _observability(problem: SchedulingProblem) -> tuple[int, str]:
    """Rank of the observability Gramian at the start, and the sensors that do not reach it alone."""
    n, N = problem.states, problem.intervals
    picks = np.unique(np.linspace(0, N - 1, min(N, max(SAMPLES, 2 * n))).astype(int))
    times = problem.midpoints[picks]
    starts = np.concatenate([problem.edges[:1], times[:-1]])
    F, _ = transitions(problem.plant.A, problem.plant.noise, starts, times)
    gramians = np.zeros((len(problem.sensors), n, n))
    phi = np.eye(n)
    for i, k in enumerate(picks):
        phi = F[i] @ phi
        for j, sensor in enumerate(problem.sensors):
            if sensor.rows and problem.upper[k, j] > 0:
                theta, C = sensor.noise.at(times[i]), sensor.C.at(times[i]) @ phi
                gramians[j] += C.T @ np.linalg.solve(theta, C)
    scale = np.sqrt(np.maximum(np.diag(gramians.sum(axis=0)), 1e-300))

    def rank(g: np.ndarray) -> int:
        values = np.linalg.eigvalsh(g / scale / scale[:, None])
        return int(np.sum(values > RANK * max(values[-1], 1e-300))) if values[-1] > 0 else 0

    alone = [(s.name, rank(g)) for s, g in zip(problem.sensors, gramians, strict=True) if s.rows]
    short = [f"{name} {r}" for name, r in alone if r < n]
    listed = _listed(short, 5)
    return rank(gramians.sum(axis=0)), f"; alone less: {listed}" if short else ""


def _blocks(problem: SchedulingProblem) -> list[tuple[str, str]]:
    """What a plant of many states falls into, where nothing varies; it could be written as targets, too."""
    plant = problem.plant
    signals = [plant.A, plant.noise, *(x for s in problem.sensors for x in (s.C, s.noise))]
    if problem.states < FALLS or not all(signal.constant for signal in signals):
        return []
    from occontrol.families.athans.discretise import discretise
    from occontrol.scheduling.blocks.components import components

    sizes = [len(block) for block in components(discretise(problem))]
    if len(sizes) < 2:
        return []
    text = f"{len(sizes)} parts that nothing couples, the largest of {plural(max(sizes), 'state')}"
    return [("blocks", f"{text}: swept part by part; docs/targets.md has a shorter way to write them")]
