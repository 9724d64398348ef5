"""The price of one cap, by bisection: what a unit of observation cost, or of error, is worth.

For every price nu >= 0 the problem without the cap, F + nu u in the place of F, bounds the one with it:

    F* >= max over nu of [ min over schedules of F + nu u ] - nu b,     u the observation cost or the error, b its cap

The maximum is concave in nu, and u falls as nu grows, so nu is bracketed and narrowed by the sign of u - b. Without
other rules the inner problem is the relaxation, with them the hull of schedules; each begins where the last one ended.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.rules.caps import Scaled, only_cap, priced, used_by
from occontrol.scheduling.rules.check import RELATIVE
from occontrol.scheduling.rules.hull import HullOptions, hull
from occontrol.scheduling.rules.master import Multipliers
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.rows import Rows
from occontrol.scheduling.rules.task import Task

ROUNDS = 24  # prices that are tried
ENOUGH = 4e-5  # of F: what bound and mixture may differ by
INNER, HULL = 2e-5, 5e-5  # relative gaps of the problem at one price, relaxed and as a hull
ROUGH, CLOSE = 1e-3, 1.5  # relative gap while the cap is not bracketed by prices within that factor
FACTOR = 8.0  # from one price to the next, while the cap is not bracketed
NARROW = 1e-4  # of a price: what is not narrowed further
SMALLEST = 1e-9  # of the first price: what counts as none


@dataclass(frozen=True, eq=False)
class AtPrice:
    """The problem without the cap, solved at one price.

    Parameters
    ----------
    price : nu
    bound : on F, with the cap
    used : u of the policy
    weights : (N, C) the policy
    proof : policy (N, C) and Multipliers of the other rows whose tangent proves the bound
    plans : schedules that were met
    """

    price: float
    bound: float
    used: float
    weights: np.ndarray
    proof: tuple[np.ndarray, Multipliers]
    plans: list[Plan] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Priced:
    """What the search for a price found.

    Parameters
    ----------
    cap : "max_observation" or "max_error"
    best : AtPrice of the best bound
    mixture : (N, C) policy that keeps the cap, or the last one where none was met
    value : F of it; inf where it is no mixture of schedules that keep the rules
    rows : other rows, those found violated included
    prices : how many were tried
    plain : whether there are no other rules, and changes cost nothing
    """

    cap: str
    best: AtPrice
    mixture: np.ndarray
    value: float
    rows: Rows
    prices: int
    plain: bool


class _Search:
    """One task, solved at many prices."""

    def __init__(self, task: Task, cap: str, allowed: FeasibleSet, seen: Callable[[Plan], None], monitor: Monitor):
        self.task, self.cap, self.allowed, self.seen = task, cap, allowed, seen
        self.monitor = monitor.child(silent=True)
        self.limit = float(getattr(task.rules, cap))
        self.plain = only_cap(task)
        self.rows = Rows(priced(task, cap, 1.0))
        self.known: list[AtPrice] = []

    def at(self, price: float, before: AtPrice, fine: bool = True) -> AtPrice:
        """The problem at a price, begun where another one ended."""
        problem = priced(self.task, self.cap, price)
        if self.plain:
            objective, options = Scaled(problem), RelaxedOptions(INNER if fine else ROUGH, own=True)
            found = minimise_relaxed(objective, self.allowed, before.weights, options, self.monitor)
            weights, proof, plans = found.weights, (found.weights, Multipliers(np.empty(0))), before.plans
            J, g = objective.cost_and_gradient(weights)
            bound = self.allowed.bound(J, weights, g)
        else:
            start = (before.weights, before.proof[1], before.plans)
            options = HullOptions(HULL if fine else ROUGH, lambda: np.inf)
            found = hull(problem, self.rows, start, None, options, self.seen, self.monitor)
            weights, proof, plans = found.tangent.weights, found.proof[:2], found.plans
            bound = found.lower_bound
        bound -= price * self.limit * (1 + RELATIVE) if price > 0 else 0.0
        at = AtPrice(price, bound, used_by(self.task, self.cap, weights), weights, proof, plans)
        self.known.append(at)
        return at

    def mixed(self, above: AtPrice, below: AtPrice) -> np.ndarray:
        """The mixture (N, C) of two policies that uses up the cap; u is convex, so it keeps it."""
        share = (self.limit - below.used) / max(above.used - below.used, 1e-300)
        return below.weights + min(max(share, 0.0), 1.0) * (above.weights - below.weights)

    def close(self, above: AtPrice | None, below: AtPrice | None) -> bool:
        """Whether the price is known well enough for digits to be worth it."""
        return above is not None and below is not None and below.price <= CLOSE * above.price

    def closed(self, above: AtPrice, below: AtPrice) -> bool:
        """Whether further prices are not worth it."""
        if below.price <= above.price * (1 + NARROW):
            return True
        value = Scaled(self.task).cost(self.mixed(above, below)) if self.plain else np.inf
        return value - max(at.bound for at in self.known) <= ENOUGH * self.task.size(value)

    def next(self, above: AtPrice | None, below: AtPrice | None) -> float:
        """The price to try next."""
        if below is None:
            return FACTOR * above.price if above is not None else np.nan
        if above is None or above.price == 0.0:
            return below.price / FACTOR
        share = (above.used - self.limit) / max(above.used - below.used, 1e-300)
        share = 0.5 if len(self.known) % 3 == 0 else min(max(share, 0.1), 0.9)
        return float(above.price * (below.price / above.price) ** share)


def price_of(
    task: Task, cap: str, start: np.ndarray, allowed: FeasibleSet, seen: Callable[[Plan], None], monitor: Monitor
) -> Priced | None:
    """The price at which the bound is best, with a policy that keeps the cap; None where nothing has a price.

    Parameters
    ----------
    task : with one cap
    cap : "max_observation" or "max_error"
    start : (N, C) policy to begin at
    allowed : FeasibleSet without rules, of the recursion's columns
    seen : called with every schedule that the hull meets
    monitor : Monitor
    """
    search = _Search(task, cap, allowed, seen, monitor)
    guess = _guess(task, search.limit, start) if search.limit > 0 else np.nan
    if not 0 < guess < np.inf:
        return None
    last = AtPrice(0.0, -np.inf, np.inf, start, (start, Multipliers(np.empty(0))))
    above, below = None, None  # more than the cap is used, and at most that
    price = 0.0 if task.goal.error > 0 else guess
    while len(search.known) < ROUNDS and not search.monitor.stop:
        last = search.at(price, last, price == 0.0 or search.close(above, below))
        if last.used > search.limit:
            above = last
        else:
            below = last
        if price == 0.0:
            if below is not None:
                break
            price = guess
            continue
        if above is not None and below is not None and above.price > 0 and search.closed(above, below):
            break
        price = search.next(above, below)
        if not SMALLEST * guess <= price < np.inf:
            break
    best = max(search.known, key=lambda at: at.bound)
    mixture, value = last.weights, np.inf
    if below is not None:
        mixture = below.weights if above is None else search.mixed(above, below)
        value = Scaled(task).cost(mixture) if search.plain else np.inf
    return Priced(cap, best, mixture, value, search.rows, len(search.known), search.plain)


def _guess(task: Task, limit: float, start: np.ndarray) -> float:
    """A first price: a tenth of what F would be worth a unit of the cap, were all of it to be had for that."""
    _, error = task.parts(start)
    dearest = np.max(np.where(task.sweep.recursion.available > 0, task.price, 0.0), axis=1, initial=0.0)
    return 0.1 * (task.goal.observation * float(np.sum(dearest)) + task.goal.error * abs(error)) / limit


def begin_at(task: Task, found: Priced, rows: Rows) -> tuple[np.ndarray, Multipliers, list[Plan]]:
    """Where the first node of a search begins; `rows` takes over those that were found.

    Parameters
    ----------
    task : with the cap
    found : Priced
    rows : of the search, as it was made
    """
    policy, multipliers = found.best.proof
    own = multipliers.padded(len(found.rows.known)).rows
    at = rows.adopt(found.rows)
    if found.cap == "max_error":
        return policy, Multipliers(own, found.best.price), found.best.plans
    price = found.best.price * rows.known[at].unit
    return policy, Multipliers(np.concatenate([own[:at], [price], own[at:]])), found.best.plans
