"""Iterated local search on top of the polish: neighbouring intervals change places, and the exchanges begin again.

A policy that no single exchange improves may still have its switches at the wrong places along a singular arc, where
moving one takes two exchanges (Lourenco, Martin and Stutzle 2003 on the method in general).
"""

from __future__ import annotations

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.hminimal import SweepOutcome, polish
from occontrol.scheduling.sweep import Sweep

SHARE = 0.02
PATIENCE = 8


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
    monitor, rng = monitor or Monitor(), np.random.default_rng(seed)
    spent, fruitless = sweep.backward_count + sweeps, 0
    while best.cost > good_enough and fruitless < PATIENCE and sweep.backward_count < spent and not monitor.stop:
        v = best.weights.copy()
        places = np.flatnonzero(feasible_set.swap_mask(v) & np.any(v[1:] != v[:-1], axis=1))
        if not len(places):
            break
        chosen = places[rng.random(len(places)) < max(SHARE, 1.0 / len(places))]
        for k in chosen:
            v[[k, k + 1]] = v[[k + 1, k]]
        found = polish(sweep, feasible_set, v, max_rounds, monitor)
        fruitless += 1
        if found.cost < best.cost:
            best, fruitless = found, 0
    return best
