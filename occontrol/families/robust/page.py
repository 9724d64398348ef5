"""The panels of a robust page: who measures when, how large the set of possible states can become, and where."""

from __future__ import annotations

import numpy as np

from occontrol.core.kinds import Plain
from occontrol.core.solution import Solution
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.result import SequenceResult, numbers_of
from occontrol.files.page.content import Curves, Group, Panel, Table
from occontrol.files.page.usual import TIME, deviation_panels, schedule_bars


def groups(problem: Problem, solution: Solution) -> list[Group]:
    """The panels of a solution.

    Parameters
    ----------
    problem : Problem of the family robust
    solution : Solution
    """
    arrays, panels = solution.arrays, list[Panel]()
    if solution.schedule is not None:
        panels.append(schedule_bars(solution.schedule, "who measures when"))
    if "fine_times" in arrays:
        size = arrays["fine_size"][:, None]
        panels.append(Curves(title=f"size of the set of possible states, worst case up to t: {problem.measure.text}",
                             label="size", times=arrays["fine_times"], values=size, names=["size"]))  # fmt: skip
        half = np.sqrt(arrays["fine_level"][:, None] * np.diagonal(arrays["fine_shape"], axis1=1, axis2=2))
        title = "half width of the set along every state, worst case"
        panels += deviation_panels(problem, arrays["fine_times"], half, title, "half width")
    return [Group(axis=TIME, panels=panels)] if panels else []


def tables(solution: Solution) -> list[Table]:
    """The sequences that were ranked, where they were.

    Parameters
    ----------
    solution : Solution
    """
    numbers = numbers_of(solution)
    ranking = numbers.ranking if isinstance(numbers, SequenceResult) else None
    if not ranking:
        return []
    columns = {key: [_text(record.get(key)) for record in ranking] for key in ranking[0]}
    return [Table(title="the best sequences", columns=columns)]


def _text(value: Plain) -> Plain:
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else value
