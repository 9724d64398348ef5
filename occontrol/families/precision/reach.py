"""Which bounds can be reached at all: the sentence about a bound that no precision reaches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from occontrol.families.precision.feasibility import Feasibility

if TYPE_CHECKING:
    from occontrol.families.precision.problem import Problem


def infeasible_text(problem: Problem, verdict: Feasibility) -> str:
    """The smallest bound that can be reached, and which combination of states prevents more.

    Parameters
    ----------
    problem : Problem
    verdict : of the batch that cannot meet its bound
    """
    smallest = problem.factor * verdict.factor
    limited = " with these caps" if np.any(np.isfinite(problem.caps)) else " with any precision"
    if problem.bound_factor is not None:
        text = f"The bound factor {problem.factor:g} cannot be reached{limited}: the smallest is {smallest:.10g}."
    else:
        text = f"The bound cannot be reached{limited}: the smallest that can is {smallest:.10g} times it."
    weight = np.abs(verdict.direction) * np.sqrt(np.diag(problem.bound))  # in units that can be compared
    order = [i for i in np.argsort(-weight, kind="stable") if weight[i] > 1e-3 * np.max(weight)]
    terms = [f"{verdict.direction[i]:+.3g} x{i + 1}" for i in order[:4]]
    more = " and further states" if len(order) > 4 else ""
    return f"{text} What prevents more is the error of {' '.join(terms)}{more}."
