"""The panels of a selection's page: who was chosen, and how large the errors were."""

from __future__ import annotations

import numpy as np

from occontrol.core.solution import Solution
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.result import numbers_of
from occontrol.files.page.content import Curves, Group, Panel
from occontrol.files.page.usual import STEP, deviation_panels, schedule_bars


def groups(problem: Problem, solution: Solution) -> list[Group]:
    """The panels of a solution.

    Parameters
    ----------
    problem : Problem of the family vlambda
    solution : Solution
    """
    arrays, panels = solution.arrays, list[Panel]()
    if solution.schedule is not None:
        panels.append(schedule_bars(solution.schedule, "chosen"))
    panels += _locations(problem, solution)
    k, values = arrays["times"], arrays["eigenvalues"]
    columns = {"λmax, predicted": arrays["predicted_eigenvalues"][:, 0], "λmax": values[:, 0]}
    if values.shape[1] > 1:
        columns["trace"] = values.sum(axis=1)
    panels.append(Curves(title="error variance P(k|k): largest eigenvalue and trace", label="P(k|k)", times=k,
                         values=np.column_stack(list(columns.values())), names=list(columns)))  # fmt: skip
    panels += deviation_panels(problem, k, arrays["standard_deviations"], "standard deviation after the measurements")
    return [Group(axis=STEP, panels=panels, whole=True)]


def _locations(problem: Problem, solution: Solution) -> list[Panel]:
    """Where movable sensors stood, one curve for every coordinate."""
    entries = numbers_of(solution).schedule
    names = list(dict.fromkeys(f"{name} p{i + 1}" for e in entries for name, p in (e.locations or {}).items()
                               for i in range(len(p))))  # fmt: skip
    if not names:
        return []
    values = np.full((len(entries), len(names)), np.nan)
    for row, entry in enumerate(entries):
        for name, place in (entry.locations or {}).items():
            for i, x in enumerate(place):
                values[row, names.index(f"{name} p{i + 1}")] = x
    edges = np.asarray(problem.starts, dtype=float)
    return [Curves(title="where movable sensors stood", label="location", times=edges, values=values, names=names)]
