"""What a robust solve found, as data: one dataclass for each of the three outcomes, in the order of result.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from occontrol.core.errors import ProblemError
from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.core.result import ResultData
from occontrol.core.solution import Solution

_OPTIONAL = {"optional": True}  # no entry where it is None


@dataclass(frozen=True, eq=False)
class SwitchingResult(ResultData):
    """The numbers of a robust solve: of a sequence, of shares, or of a plant that no schedule can observe."""

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The result that `content` describes, as the dataclass of its outcome."""
        kind: Any = cls
        if cls is SwitchingResult:
            kind = SequenceResult
            if "gain_factor" in content:
                kind = UnobservableResult
            elif "singular_fraction" in content:
                kind = SharesResult
            return kind.from_dict(content)
        return super().from_dict(content)


@dataclass(frozen=True, eq=False)
class Independent(ResultData):
    """The cost by direct integration of the paper's equations, with what it follows from.

    Parameters
    ----------
    cost, level : the size at the end, d + x0'Y(0)x0
    Y_initial : Y(t0) as rows (n, n)
    """

    cost: float
    level: float
    Y_initial: list[list[float]]


@dataclass(frozen=True, eq=False, kw_only=True)
class SequenceResult(SwitchingResult):
    """One sensor in every slot.

    Parameters
    ----------
    name : of the problem
    cost : the size at the end that no measurement and no admissible uncertainty exceeds
    lower_bound : no sequence on these slots has a smaller size
    relative_gap : (cost - lower_bound)/|cost|
    level : d + x0'Y(0)x0, the largest d + rho that measurements can bring
    size : {name: weight}
    observability_horizon : the end of uniform robust observability; None is never, or beyond `followed_to`
    observability_followed_to : how far a time-varying plant was followed; None for a constant plant
    X_initial, Y_initial : X(t0) and Y(t0) as rows (n, n)
    sequence : the N sensor names
    switches : how often the sensor changes
    independent : the check; None where the integrator gave up
    sequences, worst_cost, ranking : of method all: how many there are, the worst, the best ones in order
    nodes, widest_layer, merged, dropped, limit, relaxed_bound : of the search
    one_step_cost : what looking one slot ahead gives
    best_known_cost : of certify: the lowest size of any sequence that was seen
    schedule : [{start, end, sensors}]
    """

    name: str
    cost: float
    lower_bound: float
    relative_gap: float
    level: float
    size: Mapping[str, float]
    observability_horizon: float | None
    observability_followed_to: float | None
    X_initial: list[list[float]]
    Y_initial: list[list[float]]
    sequence: list[str]
    switches: int
    independent: Independent | None
    sequences: int | None = field(default=None, metadata=_OPTIONAL)
    worst_cost: float | None = field(default=None, metadata=_OPTIONAL)
    ranking: Sequence[PlainMapping] | None = field(default=None, metadata=_OPTIONAL)
    nodes: int | None = field(default=None, metadata=_OPTIONAL)
    widest_layer: int | None = field(default=None, metadata=_OPTIONAL)
    merged: int | None = field(default=None, metadata=_OPTIONAL)
    dropped: int | None = field(default=None, metadata=_OPTIONAL)
    limit: str | None = field(default=None, metadata=_OPTIONAL)
    relaxed_bound: float | None = field(default=None, metadata=_OPTIONAL)
    one_step_cost: float | None = field(default=None, metadata=_OPTIONAL)
    best_known_cost: float | None = field(default=None, metadata=_OPTIONAL)
    schedule: list[PlainDict]

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The result that `content` describes."""
        stated = content.get("independent")
        judged = Independent.from_dict(stated) if isinstance(stated, Mapping) else None
        return super().from_dict({**content, "independent": judged})


@dataclass(frozen=True, eq=False, kw_only=True)
class SharesResult(SwitchingResult):
    """Slots shared between sensors: a bound for every sequence, and no schedule.

    Parameters
    ----------
    name, cost, lower_bound, relative_gap, level, size, observability_horizon, observability_followed_to,
    X_initial, Y_initial, schedule : as in `SequenceResult`
    singular_fraction : the share of the horizon on which sensors share a slot
    """

    name: str
    cost: float
    lower_bound: float
    relative_gap: float
    level: float
    size: Mapping[str, float]
    observability_horizon: float | None
    observability_followed_to: float | None
    X_initial: list[list[float]]
    Y_initial: list[list[float]]
    singular_fraction: float
    schedule: list[PlainDict]


@dataclass(frozen=True, eq=False, kw_only=True)
class UnobservableResult(SwitchingResult):
    """A plant that is not uniformly robustly observable on the horizon, whatever the sensors.

    Parameters
    ----------
    name : of the problem
    cost, lower_bound, relative_gap, level, Y_initial : None
    observability_horizon : the end to which it would be
    X_initial : X(t0) as rows (n, n), None where X escapes before
    gain_factor : the plant is observable when K is multiplied by less
    X_escape_time : where X, followed back from the end, escapes; None when it lives to t0
    escape_time : where P escapes along the schedule that was asked for; None when it lives to the end
    followed : whether a schedule was asked for (not an entry: without one there is no escape_time)
    schedule : empty
    """

    name: str
    cost: float | None = None
    lower_bound: float | None = None
    relative_gap: float | None = None
    observability_horizon: float | None
    level: float | None = None
    X_initial: list[list[float]] | None
    Y_initial: list[list[float]] | None = None
    gain_factor: float
    X_escape_time: float | None
    escape_time: float | None = None
    schedule: Sequence[PlainDict] = ()
    followed: bool = False

    def as_dict(self) -> PlainDict:
        """The entries of result.json."""
        left_out = {"followed"} if self.followed else {"followed", "escape_time"}
        return {key: value for key, value in super().as_dict().items() if key not in left_out} | {"schedule": []}

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The result that `content` describes."""
        return super().from_dict({**content, "followed": "escape_time" in content})


def numbers_of(solution: Solution) -> SwitchingResult:
    """The numbers of a solution as their type; also where the run was read from a folder.

    Parameters
    ----------
    solution : Solution of this family
    """
    own = solution.numbers
    return own if isinstance(own, SwitchingResult) else SwitchingResult.from_dict(solution.result)


def sequence_of(solution: Solution) -> list[int]:
    """The sensor of every slot in a solution's schedule; ProblemError when it shares slots between sensors.

    Parameters
    ----------
    solution : Solution
    """
    weights = solution.arrays.get("weights")
    if weights is None or np.any(np.abs(np.max(weights, axis=1) - 1) > 1e-6):
        raise ProblemError("this run shares slots between sensors; it has no schedule to follow", "use method optimal")
    return [int(i) for i in np.argmax(weights, axis=1)]
