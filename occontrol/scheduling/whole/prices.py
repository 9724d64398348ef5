"""Prices of looks that make the bound on whole looks large: column generation.

D(lam) = sum_i m_i(lam) - sum_s lam_s c_s is a lower bound for all lam >= 0. What is known of m_i is concave, the least
of lines a + lam.u, a what plans cost and u how often they look on each stretch; every answer shows one. The largest D
that the lines shown allow in a box around the best prices so far is a linear programme, whose prices are tried next.
The box grows where D grew by a good share of what the lines expected, and shrinks where it did not.

Where two lower bounds are known of m_i, from whole looks and a tangent, each has lines of its own: those count of the
one that is larger at the best prices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csc_array, hstack

WIDE, WIDER, NARROWER, GAINED = 0.5, 1.5, 0.6, 0.1  # the box of prices, relative to them
LEAST = 1e-3  # of the cost of a stretch, that a price is wide at least
KEPT = 14  # lines of a target that stay


@dataclass(frozen=True, eq=False)
class Line:
    """height + sum of share lam[at]: above a concave function of prices lam.

    Parameters
    ----------
    height : a
    at, share : stretches and u there
    """

    height: float
    at: np.ndarray
    share: np.ndarray


@dataclass(frozen=True, eq=False)
class Answer:
    """What all targets say to prices.

    Parameters
    ----------
    bounds : (T,) m_i from below
    plans : (T,) lines of a plan each: what it costs, where it looks
    lines : for every target, the lines of its lower bounds, one of each kind
    """

    bounds: np.ndarray
    plans: list[Line]
    lines: list[tuple[Line, ...]]


@dataclass
class Found:
    """The best prices so far.

    Parameters
    ----------
    prices : (S,)
    bound : D
    bounds : (T,) m_i
    rounds : how many prices were tried
    most : what the lines allow near the best prices
    """

    prices: np.ndarray
    bound: float = -np.inf
    bounds: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rounds: int = 0
    most: float = np.inf


class Lines:
    """The lines a + lam.u of all targets, and the linear programme on them.

    Parameters
    ----------
    targets : T
    capacity : (S,) looks of every stretch
    """

    def __init__(self, targets: int, capacity: np.ndarray):
        self.capacity = np.asarray(capacity, dtype=float)
        self._known: list[tuple[dict[bytes, Line], ...]] = [({}, {}) for _ in range(targets)]

    def add(self, answer: Answer) -> None:
        """The lines that an answer shows."""
        for known, lines in zip(self._known, answer.lines, strict=True):
            for kind, line in zip(known, lines, strict=False):
                kind[line.at.tobytes() + line.share.tobytes()] = line

    def best(self, centre: np.ndarray, width: np.ndarray) -> tuple[float, float, np.ndarray]:
        """The D that the lines allow at prices, the largest near them, and the prices (S,) of that.

        Parameters
        ----------
        centre, width : (S,) prices differ from the centre by at most the width; lines that are far above the lowest
            at the centre are forgotten
        """
        cost, own, used = [], [], []
        here = -float(centre @ self.capacity)
        for i, kinds in enumerate(self._known):
            most, best = -np.inf, {}
            for known in kinds:
                height = {key: x.height + float(x.share @ centre[x.at]) for key, x in known.items()}
                if len(known) > 2 * KEPT:
                    for key in sorted(known, key=height.__getitem__)[KEPT:]:
                        del known[key]
                if known and min(height.values()) > most:
                    most, best = min(height.values()), known
            here += most
            used += best.values()
            cost += [x.height for x in best.values()]
            own += [i] * len(best)
        rows = np.repeat(np.arange(len(used)), [len(x.at) for x in used])
        columns, values = np.concatenate([x.at for x in used]), -np.concatenate([x.share for x in used])
        C, S, T = len(cost), len(self.capacity), len(self._known)
        share = csc_array((np.ones(C), (np.arange(C), np.array(own))), shape=(C, T))
        u = csc_array((values, (rows, columns)), shape=(C, S))
        low, high = np.maximum(centre - width, 0.0), centre + width
        limits = [(None, None)] * T + list(zip(low, high, strict=True))
        found = linprog(
            np.concatenate([-np.ones(T), self.capacity]), A_ub=hstack([share, u], format="csc"), b_ub=np.array(cost),
            bounds=limits, method="highs",
        )  # fmt: skip
        if found.status != 0:
            return here, here, centre
        return here, -float(found.fun), np.clip(found.x[T:], low, high)


def raise_bound(
    ask: Callable[[np.ndarray], Answer],
    lines: Lines,
    start: np.ndarray,
    rounds: int,
    gap: float,
    stop: Callable[[Found], bool] = lambda found: False,
) -> Found:
    """Prices with a large D.

    Parameters
    ----------
    ask : answers prices (S,)
    lines : that are known already; if any
    start : (S,) prices to begin with
    rounds : at most
    gap : relative, what the lines expect to gain
    stop : whether to leave earlier
    """
    found = Found(start)
    prices, share, expected = start, WIDE, 0.0
    for _ in range(rounds):
        given = ask(prices)
        found.rounds += 1
        bound = float(np.sum(given.bounds) - prices @ lines.capacity)
        share = min(WIDE, share * (WIDER if bound - found.bound > GAINED * expected else NARROWER))
        if bound > found.bound:
            found.bound, found.prices, found.bounds = bound, prices, given.bounds
        lines.add(given)
        least = LEAST * float(np.sum(np.abs(found.bounds))) / max(len(prices), 1)
        width = share * (found.prices + np.mean(found.prices) + least)
        here, found.most, prices = lines.best(found.prices, width)
        expected = found.most - here
        if expected <= gap * abs(found.bound) or stop(found):
            break
    return found
