"""The lines that the command line prints about a precision problem and its solution."""

from __future__ import annotations

import numpy as np

from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.families.precision.linearised import linearise_batch, undetectable_modes
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.program import examine
from occontrol.families.precision.result import numbers_of

MOST_STATES = 80  # for the detectability line of `check`: one decomposition per mode


def summarise(problem: Problem, solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    """
    result = numbers_of(solution)
    lines = [("method", f"{solution.method}, {solution.iterations} iterations, {solution.seconds:.2f} s")]
    if result.objective is None or result.precisions is None or result.active is None:
        return [*lines, ("reachable", f"bound factor {result.smallest_factor:.10g} or more")]
    what = "objective" if len(set(problem.prices)) > 1 or problem.prices[0] != 1 else "precision"
    uses = problem.measurements * len(solution.arrays["precisions"])
    margin = f"{result.margin:.3g} (smallest eigenvalue of bound - posterior)"
    lines += [
        (what, f"{result.objective:.10g}"),
        ("lower bound", f"{rounded_down(result.lower_bound, 10)}   gap {100 * (result.relative_gap or 0.0):.3g} %"),
        ("active", f"{result.active} of {uses}   at least {result.least_active} are needed"),
        ("margin", f"{margin}, {result.relative_margin:.1e} of the bound"),
        ("reachable", f"bound factor {_reachable(result.smallest_factor)}"),
    ]
    if result.batches is not None:
        table = [
            f"{r.batch:>3}  objective {r.objective:.6g}  active {r.active}  rms error {r.rms_error:.3g}"
            f"  {'bound kept' if r.guarantee else 'BOUND MISSED'}"
            for r in result.batches if r.objective is not None
        ]  # fmt: skip
        lines.append(("batches", "\n".join(table)))
    else:
        precisions = np.array(result.precisions)
        order = np.argsort(-precisions, kind="stable")[: min(12, result.active)]
        labels = problem.labels()
        more = "" if result.active <= 12 else f"  and {result.active - 12} more"
        lines.append(("precisions", "  ".join(f"{labels[i]} {precisions[i]:.6g}" for i in order) + more))
    if result.pruning is not None:
        pruning = result.pruning
        rows = [f"{_without(r.removed)}: {r.objective:.8g} ({r.price:+.3g})" for r in pruning.removals]
        if pruning.refused:
            rows.append(f"kept for detectability: {', '.join(pruning.refused)}")
        lines.append(("pruning", "\n".join([*rows, f"ended: {pruning.reason}"])))
    return lines


def _without(removed: list[str]) -> str:
    return f"without {', '.join(removed[:6])}{' ...' if len(removed) > 6 else ''}"


def _reachable(factor: float) -> str:
    return f"{factor:.6g} or more" if factor > 1e-12 else "of any size"


def describe(problem: Problem) -> list[tuple[str, str]]:
    """What `check` prints: sizes, filter, bound, and whether the first batch can meet it.

    Parameters
    ----------
    problem : Problem
    """
    q = f" x {problem.batch} steps" if problem.batch > 1 else ""
    lines = [
        ("states", f"{problem.states} bounded"),
        ("sensors", f"{problem.sensor_count}{q}: {problem.measurements} precisions to choose"),
    ]
    bound = f"factor {problem.bound_factor:g}" if problem.bound_factor is not None else "matrix"
    deviations = np.sqrt(np.diag(problem.bound))
    lines.append(("bound", f"{bound}, standard deviations {deviations.min():.4g} to {deviations.max():.4g}"))
    capped = np.isfinite(problem.caps)
    if np.any(capped):
        caps = problem.caps[capped]
        lines.append(("caps", f"{len(caps)} of {len(capped)}, {caps.min():g} to {caps.max():g}"))
    if problem.plant is not None:
        plant, _, filter_ = problem.dynamics("describe")
        law = (
            "next state x = f(x)"
            if plant.step is None
            else f"dx/dt = f(x), {plant.substeps} Runge-Kutta steps of {plant.step:g}"
        )
        lines.append(("plant", f"{plant.model or 'formulas'}, {law}; {plant.interval:g} time units per step"))
        options = ", ".join(f"{k} {v}" for k, v in vars(filter_).items() if k != "name")
        lines.append(("filter", f"{filter_.name}: {options}"))
        lines += _detectability(problem)
        if problem.batches > 1:
            lines.append(("batches", f"{problem.batches}, truth from seed {problem.truth_seed}"))
    split, verdict, _ = examine(problem.program(problem.first_moments()))
    lines.append(("inequality", f"{split.rows.shape[1]} rows (rank of the measurement covariance)"))
    if verdict.idle:
        text = "met without any measurement"
    else:
        word = "can be met" if verdict.feasible else "CANNOT be met"
        text = f"{word} in the first batch: smallest factor {problem.factor * verdict.factor:.10g}, "
        text += f"at least {verdict.least_active} measurements"
    return [*lines, ("feasibility", text)]


def _detectability(problem: Problem) -> list[tuple[str, str]]:
    if problem.states > MOST_STATES:
        return []
    plant, measurement, _ = problem.dynamics("linearise")
    transition, rows = linearise_batch(plant, measurement, problem.batch)
    if not (np.all(np.isfinite(transition)) and np.all(np.isfinite(rows))):
        return []
    growing = int(np.sum(np.abs(np.linalg.eigvals(transition)) >= 1 - 1e-9))
    if not growing:
        return [("detectability", f"all {problem.states} modes of the linearised batch decay, measured or not")]
    missed = len(undetectable_modes(transition, rows))
    text = f"{growing} of {problem.states} modes of the linearised batch do not decay, "
    return [("detectability", text + ("all of them are measured" if not missed else f"{missed} of them UNMEASURED"))]
