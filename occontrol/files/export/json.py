"""One JSON file: names, result, schedule, every array of a run (times, gains, covariance), the filter's tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from occontrol.core.solution import Solution
from occontrol.files.atomic import write_text
from occontrol.files.export.contents import filter_arrays
from occontrol.files.plain_json import to_json


def write(problem: Any, solution: Solution, target: Path) -> list[Path]:
    """Write one JSON file.

    Parameters
    ----------
    problem : the problem
    solution : Solution
    target : the file
    """
    content = {
        "name": problem.name,
        "family": problem.family,
        "method": solution.method,
        "sensors": getattr(getattr(problem, "sensors", None), "names", None),
        "schedule": solution.result.get("schedule"),
        "result": {key: value for key, value in solution.result.items() if key != "schedule"},
        "arrays": dict(solution.arrays),
        "filter": filter_arrays(problem, solution),
    }
    target.parent.mkdir(parents=True, exist_ok=True)
    return [write_text(target, to_json(content))]
