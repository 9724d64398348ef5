"""One step an interval with prices that were corrected for many: what the search for a schedule works on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.families.athans.integration.folded import Extrapolated, Folded
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.sweep import Sweep


class Judged:
    """J itself as something to minimise over policies on the decisions.

    Parameters
    ----------
    on : what J is computed with
    base : Recursion with one step an interval
    """

    def __init__(self, on: Folded | Extrapolated, base: Recursion):
        self.on, self.recursion = on, base
        self.forward_count = self.backward_count = 0
        self.shape, self.states = (base.intervals, base.sensors), base.states

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy, `weights` (N, M)."""
        self.forward_count += 1
        self.backward_count += 1
        return self.on.cost_and_gradient(weights)

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, M)."""
        self.forward_count += 1
        return self.on.cost(weights)

    def repriced(self, weights: np.ndarray) -> Sweep:
        """One step an interval, with prices that make its gradient at `weights` (N, M) that of J."""
        difference = self.on.cost_and_gradient(weights)[1] - Sweep(self.recursion).cost_and_gradient(weights)[1]
        return Sweep(replace(self.recursion, cost=self.recursion.cost + difference))


class PricedSweep(Sweep):
    """The sweep over a recursion with one step an interval whose prices were corrected, and the relaxation behind it.

    Parameters
    ----------
    recursion : with corrected prices
    base : with the prices as they are
    outcome : of the relaxation, in terms of J
    inner : the same in terms of this sweep, whose costs differ by a constant and by less than the gap
    on : what J was computed with; None where one step an interval is accurate enough, or asked for
    """

    def __init__(
        self,
        recursion: Recursion,
        base: Recursion,
        outcome: RelaxedOutcome,
        inner: RelaxedOutcome,
        on: Folded | Extrapolated | None,
    ):
        super().__init__(recursion)
        self.base, self.outcome, self.inner, self.on = base, outcome, inner, on


def judge_of(sweep: Sweep) -> Judged | Sweep:
    """What costs policies as accurately as the problem asks for; the sweep itself where it is accurate.

    Parameters
    ----------
    sweep : that a method works on
    """
    if isinstance(sweep, PricedSweep) and sweep.on is not None:
        return Judged(sweep.on, sweep.base)
    return sweep


def relaxation_of(sweep: Sweep) -> RelaxedOutcome | None:
    """The relaxation that was done already, in terms of J; None if there is none.

    Parameters
    ----------
    sweep : that a method works on
    """
    return sweep.outcome if isinstance(sweep, PricedSweep) else None


def in_terms_of(sweep: Sweep, relaxed: RelaxedOutcome) -> RelaxedOutcome:
    """The relaxation with costs and bounds that compare with those of the sweep, not of J.

    Parameters
    ----------
    sweep : that a method works on
    relaxed : in terms of J
    """
    return sweep.inner if isinstance(sweep, PricedSweep) else relaxed
