"""Code for a target beside `occontrol filter`: the reference, which the code equals bit by bit, and Octave."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from occontrol.api import export_run, run_filter, simulate
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.target import TargetPlan
from occontrol.files.export.flight.content import Options, make_content
from occontrol.files.export.flight.vectors import reference_of

PLACES = 2.0  # of the estimate's own digits that one step may lose


def values_of(plan: TargetPlan, measurements: Sequence[Measurement], intervals: int) -> np.ndarray:
    """The values (N, m) of every interval as the target takes them, NaN where missing; N may go beyond one cycle."""
    z = np.full((intervals, max(1, *(sum(plan.rows[j] for j in active) for active in plan.active))), np.nan)
    ends, ks = times_of(plan, intervals)
    for s in measurements:
        j, i = plan.names.index(s.sensor), int(np.argmin(np.abs(ends - s.time)))
        first = sum(plan.rows[a] for a in plan.active[ks[i]] if a < j)
        z[i, first : first + plan.rows[j]] = s.values
    return z


def times_of(plan: TargetPlan, intervals: int) -> tuple[np.ndarray, list[int]]:
    """When each of so many intervals ends, and its number in the tables."""
    ends, ks, k, offset = [], [], 0, 0.0
    for _ in range(intervals):
        ends.append(float(plan.edges[k + 1]) + offset)
        ks.append(k)
        k += 1
        if k == plan.intervals and plan.again is not None:
            k, offset = plan.again, offset + float(plan.edges[-1] - plan.edges[plan.again])
    return np.array(ends), ks


def against_filter(problem, solution, plan: TargetPlan) -> tuple[float, float]:
    """(largest difference in standard deviations, what the digits of the estimate themselves leave open)."""
    measurements = simulate(problem, solution, 1)[0]
    want = run_filter(problem, solution, measurements)
    start = 0 if problem.family == "vlambda" else 1  # the row after the first interval
    N = len(want.times) - start
    z, reference = values_of(plan, measurements, N), reference_of(make_content(plan, Options()))
    worst, digits = 0.0, 0.0
    for k in range(N):
        reference.step(z[k])
        row = k + start
        sd = floored(want, row)
        worst = max(worst, float(np.max(np.abs(reference.x - want.mean[row]) / sd)))
        worst = max(worst, float(np.max(np.abs(np.sqrt(reference.variance()) - want.standard_deviation[row]) / sd)))
        digits += PLACES * float(np.max(np.spacing(np.abs(want.mean[row])) / sd))
    return worst, digits


def floored(want: Estimate, k: int) -> np.ndarray:
    """Deviations at node `k`; of what is known they are 0."""
    return np.maximum(want.standard_deviation[k], 1e-12 * np.max(want.standard_deviation))


def octave_differs(run: Path, folder: Path, problem, solution, plan: TargetPlan) -> float:
    """How far Octave's estimate is from that of the filter, in standard deviations."""
    from scipy.io import loadmat, savemat

    measurements = simulate(problem, solution, 1)[0]
    measurements = [s for s in measurements if s.time <= plan.edges[-1] * (1 + 1e-12)]
    want = run_filter(problem, solution, measurements)
    z = values_of(plan, measurements, plan.intervals)
    export_run(run, "matlab", folder)
    savemat(folder / "z.mat", {"z": z})
    code = "load z.mat; [x, sd] = run_schedule('run.mat', z); save -v6 said.mat x sd"
    subprocess.run(["octave-cli", "--eval", code], cwd=folder, capture_output=True, check=False)
    said = loadmat(folder / "said.mat")
    sd = np.maximum(want.standard_deviation, 1e-12 * np.max(want.standard_deviation))
    return float(np.max(np.abs(said["x"] - want.mean) / sd))
