"""The relaxed problem of many targets: the multiplicative step and quasi-Newton side by side, the better bound kept.

Every gradient proves J* >= J(v) - sum_s [v.g - min_w w.g]; the best of all bounds is kept, whichever method met it.
The multiplicative step v <- min(1, tau v (-g)) needs no memory but v and g and no line search. Its cost falls from step
to step in practice, which nobody has proven for capped simplices, so the best policy is kept, too. It wants g <= 0:
where looks have a price the quasi-Newton method works alone. Measurements: docs/bench.md.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Certificate, Status
from occontrol.scheduling.blocks.resources import ResourceSet
from occontrol.scheduling.blocks.sweep import BlockSweep
from occontrol.scheduling.quasi_newton import FaceBFGS
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed

PATIENCE = 40  # multiplicative steps in which the gap must halve: slower is the turn of quasi-Newton
WORTH = 0.5
LARGEST = 1_000_000  # weights up to which pairs and cuts of a quasi-Newton method fit in memory; beyond, steps alone
PAIR_BYTES = 240_000_000
INSIDE = 1e-3  # share of equal use that lets weights of 0 grow again


def relax(
    sweep: BlockSweep,
    allowed: ResourceSet,
    relative_gap: float,
    max_iterations: int,
    monitor: Monitor,
    start: np.ndarray | None = None,
) -> RelaxedOutcome:
    """Minimise J over shares of looks to a certified gap.

    Parameters
    ----------
    sweep : BlockSweep
    allowed : ResourceSet of its policies
    relative_gap : target of (J - bound)/|J|
    max_iterations : steps of each method
    monitor : Monitor
    start : (E, 1) a policy of the set, or None for equal shares

    Returns RelaxedOutcome; status is `certified` exactly when the bound proves the target gap.
    """
    before = sweep.backward_count, sweep.forward_count
    state = _Multiplicative(sweep, allowed, monitor, relative_gap)
    v = allowed.uniform() if start is None else start
    status, iterations, stalled = state.run(v, max_iterations)
    for _ in range(2):
        if status is not None or not state.small:
            break
        pairs = max(5, min(60, PAIR_BYTES // (16 * allowed.shape[0])))
        options = RelaxedOptions(relative_gap, max_iterations)
        found = minimise_relaxed(sweep, allowed, state.best, options, monitor, FaceBFGS(allowed.shape[0], pairs))
        iterations += found.iterations
        state.take(found.cost, found.lower_bound, found.weights, found.gradient)
        stalled = found.stalled
        if found.status is not Status.LIMIT or state.gap <= relative_gap * abs(state.cost):
            status = found.status if state.gap > relative_gap * abs(state.cost) else Status.CERTIFIED
            break
        mixed = (1 - INSIDE) * state.best + INSIDE * allowed.uniform()
        status, more, _ = state.run(mixed, max_iterations)
        iterations += more
    after = sweep.backward_count, sweep.forward_count
    spent = {name: b - a for name, a, b in zip(("gradients", "costs"), before, after, strict=True)}
    certificate = Certificate(state.cost, state.bound)
    if certificate.contradicts:
        status = Status.DISAGREES
    return RelaxedOutcome(
        state.best, state.cost, certificate.lower_bound, state.gradient, iterations, status or Status.LIMIT, spent,
        stalled,
    )  # fmt: skip


class _Multiplicative:
    """The best policy and the best bound so far, and the step that finds better ones."""

    def __init__(self, sweep: BlockSweep, allowed: ResourceSet, monitor: Monitor, relative_gap: float):
        self.sweep, self.allowed, self.monitor, self.relative_gap = sweep, allowed, monitor, relative_gap
        self.cost, self.bound, self.iteration = np.inf, -np.inf, 0
        self.small = allowed.shape[0] <= LARGEST
        self.best = self.gradient = np.empty((0, 1))

    @property
    def gap(self) -> float:
        return self.cost - self.bound

    def take(self, cost: float, bound: float, weights: np.ndarray, gradient: np.ndarray) -> None:
        """Keep what is better."""
        self.bound = max(self.bound, bound)
        if cost < self.cost:
            self.cost, self.best, self.gradient = cost, weights, gradient

    def run(self, v: np.ndarray, most: int) -> tuple[Status | None, int, bool]:
        """Steps from v until the gap is met, time is up, or quasi-Newton should try; status None in the last case."""
        checked, last = 0, np.inf
        for step in range(most + 1):
            J, g = self.sweep.cost_and_gradient(v)
            self.take(J, self.allowed.bound(J, v, g), v, g)
            self.monitor.report(self.iteration, self.cost, self.bound)
            if self.gap <= self.relative_gap * abs(self.cost):
                return Status.CERTIFIED, step, False
            if self.monitor.interrupted:
                return Status.INTERRUPTED, step, False
            if self.monitor.timed_out:
                return Status.LIMIT, step, False
            if step - checked >= PATIENCE:
                if self.gap > WORTH * last and self.small:
                    return None, step, True
                checked, last = step, self.gap
            if step == 0:
                last = self.gap
            if np.any(g > 0.0):
                return None, step, True
            v = self.allowed.scaled(v, g)
            self.iteration += 1
        return None, most, True
