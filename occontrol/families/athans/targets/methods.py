"""The methods for many targets: those of the family that fit, and rules of thumb that only targets have.

`policy` of a baseline gets a `Task` (solve.py): blocks, looks, and the relaxation whose bound stands beside the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from occontrol.core.errors import Mistake
from occontrol.core.method import check_options
from occontrol.families.athans.baselines import Greedy, Random, RoundRobin
from occontrol.families.athans.methods import Relaxed, RelaxRoundPolish

if TYPE_CHECKING:
    from occontrol.families.athans.targets.problem import TargetsProblem


class TargetBaseline:
    """A rule of thumb for looks, beside the bound of a relaxation."""

    name: ClassVar[str]
    relative_gap: float

    def __post_init__(self) -> None:
        check_options(self, positive=["relative_gap"])

    def check(self, problem: TargetsProblem) -> Sequence[Mistake]:
        """Nothing: it fits every problem of targets."""
        return ()


@dataclass(frozen=True)
class LargestTrace(TargetBaseline):
    """Baseline: always the targets whose weighted covariance is largest.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    """

    name: ClassVar[str] = "largest-trace"
    relative_gap: float = 1e-4


@dataclass(frozen=True)
class Information(TargetBaseline):
    """Baseline: always the looks that tell most, the largest fall of ln det Sigma.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    """

    name: ClassVar[str] = "information"
    relative_gap: float = 1e-4


@dataclass(frozen=True)
class CostateIndex(TargetBaseline):
    """Baseline: always the looks that the costate of the relaxed optimum values most.

    Parameters
    ----------
    relative_gap : target of the relaxation
    """

    name: ClassVar[str] = "costate-index"
    relative_gap: float = 1e-4


METHODS: dict[str, type] = {
    m.name: m for m in (RelaxRoundPolish, Relaxed, CostateIndex, Greedy, Information, LargestTrace, RoundRobin, Random)
}
