"""The relaxation of a criterion with corners, by smoothing it less and less; cost and bound are of the true criterion.

The largest eigenvalue has a corner wherever it is double, and that is where optima are. So mu falls, in shares of the
criterion's value at the policy reached, and each stage starts from the last. At a policy v with Z = dvalue/dX,

    J_true(w) >= J(v) - smoothing_error(v) + dJ/dv.(w - v)      for every policy w,

because tr(Z X(w)) is convex in w, is value - smoothing_error at v, and is nowhere above the true criterion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Certificate, Status
from occontrol.scheduling.criteria import LargestEigenvalue
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed
from occontrol.scheduling.sweep import Sweep

SHARES = (0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)  # of the criterion's value, one mu a stage


def minimise_smoothed(
    recursion: Recursion,
    criterion: LargestEigenvalue,
    feasible_set: FeasibleSet,
    start: np.ndarray | None = None,
    options: RelaxedOptions | None = None,
    monitor: Monitor | None = None,
) -> RelaxedOutcome:
    """Minimise J with the true criterion, mu = 0, over the relaxed policies of a feasible set.

    Parameters
    ----------
    recursion : Recursion
    criterion : LargestEigenvalue, of which the output counts and the mu does not
    feasible_set : FeasibleSet of the policies
    start : (N, M) a policy of the set, or None for equal shares
    options : RelaxedOptions; `max_iterations` are those of all stages together
    monitor : Monitor

    Returns RelaxedOutcome with J, bound and a subgradient of the true criterion; `certified` exactly when they prove
    the target gap, `limit` where mu became too small to help.
    """
    options, monitor = options or RelaxedOptions(), monitor or Monitor()
    true = Sweep(recursion, criterion=criterion.smoothed(0.0))
    best = feasible_set.uniform() if start is None else start
    J, g = true.cost_and_gradient(best)
    bound, v = feasible_set.bound(J, best, g), best
    iterations, status, spent = 0, Status.LIMIT, {"gradients": 1, "costs": 0}
    for share in SHARES:
        target = options.relative_gap * abs(J) if options.absolute_gap is None else options.absolute_gap
        if J - bound <= target or monitor.stop or iterations >= options.max_iterations:
            break
        true.cost(v)
        mu = share * true.criterion_value
        if not mu > 0:
            break  # nothing is uncertain: no corner to smooth
        sweep = Sweep(recursion, criterion=criterion.smoothed(mu))
        # a stage need not be more exact than its smoothing, nor than what is asked for in the end
        stage = replace(
            options, absolute_gap=max(0.25 * target, 0.1 * mu), max_iterations=options.max_iterations - iterations
        )
        found = minimise_relaxed(sweep, feasible_set, v, stage, monitor)
        v = found.weights
        smooth, slope = sweep.cost_and_gradient(v)
        bound = max(bound, feasible_set.bound(smooth - sweep.smoothing_error, v, slope))
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
    return RelaxedOutcome(best, J, certificate.lower_bound, g, iterations, status, spent)
