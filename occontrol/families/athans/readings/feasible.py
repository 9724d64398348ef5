"""Whether a problem of readings has any schedule: places, budgets, rules."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import InfeasibleError, plural

if TYPE_CHECKING:
    from occontrol.families.athans.readings.problem import ReadingsProblem

MOST_GAPS = 10  # of a window plan that are named


def require_places(problem: ReadingsProblem) -> None:
    """Raise InfeasibleError, with the times, where fewer than the least number of sensors can be read.

    Parameters
    ----------
    problem : ReadingsProblem
    """
    lacking = np.flatnonzero(np.sum(problem.upper, axis=1) < problem.places - 1e-9)
    if not len(lacking):
        return
    t, least = problem.clock.variable, problem.select[0]
    shown = ", ".join(f"{problem.clock.times[problem.first_readings[k]]:.6g}" for k in lacking[:MOST_GAPS])
    more = f", and {len(lacking) - MOST_GAPS} more" if len(lacking) > MOST_GAPS else ""
    raise InfeasibleError(
        f"at {t} = {shown}{more} fewer than {plural(least, 'sensor')} can be read\n"
        "  hint: widen a window, let fewer be chosen (select: 0..1), or add 'idle' to the sensors"
    )


def require_budget(problem: ReadingsProblem) -> None:
    """Raise InfeasibleError where the windows leave too few readings for the budget.

    Parameters
    ----------
    problem : ReadingsProblem
    """
    for key, wanted in (problem.budget or {}).items():
        columns = [j for j, s in enumerate(problem.sensors) if not s.is_idle and key in ("total", s.name)]
        room = int(np.sum(np.minimum(np.sum(problem.upper[:, columns], axis=1), problem.places)))
        if room < wanted:
            who = "all sensors together" if key == "total" else f"sensor '{key}'"
            raise InfeasibleError(
                f"the budget asks for {plural(int(wanted), 'reading')} of {who}, there is room for {room}\n"
                "  hint: widen a window, take more sample times, or a smaller budget"
            )
    total = sum(problem.budget.values()) if problem.budget and "total" not in problem.budget else 0
    if total > problem.readings * problem.places:
        raise InfeasibleError(
            f"the budgets ask for {plural(total, 'reading')}, {problem.places} at a time leave room for "
            f"{problem.readings * problem.places}\n  hint: a larger select, or smaller budgets"
        )
