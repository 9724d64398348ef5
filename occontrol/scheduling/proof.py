"""The numbers of a certificate: cost and bound of the final policies, with what rounding may have done to them.

Both come from the square-root form (certified.py). A bound that the solver proved on its way, mixed from many policies,
is known in the product form only. It is lowered by a multiple of what the two forms differ by on the final policies:
the difference covered the product form's error within 13 times in problems of extreme growth and priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.solution import ALLOWANCE, Certificate
from occontrol.scheduling.certified import Certified, Term, certified
from occontrol.scheduling.feasible_set import Bounding, FeasibleSet

MIXED = 20.0
DIGIT = 4 * float(np.finfo(float).eps)
MESHES = 5.0  # errors of integration by which the costs on two meshes may differ


@dataclass(frozen=True)
class Proof:
    """A certificate with what rounding has to do with it.

    Parameters
    ----------
    certificate : cost and lower bound, the bound lowered by `allowance`
    allowance : how far rounding may have moved either, in cost units
    difference : how far the solver's own arithmetic was off: in the costs of the final policies, or by so much of its
        bound that does not stand, in cost units
    below : how much the cost owes to a running weight slightly below zero, in cost units
    """

    certificate: Certificate
    allowance: float
    difference: float
    below: float

    @property
    def _nothing(self) -> bool:
        c = self.certificate
        return c.cost == 0.0 == c.lower_bound and not c.absolute

    def resolved(self, relative_gap: float) -> bool:
        """Whether rounding is smaller than a target gap, relative to the cost.

        Where nothing is spent the cost is 0, as is what no cost lies below: there is nothing to resolve.
        """
        if self._nothing:
            return True
        return max(self.allowance, self.difference) <= relative_gap * self.certificate.size

    def remark(self, relative_gap: float) -> str:
        """What the user reads about rounding, empty where it does not matter.

        Parameters
        ----------
        relative_gap : the target, relative to the cost
        """
        limit = relative_gap * self.certificate.size
        text = ""
        if self._nothing:
            return text
        if self.allowance > limit:
            text = (
                f" Rounding alone may move cost and bound by {self.allowance:.3g}, more than the target gap: the data "
                "span more orders of magnitude than double precision resolves."
            )
        elif self.difference > limit:
            text = (
                f" The solver's arithmetic was off by {self.difference:.3g}, more than the target gap; cost and bound "
                "are those of the square-root form, the schedule may not be the best."
            )
        if self.below > 0:
            text += (
                " The running weight is slightly below zero, within its tolerance: that lowers the cost by "
                f"{self.below:.6g}."
            )
        return text


@dataclass(frozen=True, eq=False)
class Judged:
    """A policy that was costed in the solver's arithmetic, for `prove` to cost again.

    Parameters
    ----------
    weights : (N, M) policy of the set
    cost : J by the sweeps
    gradient : (N, M) dJ/dv by the sweeps
    terms : what the cost is the sum of
    error : estimated error of J that does not come from rounding
    offset : what the cost is more than its terms; a criterion other than the trace has its tangent as terms
    slack : how far rounding may have moved cost and bound beside what is measured on the terms
    """

    weights: np.ndarray
    cost: float
    gradient: np.ndarray
    terms: Sequence[Term]
    error: float = 0.0
    offset: float = 0.0
    slack: float = 0.0

    def certified(self, bounding: Bounding) -> Certified:
        """Its terms costed again in square-root form.

        Parameters
        ----------
        bounding : what the bound holds for
        """
        return certified(self.terms, bounding, self.weights)


def prove(
    policies: Sequence[Judged], feasible_set: FeasibleSet, known_bound: float = -np.inf, signed: bool = False
) -> Proof:
    """Cost of a policy and the best lower bound that is known, in square-root form.

    Parameters
    ----------
    policies : the policy in question, then others whose own bounds may be tighter (the relaxed optimum)
    feasible_set : the set that the bound holds for
    known_bound : a lower bound that the solver has proven in its own arithmetic, if any
    signed : whether the cost holds a logarithm and may be negative
    """
    found, difference, spread = [], 0.0, 0.0
    for policy in policies:
        exact = policy.certified(feasible_set)
        exact = replace(
            exact,
            cost=exact.cost + policy.offset,
            lower_bound=exact.lower_bound + policy.offset,
            cost_allowance=exact.cost_allowance + policy.slack,
            bound_allowance=exact.bound_allowance + policy.slack,
        )
        own = feasible_set.bound(policy.cost, policy.weights, policy.gradient)
        difference = max(difference, abs(policy.cost - exact.cost))
        spread = max(spread, abs(own - exact.lower_bound))
        found.append(exact)
    final, error = found[0], max(policy.error for policy in policies)
    bounds = [
        (exact.lower_bound - exact.bound_allowance - policy.error, exact.bound_allowance)
        for exact, policy in zip(found, policies, strict=True)
    ]
    if final.convex:
        # the last digit of the costs that the bound was computed from; that of the schedule itself may be 0
        own = max(min(each.bound_allowance for each in found), DIGIT * max(abs(each.cost) for each in found))
        bounds.append((known_bound - MIXED * max(spread, difference) - own, own))
        if final.cost >= 0 and not signed:  # no cost is negative, as q, R and W are not
            bounds.append((0.0, 0.0))
    usable = [(bound, own) for bound, own in bounds if np.isfinite(bound)] or [(-np.inf, np.inf)]
    bound, allowance = max(usable)
    if final.convex and np.isfinite(known_bound):
        difference = max(difference, min(known_bound, final.cost) - bound - allowance - error)
    difference = difference if np.isfinite(difference) else np.inf
    allowance = max(allowance, final.cost_allowance)
    # costs and bounds may come from different meshes: that far a bound may lie above a cost
    within, size = allowance + MESHES * error, 1.0 if signed else abs(final.cost)
    share = (within if signed else min(within, size)) / size if size else 0.0
    certificate = Certificate(final.cost, bound, max(share, ALLOWANCE), signed)
    return Proof(certificate, allowance, difference, final.below)
