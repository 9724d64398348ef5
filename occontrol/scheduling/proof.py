"""The numbers of a certificate: cost and bound of the final policies, with what rounding may have done to them.

Both come from the square-root form (certified.py). A bound that the solver proved on its way, mixed from many policies,
is known in the product form only. It is lowered by a multiple of what the two forms differ by on the final policies:
the difference covered the product form's error within 13 times in problems of extreme growth and priors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.solution import Certificate
from occontrol.scheduling.certified import certified
from occontrol.scheduling.polytope import excess
from occontrol.scheduling.sweep import Sweep

MIXED = 20.0


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

    def resolved(self, relative_gap: float) -> bool:
        """Whether rounding is smaller than a target gap, relative to the cost."""
        return max(self.allowance, self.difference) <= relative_gap * abs(self.certificate.cost)

    def remark(self, relative_gap: float) -> str:
        """What the user reads about rounding, empty where it does not matter.

        Parameters
        ----------
        relative_gap : the target, relative to the cost
        """
        limit = relative_gap * abs(self.certificate.cost)
        text = ""
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


def prove(sweep: Sweep, weights: np.ndarray, known_bound: float = -np.inf, relaxed: np.ndarray | None = None) -> Proof:
    """Cost of a policy and the best lower bound that is known, in square-root form.

    Parameters
    ----------
    sweep : Sweep, in the arithmetic of which `known_bound` was found
    weights : (N, M) policy in V
    known_bound : a lower bound of the same recursion, if any
    relaxed : (N, M) the relaxed optimum, whose own bound is the tighter one
    """
    r, final, difference, spread = sweep.recursion, certified(sweep.recursion, weights), 0.0, 0.0
    policies, found = [weights], [final]
    if relaxed is not None and relaxed is not weights:
        policies.append(relaxed)
        found.append(certified(r, relaxed))
    for v, exact in zip(policies, found, strict=True):
        J, g = sweep.cost_and_gradient(v)
        own = J - float(np.sum(excess(v, g, r.upper, r.select)))
        difference = max(difference, abs(J - exact.cost))
        spread = max(spread, abs(own - exact.lower_bound))
    bounds = [(exact.lower_bound - exact.bound_allowance, exact.bound_allowance) for exact in found]
    if final.convex:
        own = min(exact.bound_allowance for exact in found)
        bounds.append((known_bound - MIXED * max(spread, difference) - own, own))
        # no cost is negative, as q, R and W are not
        bounds.append((0.0, 0.0))
    usable = [(bound, own) for bound, own in bounds if np.isfinite(bound)] or [(-np.inf, np.inf)]
    bound, allowance = max(usable)
    if final.convex and np.isfinite(known_bound):
        difference = max(difference, min(known_bound, final.cost) - bound - allowance)
    difference = difference if np.isfinite(difference) else np.inf
    allowance = max(allowance, final.cost_allowance)
    return Proof(Certificate(final.cost, min(bound, final.cost)), allowance, difference, final.below)
