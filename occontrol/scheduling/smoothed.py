"""The relaxation of a criterion with corners, by smoothing it less and less; cost and bound are of the true criterion.

The largest eigenvalue has a corner wherever it is double, a peak wherever two variances are alike, and that is where
optima are. So mu falls, in shares of the criterion's value at the policy reached, and each stage starts from the last.
At a policy v with Z = dvalue/dX,

    J_true(w) >= J(v) - smoothing_error(v) + dJ/dv.(w - v)      for every policy w,

because tr(Z X(w)) is convex in w, is value - smoothing_error at v, and is nowhere above the true criterion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Certificate, Status
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.objective import Objective
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed

SHARES = (0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)  # of the criterion's value, one mu a stage


class Cornered(Objective, Protocol):
    """An objective with corners.

    Attributes
    ----------
    criterion_value, smoothing_error : of the last cost
    """

    @property
    def criterion_value(self) -> float: ...

    @property
    def smoothing_error(self) -> float: ...

    def with_smoothing(self, smoothing: float) -> Self:
        """The same with another mu, `smoothing`; 0 is the true criterion."""
        ...


@dataclass
class SmoothedOutcome(RelaxedOutcome):
    """A relaxation by smoothing.

    Parameters
    ----------
    bounding : (N, M) the policy whose tangent proves the bound, and the mu there
    """

    bounding: tuple[np.ndarray, float] | None = None


Inner = Callable[[Objective, np.ndarray, RelaxedOptions, Monitor], RelaxedOutcome]


def minimise_smoothed(
    objective: Cornered,
    feasible_set: FeasibleSet,
    start: np.ndarray | None = None,
    options: RelaxedOptions | None = None,
    monitor: Monitor | None = None,
    inner: Inner | None = None,
) -> SmoothedOutcome:
    """Minimise J with the true criterion, mu = 0, over the relaxed policies of a feasible set.

    Parameters
    ----------
    objective : Cornered, whose own mu does not count
    feasible_set : FeasibleSet of the policies
    start : (N, M) a policy of the set, or None for equal shares
    options : RelaxedOptions; `max_iterations` are those of all stages together
    monitor : Monitor
    inner : minimises one stage from a policy; `minimise_relaxed` if None

    Returns SmoothedOutcome with J, bound and a subgradient of the true criterion; `certified` exactly when they prove
    the target gap, `limit` where mu became too small to help.
    """
    options, monitor = options or RelaxedOptions(), monitor or Monitor()

    def usual(stage: Objective, at: np.ndarray, limits: RelaxedOptions, watch: Monitor) -> RelaxedOutcome:
        return minimise_relaxed(stage, feasible_set, at, limits, watch)

    inner = inner or usual
    true = objective.with_smoothing(0.0)
    best = feasible_set.uniform() if start is None else start
    J, g = true.cost_and_gradient(best)
    bound, v, bounding = feasible_set.bound(J, best, g), best, (best, 0.0)
    iterations, status, spent = 0, Status.LIMIT, {"gradients": 1, "costs": 0}
    for share in SHARES:
        target = options.relative_gap * abs(J) if options.absolute_gap is None else options.absolute_gap
        if J - bound <= target or monitor.stop or iterations >= options.max_iterations:
            break
        true.cost(v)
        mu = share * true.criterion_value
        if not mu > 0:
            break  # nothing is uncertain: no corner to smooth
        sweep = objective.with_smoothing(mu)
        # a stage need not be more exact than its smoothing, nor than what is asked for in the end
        stage = replace(
            options, absolute_gap=max(0.25 * target, 0.1 * mu), max_iterations=options.max_iterations - iterations
        )
        found = inner(sweep, v, stage, monitor)
        v = found.weights
        smooth, slope = sweep.cost_and_gradient(v)
        own = feasible_set.bound(smooth - sweep.smoothing_error, v, slope)
        if own > bound:
            bound, bounding = own, (v, mu)
        J_new = true.cost(v)
        if J_new < J:
            best, J = v, J_new
        iterations += found.iterations
        spent["gradients"] += sweep.backward_count
        spent["costs"] += sweep.forward_count - sweep.backward_count + 2
        monitor.report(iterations, J, bound, stage="smoothing")
    target = options.relative_gap * abs(J) if options.absolute_gap is None else options.absolute_gap
    if J - bound <= target:
        status = Status.CERTIFIED
    elif monitor.interrupted:
        status = Status.INTERRUPTED
    _, g = true.cost_and_gradient(best)
    certificate = Certificate(J, bound)
    if certificate.contradicts:
        status = Status.DISAGREES
    return SmoothedOutcome(best, J, certificate.lower_bound, g, iterations, status, spent, False, bounding)
