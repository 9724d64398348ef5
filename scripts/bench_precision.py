"""Precision programs: the barrier against Clarabel called directly and against CVXPY with Clarabel, and its scaling."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from occontrol.api import read_problem
from occontrol.families.precision.ensemble import EnsembleFilter
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.normal_form import NormalForm, reduced_form
from occontrol.families.precision.plant import NonlinearPlant
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.program import Program, examine, solve_program

PROBLEMS = Path(__file__).parents[1] / "problems"


def lorenz96(size: int, factor: float = 0.6) -> Program:
    """One step of a Lorenz-96 ring of `size` states, each with a sigmoid sensor; 2 size + 1 members."""
    rng = np.random.default_rng(size)
    directions = np.linalg.qr(rng.standard_normal((size, size)))[0]
    covariance = (directions * np.linspace(25, 65, size)) @ directions.T
    plant = NonlinearPlant(
        (covariance + covariance.T) / 2, rng.uniform(0, 8, size), model="lorenz96", step=0.05, substeps=20
    )
    measurement = NonlinearMeasurement(size, model="sigmoid")
    options = EnsembleFilter(members=2 * size + 1)
    problem = Problem("ring", plant=plant, measurement=measurement, filter=options, bound_factor=factor)
    return problem.program(problem.first_moments())


def from_file(name: str) -> Program:
    """The first batch of a problem file, without its caps."""
    problem = replace(read_problem(PROBLEMS / f"{name}.yaml"), caps=None, prices=None, fixed=None)
    return problem.program(problem.first_moments())


def by_cvxpy(form: NormalForm) -> float:
    """The same scaled inequality through CVXPY at its default tolerances, which are looser than ours."""
    import cvxpy as cp

    x = cp.Variable(len(form.costs), nonneg=True)
    constraint = form.constant + form.factors.T @ cp.diag(x) @ form.factors >> 0
    problem = cp.Problem(cp.Minimize(form.costs @ x), [constraint])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        problem.solve(solver=cp.CLARABEL)
    return form.unit * float(problem.value)


def _timed(call: Callable[[], Any], repeat: int) -> tuple[float, Any]:
    best, value = np.inf, None
    for _ in range(repeat):
        started = time.perf_counter()
        value = call()
        best = min(best, time.perf_counter() - started)
    return best, value


def rows(quick: bool = False) -> list[dict]:
    """One record per program: sizes, seconds of the three routes (the best of a few), and how far they agree.

    Parameters
    ----------
    quick : leave out what takes longer than a few seconds (Clarabel and CVXPY at 60 rows, rings above 100)
    """
    cases: list[tuple[str, Program, bool]] = [
        ("Lorenz-96, one step", from_file("lorenz96_enkf"), True),
        ("Lorenz-96, batch of three", from_file("lorenz96_enkf_batch3"), not quick),
    ]
    cases += [(f"Lorenz-96 ring of {n}", lorenz96(n), False) for n in ((40, 80) if quick else (40, 80, 120, 160, 200))]
    result = []
    for name, program, all_routes in cases:
        split, verdict, _ = examine(program)
        form = reduced_form(split, program.prices, program.caps, verdict.keep)
        seconds, found = _timed(lambda p=program: solve_program(p), 3)
        row: dict[str, Any] = {
            "problem": name,
            "sensors": program.moments.sensors,
            "rows": form.rows,
            "objective": found.objective,
            "relative_gap": found.relative_gap,
            "iterations": found.iterations,
            "barrier_seconds": seconds,
        }
        if all_routes:
            repeat = 3 if form.rows < 40 else 1
            row["clarabel_seconds"], other = _timed(lambda p=program: solve_program(p, "clarabel"), repeat)
            row["cvxpy_seconds"], value = _timed(lambda f=form: by_cvxpy(f), repeat)
            row["clarabel_difference"] = abs(other.objective - found.objective) / found.objective
            row["cvxpy_difference"] = abs(value - found.objective) / found.objective
            row["times_faster_than_cvxpy"] = row["cvxpy_seconds"] / seconds
        result.append(row)
    return result


if __name__ == "__main__":
    import sys

    for record in rows("--quick" in sys.argv):
        print("  ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in record.items()))
