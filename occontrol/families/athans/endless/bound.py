"""Lower bounds for many targets for ever: prices, and at them three bounds of what each target costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from occontrol.core.errors import InfeasibleError
from occontrol.core.monitor import Monitor
from occontrol.families.athans.endless.problem import EndlessTargetsProblem
from occontrol.families.athans.periodic.fill import Filled, Parts, fill, parts_of
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.scheduling.periodic.averaged import averaged_flow
from occontrol.scheduling.periodic.letters import Letters
from occontrol.scheduling.periodic.potential import cycle_of, potentials
from occontrol.scheduling.periodic.prices import GapTable, Priced, best_prices
from occontrol.scheduling.periodic.tree import ProofTree

MOST_AVERAGED = 400  # targets up to which shares are priced, too
FINE = 0.05


@dataclass(eq=False)
class Target:
    """One target as a problem of its own, its letters, and what is proven of it.

    Parameters
    ----------
    alone : PeriodicProblem without prices for looks
    filled : its letters in its own units, in the order of `alone.choices`
    parts : information and price rates of its choices
    letters : in units in which the smallest covariance is the identity, a step without a look first
    uses : (A, R) what a letter uses of the resources
    root : (n, n) x = root z
    """

    alone: PeriodicProblem
    filled: Filled
    parts: Parts
    letters: Letters
    uses: np.ndarray
    root: np.ndarray

    @property
    def choices(self) -> list[int]:
        """Number of each letter among the choices of `alone`."""
        return idle_first(self.alone)

    def averaged_at(self, prices: np.ndarray) -> tuple[float, np.ndarray]:
        """The averaged bound of the target with `prices` (R,) for looks, and the looks (R,) of its optimum."""
        order, root = self.choices, self.root
        inverse = np.linalg.inv(root)
        A = inverse @ self.alone.flowing.A.at(0.0) @ root
        noise = inverse @ self.alone.flowing.noise.at(0.0) @ inverse.T
        gains, running = root.T @ self.parts.gains[order] @ root, root.T @ self.parts.running @ root
        found = averaged_flow(A, noise, gains, running, self.parts.prices[order] + self.uses @ prices)
        return found.lower_bound, found.shares @ self.uses

    def tree_at(self, prices: np.ndarray, word: np.ndarray, gap: float, most: int, monitor: Monitor) -> float:
        """What a proof tree proves of the target with prices for looks.

        Parameters
        ----------
        prices : (R,) of one look
        word : (P,) letters of a known cycle
        gap : relative gap at which it ends
        most : words that are looked at
        monitor : Monitor
        """
        priced = replace(self.letters, constant=self.letters.constant + self.uses @ prices)
        cycle = cycle_of(priced, word)
        if cycle is None or self.letters.count < 2:
            return -np.inf
        best = -np.inf
        for Z in potentials(priced, cycle).values():
            tree = ProofTree(priced, Z, cycle.cost, FINE * gap)
            tree.grow(cycle.cost * (1 - gap), most, monitor)
            best = max(best, tree.bound)
        return best


@dataclass(frozen=True, eq=False)
class Shared:
    """A target whose looks are shares of time, as `best_prices` asks for it."""

    target: Target

    def bound_at(self, prices: np.ndarray) -> tuple[float, np.ndarray]:
        """The averaged bound at `prices` (R,), and the looks of it."""
        return self.target.averaged_at(prices)


@dataclass(frozen=True, eq=False)
class Bounds:
    """What is proven for all schedules, and which looks the bounds are made of.

    Parameters
    ----------
    averaged : for looks in shares of time, which holds whenever looks begin; None where it was not asked for
    integer : for looks that last whole steps
    prices : (R,) of a look, a step; of the larger bound
    parts : (K,) what each target costs at these prices at least
    rates : (K, R) looks a step of each bound's optimum, one array for each
    """

    averaged: float | None
    integer: float
    prices: np.ndarray
    parts: np.ndarray
    rates: list[np.ndarray] = field(repr=False)


def idle_first(alone: PeriodicProblem) -> list[int]:
    """The choices of a target alone with that of no look, the last one, in front."""
    count = len(alone.choices)
    return [count - 1, *range(count - 1)]


def targets_of(problem: EndlessTargetsProblem) -> list[Target]:
    """Every target as letters.

    Parameters
    ----------
    problem : EndlessTargetsProblem

    Raises InfeasibleError, with the name, where the covariance of a target has no limit under any schedule.
    """
    found = []
    for i, name in enumerate(problem.target_names):
        alone = problem.alone(i)
        try:
            filled = fill(alone)
        except InfeasibleError as error:
            raise InfeasibleError(f"target '{name}': {error}") from None
        root, order = np.linalg.cholesky(filled.smallest), idle_first(alone)
        whole = filled.letters.in_units(root)
        letters = Letters(*(x[order] for x in (whole.F, whole.Q, whole.L, whole.seen, whole.weight, whole.constant)))
        seen = [f"{name}@{problem.resource_names[r]}" for r in problem.seen_by(i)]
        uses = np.zeros((len(order), len(problem.resources)))
        for a, c in enumerate(order):
            for look in alone.choices[c]:
                uses[a, problem.seen_by(i)[seen.index(look)]] = 1
        found.append(Target(alone, filled, parts_of(alone), letters, uses, root))
    return found


def bounds_of(
    problem: EndlessTargetsProblem, targets: Sequence[Target], gap: float, most: int, monitor: Monitor
) -> Bounds:
    """The averaged bound, and that of whole looks.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    targets : of the problem
    gap : relative gap at which the proof of a target ends
    most : words of the proofs of all targets together
    monitor : Monitor
    """
    capacity = problem.capacity.astype(float)
    monitor.stage = "prices"
    tables = [GapTable(t.letters, t.uses[1:]) for t in targets]
    of_gaps = best_prices(tables, capacity, monitor)
    rates, tried = [of_gaps.used], [of_gaps]
    averaged: Priced | None = None
    if len(targets) <= MOST_AVERAGED and not monitor.stop:
        monitor.stage = "averaged bound"
        averaged = best_prices([Shared(t) for t in targets], capacity, monitor)
        rates.append(averaged.used)
        tried.append(averaged)
    monitor.stage = "proof"
    best: Priced | None = None
    for at in sorted(tried, key=lambda x: -x.lower_bound):
        parts = _parts(targets, tables, averaged is not None, at.prices, gap, most, monitor)
        value = float(np.sum(parts) - at.prices @ capacity)
        if best is None or value > best.lower_bound:
            best = Priced(value, at.prices, parts, at.used)
    assert best is not None
    return Bounds(
        None if averaged is None else averaged.lower_bound,
        max([best.lower_bound, *(x.lower_bound for x in tried)]), best.prices, best.parts, rates,
    )  # fmt: skip


def _parts(
    targets: Sequence[Target], tables: Sequence[GapTable], shares: bool, prices: np.ndarray, gap: float, most: int,
    monitor: Monitor,
) -> np.ndarray:  # fmt: skip
    """(K,) the largest bound of each target at these prices."""
    found = []
    for target, table in zip(targets, tables, strict=True):
        best, _ = table.bound_at(prices)
        if shares:
            best = max(best, target.averaged_at(prices)[0])
        if not monitor.stop:
            word = table.word_at(prices)
            best = max(best, target.tree_at(prices, word, gap, most // (2 * len(targets)), monitor))
        found.append(best)
    return np.array(found)
