"""What a precision solve found, as data: the numbers of all batches, of each batch, and of the pruning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.core.result import ResultData
from occontrol.core.solution import Solution

_OPTIONAL = {"optional": True}  # no entry where it is None


@dataclass(frozen=True, eq=False, kw_only=True)
class RemovalRecord(ResultData):
    """One step of the pruning.

    Parameters
    ----------
    removed : labels of the measurements that left together
    objective, price : afterwards, and what leaving them out cost
    remaining : how many groups of measurements may still be used
    """

    removed: list[str]
    objective: float
    price: float
    remaining: int


@dataclass(frozen=True, eq=False, kw_only=True)
class PruningRecord(ResultData):
    """What it costs to do with fewer sensors.

    Parameters
    ----------
    objective_before : with all sensors
    removals : one record per removal, in order
    refused : labels of what was kept because the linearised plant would lose its detectability
    reason : why it ended
    restricted_lower_bound : proven for the sensors that are left
    proven : whether the set is the best of its size (exact search only)
    """

    objective_before: float
    removals: Sequence[RemovalRecord]
    refused: list[str]
    reason: str
    restricted_lower_bound: float
    proven: bool

    def as_dict(self) -> PlainDict:
        """The entries of result.json."""
        return super().as_dict() | {"removals": [record.as_dict() for record in self.removals]}

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The record that `content` describes."""
        return super().from_dict({**content, "removals": _records(RemovalRecord, content.get("removals") or ())})


@dataclass(frozen=True, eq=False, kw_only=True)
class BatchRecord(ResultData):
    """One batch; what is None has no entry, as most of it where the bound could not be met.

    Parameters
    ----------
    batch, status : number from 1 on, how its program ended
    smallest_factor : the smallest bound that precision can reach, in the user's terms
    objective, lower_bound : sum of price times precision, and what no choice of precisions undercuts
    active, active_sensors : how many measurements are used, and their labels
    margin, relative_margin : smallest eigenvalue of bound - posterior, and in units of the bound
    least_active : at least this many measurements are needed
    rms_error : of the estimate against the simulated truth, over the states
    filter_relative_margin : of the covariance that the filter itself holds
    guarantee : whether the covariance (11) keeps the bound
    nis : normalised innovation squared; None where nothing was measured
    pruning : PruningRecord, where sensors were dropped
    """

    batch: int
    status: str
    smallest_factor: float
    objective: float | None = field(default=None, metadata=_OPTIONAL)
    lower_bound: float | None = field(default=None, metadata=_OPTIONAL)
    active: int | None = field(default=None, metadata=_OPTIONAL)
    active_sensors: list[str] | None = field(default=None, metadata=_OPTIONAL)
    margin: float | None = field(default=None, metadata=_OPTIONAL)
    relative_margin: float | None = field(default=None, metadata=_OPTIONAL)
    least_active: int | None = field(default=None, metadata=_OPTIONAL)
    rms_error: float | None = field(default=None, metadata=_OPTIONAL)
    filter_relative_margin: float | None = field(default=None, metadata=_OPTIONAL)
    guarantee: bool | None = field(default=None, metadata=_OPTIONAL)
    nis: float | None = field(default=None, metadata=_OPTIONAL)
    pruning: PruningRecord | None = field(default=None, metadata=_OPTIONAL)

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The record that `content` describes."""
        return super().from_dict({**content, "pruning": _pruning(content)})


@dataclass(frozen=True, eq=False, kw_only=True)
class PrecisionResult(ResultData):
    """The numbers of all batches; what is None has no entry.

    Parameters
    ----------
    name : of the problem
    smallest_factor : the smallest bound that precision can reach: as a factor where the problem gives a factor, else
        as a multiple of the bound matrix
    preventing_direction : (n,) weights of the combination of states whose error prevents more, of a bound out of reach
    infeasible_batch : number of the batch that could not meet the bound
    objective, cost : sum of price times precision over all batches (the same number under both names)
    lower_bound, relative_gap : what no choice of precisions undercuts, and (cost - lower_bound)/cost
    precisions : (K q m,) batch by batch, step by step
    active, active_sensors : how many measurements are used; their labels, of a single batch
    margin, relative_margin : the smallest of all batches, see BatchRecord
    total_precision : sum of the precisions, without prices
    least_active : at least this many measurements are needed
    batches : one BatchRecord each; None of a single batch
    rms_error : of the estimates against the simulated truth, over states and batches
    pruning : PruningRecord of a single batch
    route : the solver that gave the last answer
    """

    name: str
    smallest_factor: float
    preventing_direction: list[float] | None = field(default=None, metadata=_OPTIONAL)
    infeasible_batch: int | None = field(default=None, metadata=_OPTIONAL)
    objective: float | None = field(default=None, metadata=_OPTIONAL)
    cost: float | None = field(default=None, metadata=_OPTIONAL)
    lower_bound: float | None = field(default=None, metadata=_OPTIONAL)
    relative_gap: float | None = field(default=None, metadata=_OPTIONAL)
    precisions: list[float] | None = field(default=None, metadata=_OPTIONAL)
    active: int | None = field(default=None, metadata=_OPTIONAL)
    active_sensors: list[str] | None = field(default=None, metadata=_OPTIONAL)
    margin: float | None = field(default=None, metadata=_OPTIONAL)
    relative_margin: float | None = field(default=None, metadata=_OPTIONAL)
    total_precision: float | None = field(default=None, metadata=_OPTIONAL)
    least_active: int | None = field(default=None, metadata=_OPTIONAL)
    batches: Sequence[BatchRecord] | None = field(default=None, metadata=_OPTIONAL)
    rms_error: float | None = field(default=None, metadata=_OPTIONAL)
    pruning: PruningRecord | None = field(default=None, metadata=_OPTIONAL)
    route: str

    def as_dict(self) -> PlainDict:
        """The entries of result.json."""
        content = super().as_dict()
        return content if self.batches is None else content | {"batches": [record.as_dict() for record in self.batches]}

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The result that `content` describes."""
        batches = content.get("batches")
        records = None if batches is None else _records(BatchRecord, batches)
        return super().from_dict({**content, "batches": records, "pruning": _pruning(content)})


def _records(kind: type[ResultData], contents: Sequence[PlainMapping]) -> tuple[ResultData, ...]:
    return tuple(kind.from_dict(content) for content in contents)


def _pruning(content: PlainMapping) -> PruningRecord | None:
    stated = content.get("pruning")
    return PruningRecord.from_dict(stated) if isinstance(stated, Mapping) else None


def numbers_of(solution: Solution) -> PrecisionResult:
    """The numbers of a solution as their type; also where the run was read from a folder.

    Parameters
    ----------
    solution : Solution of this family
    """
    own = solution.numbers
    return own if isinstance(own, PrecisionResult) else PrecisionResult.from_dict(solution.result)
