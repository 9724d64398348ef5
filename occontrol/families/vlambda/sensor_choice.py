"""The rules: which sensors to use in the epoch that begins now. Chooser, criterion and estimator are apart.

A chooser sees the plant, the epoch and the eigenfactors of P(k|k-1), whoever computed them, and returns a Choice.
Larger scores win; scores within 1e-10 of the best count as a tie, which goes to the lowest index.
Oshman (1994), section IV and remarks 1, 3, 4, 5.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from occontrol.families.vlambda.eigenfactor import EPS, Eigenfactors
from occontrol.families.vlambda.placement import place
from occontrol.families.vlambda.sampled_plant import SampledPlant

TIE = 1e-10
MOST_SUBSETS = 4096


@dataclass(frozen=True, eq=False)
class Epoch:
    """What a chooser is told.

    Parameters
    ----------
    plant : SampledPlant
    index : number of the epoch, from 0
    start, stop : its steps are k = start .. stop-1
    factors : Eigenfactors of P(start | start-1)
    select : how many sensors to choose
    """

    plant: SampledPlant
    index: int
    start: int
    stop: int
    factors: Eigenfactors
    select: int


@dataclass(frozen=True, eq=False)
class Choice:
    """What a chooser answers.

    Parameters
    ----------
    sensors : indices of the chosen sensors, ascending
    scores : (M,) of every sensor; what they mean is the chooser's, the larger the better
    locations : location (d,) of each chosen movable sensor, by index
    """

    sensors: tuple[int, ...]
    scores: np.ndarray
    locations: Mapping[int, np.ndarray] = field(default_factory=dict)


class Chooser(Protocol):
    """Anything that can answer for an epoch."""

    def choose(self, epoch: Epoch) -> Choice:
        """Choose `epoch.select` sensors.

        Parameters
        ----------
        epoch : Epoch
        """
        ...


def worst_eigenspace(factors: Eigenfactors, tolerance: float = 1e-9) -> np.ndarray:
    """Orthonormal basis (n, mu) of the eigenspace of the largest eigenvalue, its multiplicity mu included.

    E_max = sum_i v_i v_i'  is the projector onto it.

    Parameters
    ----------
    factors : Eigenfactors of P
    tolerance : eigenvalues within this of the largest, relative, count as equal to it

    Oshman (1994), equation (18).
    """
    values = factors.eigenvalues
    return factors.vectors[:, values >= values[0] * (1.0 - max(tolerance, 4 * EPS))]


def information_along(basis: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """rho = tr(E_max H'R^-1 H) = |R^{-1/2} H V_max|^2 for whitened rows (.., m, n): (..,).

    Oshman (1994), equations (15), (17), (19).

    `basis` V_max (n, k).
    """
    along = rows @ basis
    return np.einsum("...ij,...ij->...", along, along)


def trace_removed(factors: Eigenfactors, rows: np.ndarray) -> np.ndarray:
    """tr P(k|k-1) - tr P(k|k) for whitened rows (.., m, n): (..,).

    tr[S S'C' (I + C S S' C')^-1 C S S'],   P = S S'
    """
    root = factors.root
    seen = rows @ root
    inner = np.eye(rows.shape[-2]) + seen @ seen.swapaxes(-1, -2)
    carried = seen @ root.T
    return np.einsum("...ij,...ij->...", carried, np.linalg.solve(inner, carried))


def best_of(scores: np.ndarray, count: int) -> tuple[int, ...]:
    """Indices of the `count` largest scores (M,), ties to the lowest index, ascending."""
    scores = np.where(np.isnan(scores), -np.inf, scores)
    left, chosen = list(range(len(scores))), []
    for _ in range(count):
        top = max(scores[j] for j in left)
        slack = TIE * max(abs(top), float(np.max(np.abs(scores[np.isfinite(scores)]), initial=0.0)))
        j = next(j for j in left if scores[j] >= top - slack or scores[j] == top)
        left.remove(j)
        chosen.append(j)
    return tuple(sorted(chosen))


def placed(
    epoch: Epoch, merit: Callable[[np.ndarray], np.ndarray]
) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
    """Put every movable sensor where `merit` of its whitened rows (N, m, n) -> (N,) is largest.

    Returns locations by sensor index, and the whitened rows (m, n) of EVERY sensor at the epoch's first step.
    """
    locations, rows = {}, {}
    for j, sensor in enumerate(epoch.plant.sensors):
        region = sensor.sensor.location
        if region is None:
            rows[j] = sensor.whitened(epoch.start, epoch.start + 1)[0]
            continue
        locations[j], _ = place(
            region, epoch.start, lambda p, s=sensor: merit(s.whitened_at(epoch.start, p)), sensor.sensor.name
        )
        rows[j] = sensor.whitened_at(epoch.start, locations[j][None])[0]
    return locations, rows


def choice_of(sensors: tuple[int, ...], scores: np.ndarray, locations: Mapping[int, np.ndarray]) -> Choice:
    """The Choice of `sensors`, with `scores` (M,) of all and the `locations` of those of them that can move.

    `locations` maps a position to (d,).
    """
    return Choice(sensors, scores, {j: locations[j] for j in sensors if j in locations})


@dataclass(frozen=True)
class EigenspaceChooser:
    """The paper's rule: most information along the worst eigenspace; scores are rho_j, equation (19).

    Information adds up over sensors, so the best M' sensors are the M' largest rho_j (remark 3).
    """

    tolerance: float = 1e-9

    def choose(self, epoch: Epoch) -> Choice:
        """Choose the sensors with the largest rho.

        Parameters
        ----------
        epoch : Epoch
        """
        scores, locations = self.scores(epoch)
        return choice_of(best_of(scores, epoch.select), scores, locations)

    def scores(self, epoch: Epoch) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """rho of every sensor (M,), movable ones at their best location, and those locations."""
        basis = worst_eigenspace(epoch.factors, self.tolerance)
        locations, rows = placed(epoch, lambda c: information_along(basis, c))
        return np.array([float(information_along(basis, rows[j])) for j in range(len(rows))]), locations


@dataclass(frozen=True)
class TraceChooser:
    """Least trace of P(k|k) right after the choice; scores are the trace that each sensor alone would remove.

    Movable sensors go where they alone remove most. With several places every subset is tried, up to MOST_SUBSETS of
    them, beyond which sensors are added one at a time.
    """

    def choose(self, epoch: Epoch) -> Choice:
        """Choose the sensors that together leave the smallest trace.

        Parameters
        ----------
        epoch : Epoch
        """
        factors, count = epoch.factors, len(epoch.plant.sensors)
        locations, rows = placed(epoch, lambda c: trace_removed(factors, c))
        scores = np.array([float(trace_removed(factors, rows[j])) for j in range(count)])
        if epoch.select == 1:
            return choice_of(best_of(scores, 1), scores, locations)

        def together(group: tuple[int, ...]) -> float:
            return float(trace_removed(factors, np.concatenate([rows[j] for j in group])))

        groups = subsets(count, epoch.select)
        if groups is not None:
            index = best_of(np.array([together(g) for g in groups]), 1)[0]
            return choice_of(groups[index], scores, locations)
        chosen: tuple[int, ...] = ()
        for _ in range(epoch.select):
            options = [j for j in range(count) if j not in chosen]
            chosen += (options[best_of(np.array([together((*chosen, j)) for j in options]), 1)[0]],)
        return choice_of(tuple(sorted(chosen)), scores, locations)


def subsets(count: int, select: int, most: int = MOST_SUBSETS) -> list[tuple[int, ...]] | None:
    """All groups of `select` out of `count` sensors in lexicographic order; None if there are more than `most`."""
    from math import comb

    return list(itertools.combinations(range(count), select)) if comb(count, select) <= most else None
