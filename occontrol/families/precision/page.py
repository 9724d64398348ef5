"""The panels and the table of a precision page: how precise every measurement must be, step by step."""

from __future__ import annotations

import numpy as np

from occontrol.core.solution import Solution
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.result import numbers_of
from occontrol.files.page.content import Curves, Group, Panel, Shades, Table


def groups(problem: Problem, solution: Solution) -> list[Group]:
    """The panels of a solution: a map over the steps of all batches, and what every batch came to.

    Parameters
    ----------
    problem : Problem of the family precision
    solution : Solution
    """
    if "precisions" not in solution.arrays:
        return []
    grid = solution.arrays["precisions"].reshape(-1, problem.sensor_count)
    found, batches = list[Group](), numbers_of(solution).batches
    if len(grid) > 1:
        shown = np.where(grid > 0, grid, np.nan)
        panel = Shades(title="how precise each sensor must be (empty: not used)", label="precision 1 / variance",
                       edges=np.arange(len(grid) + 1) + 0.5, values=shown, names=list(problem.names))  # fmt: skip
        found.append(Group(axis="step", panels=[panel], whole=True))
    records = [r for r in batches or () if r.objective is not None]
    if len(records) > 1:
        k = np.array([float(r.batch) for r in records])
        promised = np.sqrt(np.trace(solution.arrays["posterior"], axis1=1, axis2=2) / problem.states)[: len(k)]
        errors = np.array([np.nan if r.rms_error is None else r.rms_error for r in records])
        panels: list[Panel] = [
            Curves(title="what each batch costs", label="objective", times=k, names=["objective"],
                   values=np.array([[r.objective] for r in records], dtype=float)),
            Curves(title="true error against what was promised", label="RMS over the states", times=k,
                   values=np.column_stack([errors, promised]), names=["true error of this run", "expected"],
                   level=float(np.sqrt(np.trace(problem.bound) / problem.states))),
        ]  # fmt: skip
        found.append(Group(axis="batch (dashed line: largest that the bound allows)", panels=panels, whole=True))
    return found


def tables(problem: Problem, solution: Solution) -> list[Table]:
    """Every measurement of the first batch with its precision, the standard deviation of its noise, and its price.

    Parameters
    ----------
    problem : Problem of the family precision
    solution : Solution
    """
    if "precisions" not in solution.arrays:
        return []
    precision = solution.arrays["precisions"][0]
    with np.errstate(divide="ignore"):
        deviation = 1 / np.sqrt(precision)
    columns = {
        "measurement": problem.labels(),
        "precision": precision.tolist(),
        "standard deviation of its noise": [float(d) if np.isfinite(d) else None for d in deviation],
        "price": np.asarray(problem.prices, dtype=float).tolist(),
    }
    batch = " of the first batch" if len(solution.arrays["precisions"]) > 1 else ""
    return [Table(title=f"measurements{batch}", columns=columns)]
