"""Iterated local search on top of the polish: the schedule is disturbed, and the exchanges begin again.

Along singular arcs neighbouring intervals change places; where readings are whole, a few random exchanges are made.

A policy that no single exchange improves may still have its switches at the wrong places along a singular arc, where
moving one takes two exchanges (Lourenco, Martin and Stutzle 2003 on the method in general).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.hminimal import SweepOutcome, polish
from occontrol.scheduling.sweep import Sweep

SHARE = 0.02
PATIENCE = 8
KICKS = 6  # random exchanges that disturb a schedule of readings
LONG_PATIENCE = 20  # fruitless rounds of kicks that end them


def shake(
    sweep: Sweep,
    feasible_set: FeasibleSet,
    best: SweepOutcome,
    good_enough: float,
    sweeps: int,
    max_rounds: int = 200,
    monitor: Monitor | None = None,
    seed: int = 0,
) -> SweepOutcome:
    """The best policy found by swapping some neighbours and polishing again, from a polished policy.

    Parameters
    ----------
    sweep : Sweep that `foresees_exchanges`, without a running weight
    feasible_set : FeasibleSet of the policies
    best : SweepOutcome of `polish`
    good_enough : cost at which to stop
    sweeps : backward sweeps that may be spent; PATIENCE fruitless shakes in a row also end it
    max_rounds : of every polish
    monitor : Monitor
    seed : of the choice of intervals; the same seed gives the same policy

    Returns SweepOutcome, never worse than `best`.
    """
    rng, spent = np.random.default_rng(seed), sweep.backward_count + sweeps

    def disturbed(v: np.ndarray) -> np.ndarray | None:
        places = np.flatnonzero(feasible_set.swap_mask(v) & np.any(v[1:] != v[:-1], axis=1))
        if not len(places):
            return None
        for k in places[rng.random(len(places)) < max(SHARE, 1.0 / len(places))]:
            v[[k, k + 1]] = v[[k + 1, k]]
        return v

    def left() -> bool:
        return sweep.backward_count < spent

    return _repeated(sweep, feasible_set, best, good_enough, PATIENCE, max_rounds, monitor, disturbed, left)


def kick(
    sweep: Sweep,
    feasible_set: FeasibleSet,
    best: SweepOutcome,
    good_enough: float,
    sweeps: int,
    max_rounds: int = 200,
    monitor: Monitor | None = None,
    seed: int = 0,
) -> SweepOutcome:
    """The best policy found by KICKS random exchanges and polishing again, from a polished policy.

    Parameters
    ----------
    sweep : Sweep
    feasible_set : FeasibleSet of the policies
    best : SweepOutcome of `polish`
    good_enough : cost at which to stop
    sweeps : forward sweeps that may be spent; LONG_PATIENCE fruitless rounds also end it
    max_rounds : of every polish
    monitor : Monitor
    seed : of the exchanges; the same seed gives the same policy

    Returns SweepOutcome, never worse than `best`.
    """
    rng, spent = np.random.default_rng(seed), sweep.forward_count + sweeps

    def disturbed(v: np.ndarray) -> np.ndarray | None:
        for _ in range(KICKS):
            leaves, enters = feasible_set.exchange_masks(v)
            places = np.flatnonzero(np.any(leaves, axis=1) & np.any(enters, axis=1))
            if not len(places):
                return None
            k = rng.choice(places)
            v[k, rng.choice(np.flatnonzero(leaves[k]))] -= 1.0
            v[k, rng.choice(np.flatnonzero(enters[k]))] += 1.0
        return v

    def left() -> bool:
        return sweep.forward_count < spent

    return _repeated(sweep, feasible_set, best, good_enough, LONG_PATIENCE, max_rounds, monitor, disturbed, left)


def _repeated(
    sweep: Sweep,
    feasible_set: FeasibleSet,
    best: SweepOutcome,
    good_enough: float,
    patience: int,
    max_rounds: int,
    monitor: Monitor | None,
    disturbed: Callable[[np.ndarray], np.ndarray | None],
    left: Callable[[], bool],
) -> SweepOutcome:
    """Disturb the best policy and polish it again, until `patience` rounds in a row gain nothing or nothing is left."""
    monitor, fruitless = monitor or Monitor(), 0
    while best.cost > good_enough and fruitless < patience and left() and not monitor.stop:
        v = disturbed(best.weights.copy())
        if v is None:
            break
        found = polish(sweep, feasible_set, v, max_rounds, monitor)
        fruitless += 1
        if found.cost < best.cost:
            best, fruitless = found, 0
    return best
