"""Span elements of one set of spans for many weights: a time-varying plant is sampled and cut into steps once.

The steps are those that the sum of all sensors needs, the fastest flow of all; every other mixture is smoother. Only
the Hamiltonian matrices, affine in the weights, are put together anew.
"""

from __future__ import annotations

import numpy as np

from occontrol.families.robust.scattering import INNER, Element, Flow, in_user_units, magnus_step
from occontrol.families.robust.star_product import from_transfer

AFFORDABLE = 500  # steps of a walk that cost little


class PreparedSpans:
    """Spans that are walked many times.

    Parameters
    ----------
    flow : Flow
    starts, ends : (T,)
    """

    def __init__(self, flow: Flow, starts: np.ndarray, ends: np.ndarray):
        self.flow, self.starts, self.ends = flow, np.asarray(starts, dtype=float), np.asarray(ends, dtype=float)
        if flow.constant:
            return
        sensors = len(flow.rows)
        every = np.ones((len(starts), sensors))
        self.scale = flow.scales(self.starts, self.ends, every)
        _, at, length, self.owner = flow.partition(self.starts, self.ends, every, self.scale)
        times = (at[:, None] + length[:, None] * INNER).ravel()
        shape = (len(at), 3, 2 * flow.n, 2 * flow.n)
        h = length[:, None, None, None]
        none, scale = np.zeros((len(times), sensors)), np.repeat(self.scale[self.owner], 3, axis=0)
        self.free = flow.exponents(times, none, scale)[0].reshape(shape) * h
        self.each = []
        for j in range(sensors):
            one = none.copy()
            one[:, j] = 1.0
            self.each.append(flow.exponents(times, one, scale)[0].reshape(shape) * h - self.free)

    def affordable(self, steps: int) -> int:
        """How many of `steps` walks to spend: all for constant plants, fewer where a walk has thousands of steps."""
        return steps if self.flow.constant else max(5, min(steps, steps * AFFORDABLE // len(self.owner)))

    def elements(self, weights: np.ndarray, first: int = 0) -> Element:
        """Elements of the spans from `first` on, (T - first, ...).

        Parameters
        ----------
        weights : (T - first, M), may be complex
        first : the first span that is wanted
        """
        if self.flow.constant:
            return self.flow.elements(self.starts[first:], self.ends[first:], weights)
        used = self.owner >= first
        owner = self.owner[used] - first
        H = self.free[used].astype(weights.dtype)
        for j, part in enumerate(self.each):
            H = H + weights[owner, j][:, None, None, None] * part[used]
        return in_user_units(
            self.flow.reduce(from_transfer(magnus_step(H)), owner, len(weights), None), self.scale[first:]
        )
