"""The numbers that a solve of the athans family reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.core.result import ResultData
from occontrol.core.solution import Certificate


@dataclass(frozen=True)
class TopNumbers(ResultData):
    """The pair that stands at the top of whatever a person reads.

    Parameters
    ----------
    cost, lower_bound, relative_gap : of the policy
    of : "continuous", whenever a schedule switches; "grid", for schedules that change at the edges; "problem", for
        every schedule of readings
    gap : "difference" where the cost holds a logarithm and `relative_gap` is cost - lower_bound
    """

    cost: float
    lower_bound: float
    relative_gap: float
    of: str
    gap: str | None = field(default=None, metadata={"optional": True})

    @property
    def absolute(self) -> bool:
        """Whether the gap is a difference."""
        return self.gap is not None

    @classmethod
    def stated(cls, certificate: Certificate, of: str) -> TopNumbers:
        """The pair of a `certificate` that holds `of` something."""
        c = certificate
        return cls(c.cost, c.lower_bound, c.relative_gap, of, "difference" if c.absolute else None)


@dataclass(frozen=True)
class ContinuousNumbers(ResultData):
    """A policy integrated again in continuous time, with other code; all None where that did not finish.

    Parameters
    ----------
    cost : J of the policy
    lower_bound : no schedule costs less, whenever it switches
    relative_gap : (cost - lower_bound)/|cost|
    reason : why it did not finish
    """

    cost: float | None
    lower_bound: float | None
    relative_gap: float | None
    reason: str | None = field(default=None, metadata={"optional": True})


@dataclass(frozen=True)
class AthansResult(ResultData):
    """The numbers of result.json of this family.

    Parameters
    ----------
    name : of the problem
    top : the pair to look at first
    cost, lower_bound, relative_gap : of the discretised problem; the gap is a difference where a logarithm counts
    allowance : how far rounding may have moved cost and bound, in cost units; the bound is lowered by it
    observation_cost : int sum_j q_j v_j dt, before it is weighted
    cost_weight : alpha
    running_cost : int tr(R Sigma) dt
    prediction_error : tr(W Sigma(T))
    predicted_mean_square_error : the same and what the noise between T and Tp adds
    continuous : the same policy in continuous time
    discretisation_error : estimated |J(h) - J(0)|
    relaxed_cost, relaxed_lower_bound : of the convex relaxation
    singular_fraction : share of the horizon on singular arcs of the relaxed optimum
    intervals, integration_steps : how many intervals one can choose on, and steps in all of them
    readings : how many instants there are at which sensors can be read; None for continuous sensing, which alone has
        integration steps, a continuous check and singular arcs
    integration_error : estimated error of `cost` against continuous time
    added_edges : [{t, why}] edges that are not in the file
    warnings : what the file leaves to be thought over
    switches : inner edges at which the set of sensors changes
    sweeps : what the relaxation needed, by name
    extra : what one method alone has to say (polish_rounds, end, collocation_cost)
    switching_cost : of the changes, part of the cost
    proven_optimal : whether cost and bound have met
    nodes : of the tree that was searched
    constraints : {satisfied, active}, active the rules that bind the schedule
    multipliers : {rule: price of one more unit of a budget}, in cost units
    certificate_of : "problem", or "linearised" where the plant is nonlinear: cost and bound are then of the problem
        linearised along its nominal path
    nonlinearity : {readings, predictions} of the plan of a nonlinear plant, see nonlinear/index.py
    criterion : true value of the criterion that the problem names
    schedule : [{start, end, sensors}], see Schedule.segments; [{start, end, resource, target}] for many targets
    bounds : {averaged, tree} of an infinite horizon; of many targets {relaxed, integer}: the bound that shares of
        looks prove, and the one that knows that looks are whole
    blocks : how many parts of the states nothing couples
    targets : how many targets there are
    per_target : {cost, error} of every target, up to 200 of them; with its share of the observation cost, and without
    period : steps of the cycle, for an infinite horizon; cost and bound are then per step or unit of time
    word : what is used at each step of the cycle
    leaves : words of the proof for all schedules
    shares : {sensor: share of the time} of the averaged optimum
    """

    name: str
    top: TopNumbers | None
    cost: float
    lower_bound: float
    relative_gap: float
    allowance: float
    observation_cost: float
    cost_weight: float
    running_cost: float
    prediction_error: float
    predicted_mean_square_error: float
    continuous: ContinuousNumbers | None = field(metadata={"optional": True})
    discretisation_error: float | None = field(metadata={"optional": True})
    relaxed_cost: float
    relaxed_lower_bound: float
    singular_fraction: float | None = field(metadata={"optional": True})
    intervals: int
    readings: int | None = field(metadata={"optional": True})
    integration_steps: int | None = field(metadata={"optional": True})
    integration_error: float | None = field(metadata={"optional": True})
    added_edges: list[PlainDict] | None = field(metadata={"optional": True})
    warnings: list[str]
    switches: int
    sweeps: Mapping[str, int]
    extra: PlainMapping
    schedule: list[PlainDict]
    switching_cost: float | None = field(default=None, metadata={"optional": True})
    proven_optimal: bool | None = field(default=None, metadata={"optional": True})
    nodes: int | None = field(default=None, metadata={"optional": True})
    constraints: PlainMapping | None = field(default=None, metadata={"optional": True})
    multipliers: Mapping[str, float] | None = field(default=None, metadata={"optional": True})
    certificate_of: str = "problem"
    nonlinearity: Mapping[str, float] | None = field(default=None, metadata={"optional": True})
    criterion: float | None = field(default=None, metadata={"optional": True})
    bounds: PlainMapping | None = field(default=None, metadata={"optional": True})
    blocks: int | None = field(default=None, metadata={"optional": True})
    targets: int | None = field(default=None, metadata={"optional": True})
    per_target: PlainMapping | None = field(default=None, metadata={"optional": True})
    period: int | None = field(default=None, metadata={"optional": True})
    word: list[str] | None = field(default=None, metadata={"optional": True})
    leaves: int | None = field(default=None, metadata={"optional": True})
    shares: Mapping[str, float] | None = field(default=None, metadata={"optional": True})

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The result that a result.json describes; what is not there is None."""
        stated = content.get("continuous")
        continuous = ContinuousNumbers.from_dict(stated) if isinstance(stated, Mapping) else None
        first = content.get("top")
        top = TopNumbers.from_dict(first) if isinstance(first, Mapping) else None
        of = content.get("certificate_of") or "problem"
        return super().from_dict({**content, "continuous": continuous, "top": top, "certificate_of": of})
