"""What a precision problem says that is allowed and hardly meant."""

from __future__ import annotations

from occontrol.core.errors import Mistake
from occontrol.families.precision.ensemble import EnsembleFilter
from occontrol.families.precision.problem import Problem


def warnings_of(problem: Problem) -> list[Mistake]:
    """An ensemble with fewer members than states: its covariance has rank members - 1 at most.

    Parameters
    ----------
    problem : of this family
    """
    chosen = problem.filter
    if not isinstance(chosen, EnsembleFilter) or problem.plant is None or chosen.members > problem.plant.states:
        return []
    n = problem.plant.states
    what = f"the ensemble has {chosen.members} members, the plant {n} states: its covariance is singular"
    return [Mistake(("filter", "members"), what, f"more than {n} members")]
