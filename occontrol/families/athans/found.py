"""What a method of the athans family hands over for judgement, and the relaxation that stands beside every one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status

if TYPE_CHECKING:
    from occontrol.scheduling.feasible_set import FeasibleSet
    from occontrol.scheduling.relaxation import RelaxedOutcome
    from occontrol.scheduling.sweep import Sweep

STEPS_FOR_BOUND = 500  # steps of a relaxation that only bounds another method's policy
_STALLED = (
    "No step lowers the relaxed cost any more, though the gap is still open: the data span more orders of magnitude "
    "than double precision resolves, for instance where an unstable plant may go unmeasured for long. Shorten the "
    "horizon or demand a measurement where the covariance explodes."
)
_SPOILT = (
    "The bound of the relaxation lies above its cost by more than rounding may do: the data span more orders of "
    "magnitude than double precision resolves. Shorten the intervals, or use other units."
)


@dataclass
class Found:
    """What a method hands over for judgement.

    Parameters
    ----------
    weights : (N, M) policy
    iterations : of the method
    status : how it ended
    message : in words, empty where the status says it all
    relaxed : the relaxation whose bound stands beside the policy, if one was run
    bound : a lower bound that the method proved by itself
    proves : whether reaching the relaxation's target is what this method promises
    target : the relative gap that counts as certified otherwise
    extra : further entries of result.json
    bounds : lower bounds by name, where there are several
    """

    weights: np.ndarray
    iterations: int
    status: Status
    message: str = ""
    relaxed: RelaxedOutcome | None = None
    bound: float = -np.inf
    proves: bool = False
    target: float = 1e-4
    extra: PlainDict = field(default_factory=dict)
    bounds: PlainDict | None = None


def relax(
    sweep: Sweep,
    feasible_set: FeasibleSet,
    monitor: Monitor,
    relative_gap: float,
    max_iterations: int = STEPS_FOR_BOUND,
) -> Found:
    """The relaxed policy, from which a method takes what it needs.

    Parameters
    ----------
    sweep : of the problem; one that holds the relaxation already hands it over
    feasible_set : of the problem
    monitor : Monitor of the method
    relative_gap, max_iterations : of the relaxation
    """
    from occontrol.families.athans.integration.priced import relaxation_of
    from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed

    monitor.stage = "relaxation"
    relaxed = relaxation_of(sweep)
    if relaxed is None:
        relaxed = minimise_relaxed(sweep, feasible_set, None, RelaxedOptions(relative_gap, max_iterations), monitor)
    message = _STALLED if relaxed.stalled else ""
    if relaxed.status is Status.DISAGREES:
        message = _SPOILT
    return Found(relaxed.weights, relaxed.iterations, relaxed.status, message, relaxed, target=relative_gap)
