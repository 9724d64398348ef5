"""The bound that knows looks are whole, for a problem of targets: from its arrays to prices and a lower bound."""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.targets.fill import Filled
from occontrol.scheduling.blocks.single import singles
from occontrol.scheduling.blocks.sweep import BlockSweep
from occontrol.scheduling.whole.bound import Effort, WholeLooks
from occontrol.scheduling.whole.certificate import Tangents
from occontrol.scheduling.whole.courses import courses


def tangents_at(filled: Filled, sweep: BlockSweep, weights: np.ndarray) -> Tangents:
    """The tangents of all targets at shares of looks.

    Parameters
    ----------
    filled : the problem
    sweep : over its blocks
    weights : (E, 1) shares
    """
    _, gradient = sweep.cost_and_gradient(weights)
    error, paid = filled.by_target(sweep, weights)
    g, looked = gradient[:, 0], filled.looks.target >= 0
    base = error + paid
    np.subtract.at(base, filled.looks.target[looked], (g * weights[:, 0])[looked])
    return Tangents(base, g)


def whole_looks(filled: Filled, sweep: BlockSweep, weights: np.ndarray, effort: Effort) -> WholeLooks:
    """All targets of a problem, to be asked at prices.

    Parameters
    ----------
    filled : the problem
    sweep : over its blocks
    weights : (E, 1) of the relaxed optimum
    effort : Effort
    """
    looks = filled.looks
    data = singles(filled.groups, filled.owners, filled.problem.targets, filled.steps, filled.charges)
    each = courses(data, looks.interval, looks.target, looks.price, filled.substeps)
    return WholeLooks(each, filled.allowed, tangents_at(filled, sweep, weights), effort)
