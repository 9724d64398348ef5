"""Weights of a recursion with rules: what is on, what measures, and columns for sensors that warm up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.rules.rules import Rules


def with_warming(recursion: Recursion, warmers: np.ndarray) -> Recursion:
    """The recursion with further columns for sensors that are on and measure nothing yet.

    Parameters
    ----------
    recursion : Recursion with M sensors
    warmers : (W,) of which sensors
    """
    if not len(warmers):
        return recursion
    return replace(
        recursion,
        offsets=np.concatenate([recursion.offsets, np.repeat(recursion.offsets[-1:], len(warmers))]),
        cost=np.ascontiguousarray(np.concatenate([recursion.cost, recursion.cost[:, warmers]], axis=1)),
        available=np.concatenate([recursion.available, recursion.available[:, warmers]], axis=1),
    )


def user_weights(on: np.ndarray, rules: Rules) -> np.ndarray:
    """(N, M) weights as they stand in a schedule, for what is on (N, M); above select 1 idle fills the rest."""
    weights = on.astype(float)
    if rules.select > 1 and np.any(rules.idle):
        weights[:, int(np.flatnonzero(rules.idle)[0])] = rules.select - np.sum(on, axis=1)
    return weights


def on_of(weights: np.ndarray, rules: Rules) -> np.ndarray:
    """(N, M) what is on in integral weights (N, M); 'idle' counts where select is 1."""
    on = weights > 0.5
    if rules.select > 1:
        on[:, rules.idle] = False
    return on
