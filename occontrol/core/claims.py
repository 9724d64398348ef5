"""What somebody says about a policy, and what is said about it when it is recomputed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from occontrol.core.solution import Certificate

RELATIVE = 1e-6


@dataclass(frozen=True)
class Claims:
    """What somebody says about a policy.

    Parameters
    ----------
    cost : of the discretised problem, in cost units, or None
    lower_bound : of the discretised problem, in cost units, or None
    continuous_bound : in continuous time, in cost units, or None
    relative_gap : (cost - lower_bound) / |cost|, or None
    parts : further numbers by the names that they have in a result, such as prediction_error
    absolute : whether the cost holds a logarithm, see Certificate
    choices : what repeats a run beyond its schedule, such as where movable sensors stood; in the family's own terms
    whole : whether `lower_bound` is one for schedules without shares only, so that a relaxed policy does not refute it
    """

    cost: float | None = None
    lower_bound: float | None = None
    continuous_bound: float | None = None
    relative_gap: float | None = None
    parts: Mapping[str, float] = field(default_factory=dict)
    whole: bool = False
    absolute: bool = False
    choices: Any = None


def false_claims(
    claims: Claims,
    cost: float,
    lowest_cost: float,
    continuous_cost: float | None = None,
    parts: Mapping[str, float] | None = None,
) -> list[str]:
    """Sentences on every claim that the recomputed numbers refute; empty if none is.

    A claimed bound is refuted when some policy, relaxed or not, costs less than it.

    Parameters
    ----------
    claims : Claims
    cost : recomputed J of the claimed policy, in cost units
    lowest_cost : the lowest J of any policy known, in cost units, the relaxed optimum included
    continuous_cost : recomputed J in continuous time, in cost units, or None
    parts : recomputed numbers by name
    """
    found, size = [], max(abs(cost), 1.0) if claims.absolute else abs(cost)
    slack = 1e-8 * (size if claims.absolute else abs(lowest_cost))
    if claims.cost is not None and not abs(claims.cost - cost) <= 1e-8 * size:
        found.append(f"the stated cost is {claims.cost:.10g}, the schedule costs {cost:.10g}")
    if claims.lower_bound is not None and not claims.lower_bound <= lowest_cost + slack:
        found.append(
            f"the stated lower bound {claims.lower_bound:.10g} is not one: a known policy costs {lowest_cost:.10g}"
        )
    if None not in (claims.relative_gap, claims.cost, claims.lower_bound):
        gap = Certificate(claims.cost, claims.lower_bound, absolute=claims.absolute).relative_gap  # type: ignore[arg-type]
        if not abs(claims.relative_gap - gap) <= RELATIVE:  # type: ignore[operator]
            found.append(f"the stated relative gap is {claims.relative_gap:.10g}, its cost and bound give {gap:.10g}")
    bound = claims.continuous_bound
    if bound is not None and continuous_cost is not None and not bound <= continuous_cost + RELATIVE * size:
        found.append(
            f"the stated continuous lower bound {bound:.10g} is not one: this policy costs {continuous_cost:.10g}"
        )
    for name, value in (parts or {}).items():
        stated = claims.parts.get(name)
        if stated is not None and not abs(stated - value) <= RELATIVE * max(abs(value), size):
            found.append(f"the stated {name.replace('_', ' ')} is {stated:.10g}, recomputed {value:.10g}")
    return found
