"""Targets of one model as arrays: plants, weights, and the looks that resources may take at them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from occontrol.core.signal import ConstantSignal, Signal
from occontrol.numerics.linalg import whiten


@dataclass(frozen=True, eq=False)
class LookSet:
    """The looks of one resource at the targets of one group.

    Parameters
    ----------
    resource : number of the resource
    C : (S, r, n) distinct measurement matrices
    noise : (S, r, r) intensities Theta, positive definite, in measurement units squared times time
    cost : (S,) rates q
    target : (U,) of the group, for every look that may be taken
    interval : (U,) when
    which : (U,) which of the S it is
    """

    resource: int
    C: np.ndarray
    noise: np.ndarray
    cost: np.ndarray
    target: np.ndarray
    interval: np.ndarray
    which: np.ndarray

    @cached_property
    def rows(self) -> np.ndarray:
        """(S, r, n) scaled rows Theta^{-1/2} C."""
        (scaled,) = whiten(self.noise, self.C)
        return np.ascontiguousarray(scaled)


@dataclass(frozen=True, eq=False)
class TargetGroup:
    """G targets of one model, n states each.

    Parameters
    ----------
    model : its name
    names : of the targets
    A, noise : (G, n, n) rates and intensities Xi, or Signals of them that all targets share
    mean : (G, n) at the start
    covariance : (G, n, n) at the start
    weight : (G,) what a target counts
    running : (G, n, n) R, without the weight
    terminal : (G, n, n) D'D, without the weight
    looks : LookSet of every resource that sees one of them
    """

    model: str
    names: tuple[str, ...]
    A: np.ndarray | Signal
    noise: np.ndarray | Signal
    mean: np.ndarray
    covariance: np.ndarray
    weight: np.ndarray
    running: np.ndarray
    terminal: np.ndarray
    looks: tuple[LookSet, ...] = field(repr=False)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def states(self) -> int:
        """n"""
        return self.covariance.shape[1]

    def plant_of(self, i: int) -> tuple[Signal, Signal]:
        """A and Xi of target i as Signals."""
        A, noise = self.A, self.noise
        return (
            A if isinstance(A, Signal) else ConstantSignal(A[i]),
            noise if isinstance(noise, Signal) else ConstantSignal(noise[i]),
        )

    def flows(self, edges: np.ndarray, origin: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F and Q over stretches of time, for every target.

        Parameters
        ----------
        edges : (K+1,) ends of the stretches, counted from `origin`
        origin : of time

        Returns F and Q, (G or 1, U, n, n) of the U distinct stretches, and which (K,) of them each stretch is.
        """
        from occontrol.numerics.short_flow import short_flow
        from occontrol.numerics.transition import transitions, unique_spans

        if isinstance(self.A, Signal) or isinstance(self.noise, Signal):
            A, noise = self.plant_of(0)
            if not (A.constant and noise.constant):
                F, Q = transitions(A, noise, edges[:-1], edges[1:], origin)
                return F[None], Q[None], np.arange(len(edges) - 1)
            a, x = A.at(0.0)[None], noise.at(0.0)[None]
        else:
            a, x = self.A, self.noise
        spans, which = unique_spans(np.diff(edges))
        G, n, U = len(a), a.shape[1], len(spans)
        a = (a[:, None] * spans[:, None, None]).reshape(G * U, n, n)
        x = (x[:, None] * spans[:, None, None]).reshape(G * U, n, n)
        F, Q = short_flow(a, x)
        return F.reshape(G, U, n, n), Q.reshape(G, U, n, n), which

    @property
    def coupling(self) -> np.ndarray:
        """(n, n) which states of some target are coupled directly."""
        pattern = np.any(self.covariance != 0, axis=0)
        for part in (self.A, self.noise):
            if isinstance(part, Signal):
                probe = np.linspace(0.0, 1.0, 1) if part.constant else None
                pattern = pattern | (
                    np.ones_like(pattern) if probe is None else np.any(part.sample(probe) != 0, axis=0)
                )
            else:
                pattern = pattern | np.any(part != 0, axis=0)
        for looks in self.looks:
            rows = looks.rows
            information = np.swapaxes(rows, 1, 2) @ rows
            size = np.sqrt(np.einsum("sii->si", information))
            pattern = pattern | np.any(np.abs(information) > 1e-14 * size[:, :, None] * size[:, None, :], axis=0)
        return pattern | pattern.T


def merged_names(groups: Sequence[TargetGroup]) -> list[str]:
    """The names of all targets, in order."""
    return [name for group in groups for name in group.names]
