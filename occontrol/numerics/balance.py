"""Units of the states in which a plant, its noise and its sensors are numbers of like size: powers of two.

In the coordinates x/d the nonnegative matrix of the pencil

    N = [[rate, driven], [observed, rate']]      (states and costates; d for the states, 1/d for the costates)

has the least sum of entries: of every state, what drives it and what it drives are alike,

    up_i   = sum_j rate_ji d_i/d_j + sum_j observed_ij d_i d_j       (the diagonal of rate left out)
    down_i = sum_j rate_ij d_j/d_i + sum_j driven_ij/(d_i d_j),      up_i = down_i.

The sum is convex in log d, so where it has a minimum the result does not depend on the units that one starts from.
Entries that lie on no cycle of N have none (they would fall without end): they are left out, and afterwards give the
states that are only driven, or only observed, their size. d consists of powers of two, so that scaling is exact.
Source: Osborne (1960), On pre-conditioning of matrices; all states at once, with Newton's step where it is better.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse.csgraph import connected_components

MOST_ROUNDS = 200
SETTLED = 1e-7
FLAT = 1e-14  # curvature, relative to the largest, that is rounding
TURN = 0.4877  # rounding of log2 d turns at .5123, not at .5, where tidy data often lies
LARGEST = 500.0  # |log2 d|


def balancing(rate: np.ndarray, driven: np.ndarray, observed: np.ndarray, power: int = 1) -> np.ndarray:
    """Powers of two d (n,) that balance the pencil; all ones where an entry is not finite.

    Parameters
    ----------
    rate : (n, n) |A| times the horizon, the largest over time
    driven : (n, n) |Xi| times the horizon, plus |Sigma0| where the start counts
    observed : (n, n) information times the horizon, plus the weights of the cost where they count
    power : of the entries whose sum is least; 2 for the least Frobenius norm, which sets the steps of a Riccati flow
    """
    parts = (np.ascontiguousarray(np.abs(part), dtype=float) for part in (rate, driven, observed))
    return _balancing(len(rate), power, *(part.tobytes() for part in parts)).copy()


@lru_cache(maxsize=32)  # one solve asks for the same plant several times
def _balancing(n: int, power: int, *stored: bytes) -> np.ndarray:
    rate, driven, observed = (np.frombuffer(part).reshape(n, n) for part in stored)
    if not all(np.all(np.isfinite(part)) for part in (rate, driven, observed)):
        return np.ones(n)
    rate = np.where(np.eye(n, dtype=bool), 0.0, rate)
    pencil = np.block([[rate, driven], [observed, rate.T]])
    _, label = connected_components(pencil > 0, connection="strong")
    within = np.where(label[:, None] == label, pencil, 0.0)
    own = np.asarray(label[:n] == label[n:])
    groups = [np.flatnonzero(label[:n] == g) for g in np.unique(label[:n][own])]
    within = within**power
    logs = _minimised(within[:n, :n], within[:n, n:], within[n:, :n], groups) / power
    logs = _settled(logs, own, label[:n], rate, driven)
    logs = -_settled(-logs, own, label[:n], rate.T, observed)
    return np.ldexp(1.0, np.floor(np.clip(logs / np.log(2.0), -LARGEST, LARGEST) + TURN).astype(int))


def _parts(logs: np.ndarray, rate: np.ndarray, driven: np.ndarray, observed: np.ndarray) -> tuple[np.ndarray, ...]:
    """The three matrices in the units exp(logs)."""
    with np.errstate(over="ignore", under="ignore"):
        both = logs + logs[:, None]
        return rate * np.exp(logs - logs[:, None]), driven * np.exp(-both), observed * np.exp(both)


def _minimised(rate: np.ndarray, driven: np.ndarray, observed: np.ndarray, groups: list[np.ndarray]) -> np.ndarray:
    """log d that minimises sum rate_ij d_j/d_i + sum driven_ij/(2 d_i d_j) + sum observed_ij d_i d_j/2.

    `groups` are states that turn into each other: fast turning hides their common size from all steps but its own.
    """
    logs = np.zeros(len(rate))

    def total(parts: tuple[np.ndarray, ...]) -> float:
        return float(np.sum(parts[0]) + 0.5 * np.sum(parts[1]) + 0.5 * np.sum(parts[2]))

    parts = _parts(logs, rate, driven, observed)
    for _ in range(MOST_ROUNDS):
        a, x, y = parts
        up, down = np.sum(a, axis=0) + np.sum(y, axis=1), np.sum(a, axis=1) + np.sum(x, axis=1)
        open_ = (up > 0) & (down > 0)
        # a quarter of the logarithm, for all states at once, never raises the sum
        plain = np.where(open_, 0.25 * np.log(np.where(open_, down, 1.0) / np.where(open_, up, 1.0)), 0.0)
        newton = _newton(a, x + y, up, down)
        candidates = [(logs + step, step) for step in (newton, plain)]
        found = [_parts(at, rate, driven, observed) for at, _ in candidates]
        chosen = 0 if total(found[0]) <= total(found[1]) * (1 + 1e-14) else 1
        logs, parts = candidates[chosen][0], found[chosen]
        moved = np.max(np.abs(newton), initial=0.0) if np.any(candidates[chosen][1]) else 0.0
        for group in groups:
            x, y = (np.sum(part[np.ix_(group, group)]) for part in parts[1:])
            if 0 < x < np.inf and 0 < y < np.inf:
                common = 0.25 * np.log(x / y)
                logs[group] += common
                moved = max(moved, abs(common))
        parts = _parts(logs, rate, driven, observed)
        if moved < SETTLED:
            break
    return logs


def _newton(a: np.ndarray, both: np.ndarray, up: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Newton's step, at most 2 in any component; `both` is driven plus observed."""
    H = both - a - a.T
    np.fill_diagonal(H, up + down + np.diag(both))
    size = np.sqrt(np.where(np.diag(H) > 0, np.diag(H), 1.0))
    if not np.all(np.isfinite(H)):
        return np.zeros(len(a))
    # the sum does not see a common factor of states that nothing drives or observes: the step leaves it alone
    values, vectors = np.linalg.eigh(H / size[:, None] / size)
    seen = values > FLAT * max(values[-1], 0.0)
    step = vectors[:, seen] @ ((vectors[:, seen].T @ ((down - up) / size)) / values[seen]) / size
    largest = np.max(np.abs(step), initial=0.0)
    return step if largest <= 2 else step * (2 / largest) if np.isfinite(largest) else np.zeros(len(a))


def _settled(logs: np.ndarray, own: np.ndarray, label: np.ndarray, rate: np.ndarray, driven: np.ndarray) -> np.ndarray:
    """The states that are driven but not seen: whatever drives them from outside their group sums to 1.

    Parameters
    ----------
    logs : (n,) log d
    own : (n,) states that are driven and seen: their units stand
    label : (n,) the group of each
    rate, driven : (n, n)
    """
    reached = np.diag(driven) > 0
    for _ in range(len(logs)):
        reached = reached | np.any((rate > 0) & reached, axis=1)
    done = own.copy()
    waiting = [np.flatnonzero(label == g) for g in np.unique(label[reached & ~own])]
    logs = logs.copy()
    while waiting:  # the groups have an order, so there is always one that can be settled
        later = []
        for group in waiting:
            others = np.setdiff1d(np.flatnonzero(reached), group)
            feeding = others[np.any(rate[np.ix_(group, others)] > 0, axis=0)]
            if not np.all(done[feeding]):
                later.append(group)
                continue
            here = logs[group][:, None]
            once = np.sum(rate[np.ix_(group, feeding)] * np.exp(logs[feeding] - here))
            twice = np.sum(driven[np.ix_(group, group)] * np.exp(-here - here.T))
            logs[group] += np.log((once + np.sqrt(once**2 + 4 * twice)) / 2)
            done[group] = True
        waiting = later
    return logs


@dataclass(frozen=True, eq=False)
class StateUnits:
    """Coordinates x/d, and what every kind of matrix is in them; `inverse` undoes it, to the last bit.

    Parameters
    ----------
    factors : (n,) d, powers of two
    """

    factors: np.ndarray

    @property
    def inverse(self) -> StateUnits:
        """The units that lead back."""
        return StateUnits(1.0 / self.factors)

    def vector(self, x: np.ndarray) -> np.ndarray:
        """A state x (..., n)."""
        return x / self.factors

    def map(self, A: np.ndarray) -> np.ndarray:
        """What takes states to states, such as F, K C and A (..., n, n)."""
        return A * (self.factors / self.factors[:, None])

    def into(self, B: np.ndarray) -> np.ndarray:
        """What takes anything to states, such as a gain and B (..., n, m)."""
        return B / self.factors[:, None]

    def out_of(self, C: np.ndarray) -> np.ndarray:
        """What takes states to anything, such as D and C (..., m, n)."""
        return C * self.factors

    def covariance(self, S: np.ndarray) -> np.ndarray:
        """A covariance or an intensity S (..., n, n)."""
        return S / self.factors / self.factors[:, None]

    def weight(self, R: np.ndarray) -> np.ndarray:
        """A weight on a covariance, an information or a costate R (..., n, n)."""
        return R * self.factors * self.factors[:, None]
