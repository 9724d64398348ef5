"""One JSON file: names, result, schedule, every array of a run (times, gains, covariance), the filter's tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.core.versions import KEY, SCHEMA_VERSION
from occontrol.files.atomic import write_text
from occontrol.files.plain_json import to_json


def write(problem: BaseProblem, solution: Solution, tables: Mapping[str, np.ndarray], target: Path) -> list[Path]:
    """Write one JSON file.

    Parameters
    ----------
    problem : the problem
    solution : Solution
    tables : arrays of the filter, by name, of any shape
    target : the file
    """
    content = {
        KEY: SCHEMA_VERSION,
        "name": problem.name,
        "family": problem.family,
        "method": solution.method,
        "sensors": getattr(getattr(problem, "sensors", None), "names", None),
        "schedule": solution.result.get("schedule"),
        "result": {key: value for key, value in solution.result.items() if key != "schedule"},
        "arrays": dict(solution.arrays),
        "filter": dict(tables),
    }
    target.parent.mkdir(parents=True, exist_ok=True)
    return [write_text(target, to_json(content))]
