"""What the runs of one method say, as data: the numbers of result.json."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.core.result import ResultData
from occontrol.core.solution import Solution

_OPTIONAL = {"optional": True}


@dataclass(frozen=True)
class Candidate(ResultData):
    """A group that was tried all the time, beside the best of them.

    Parameters
    ----------
    sensor : names of the group, joined by '+'
    average_rms, mode_errors, .._standard_error : see HybridResult
    """

    sensor: str
    average_rms: float
    average_rms_standard_error: float
    mode_errors: float
    mode_errors_standard_error: float


@dataclass(frozen=True)
class HybridResult(ResultData):
    """The numbers of many runs; each standard error is NaN (null in a file) after a single run.

    Parameters
    ----------
    average_rms, peak_rms : mean and largest over the steps of the RMS position error over the runs
    mode_errors : steps with the wrong mode, mean over the runs
    average_nees : mean of e' P^-1 e; equals `states` where the estimator's covariance is honest
    average_rms_standard_error, peak_rms_standard_error, mode_errors_standard_error, average_nees_standard_error : of
        the numbers before them
    use, group_use : share of the steps of all runs, by sensor and by group
    runs : that were done
    states : of the plant
    first_scores : the criterion of every group at k = 1, which does not depend on chance
    schedule : segments of the first run
    sensor : the group of the method `fixed`
    guard_excess, guard_error : largest |sum - 1| of guard probabilities before they were divided, largest error
        estimate of one; only with guards
    candidates : all groups that `fixed` tried
    """

    average_rms: float
    average_rms_standard_error: float
    peak_rms: float
    peak_rms_standard_error: float
    mode_errors: float
    mode_errors_standard_error: float
    average_nees: float
    average_nees_standard_error: float
    use: dict[str, float]
    group_use: dict[str, float]
    runs: int
    states: int
    first_scores: dict[str, float]
    schedule: list[PlainDict]
    sensor: str | None = field(default=None, metadata=_OPTIONAL)
    guard_excess: float | None = field(default=None, metadata=_OPTIONAL)
    guard_error: float | None = field(default=None, metadata=_OPTIONAL)
    candidates: list[Candidate] | None = field(default=None, metadata=_OPTIONAL)

    def as_dict(self) -> PlainDict:
        """The family's part of result.json."""
        content = super().as_dict()
        return content | ({"candidates": [c.as_dict() for c in self.candidates]} if self.candidates else {})

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The result that `content`, the family's part of a result.json, describes."""
        tried = content.get("candidates")
        given = None if tried is None else [Candidate.from_dict(candidate) for candidate in tried]
        return super().from_dict({**content, "candidates": given})

    @property
    def as_candidate(self) -> Candidate:
        """These numbers as one of several groups that are compared."""
        return Candidate(
            self.sensor or "",
            self.average_rms,
            self.average_rms_standard_error,
            self.mode_errors,
            self.mode_errors_standard_error,
        )


def numbers_of(solution: Solution) -> HybridResult:
    """The numbers of a Solution of this family, also of one that was read from a run folder."""
    known = solution.numbers
    return known if isinstance(known, HybridResult) else HybridResult.from_dict(solution.result)
