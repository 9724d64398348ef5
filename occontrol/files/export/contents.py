"""What the whole-run formats (json, npz, mat) hold beside the arrays of the run folder."""

from __future__ import annotations

from typing import Any

import numpy as np

from occontrol.core.solution import Solution


def filter_arrays(problem: Any, solution: Solution) -> dict[str, np.ndarray]:
    """The tables of the matched filter (see families/athans/filter/tables.py); empty for families without one.

    Parameters
    ----------
    problem : the problem
    solution : Solution
    """
    if problem.family != "athans" or solution.schedule is None:
        return {}
    from occontrol.families.athans.filter.planned import default_model
    from occontrol.families.athans.filter.tables import filter_tables

    return filter_tables(problem, solution.schedule, default_model(solution.result))
