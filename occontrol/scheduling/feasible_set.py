"""What schedules are allowed: one object that the solvers ask, whatever rules stand behind it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from occontrol.core.errors import Mistake, plural
from occontrol.scheduling import polytope
from occontrol.scheduling.polytope_face import face as polytope_face
from occontrol.scheduling.rounding import sum_up

ROUNDING = 1e-6  # of a sensor: what a schedule that was written to a file and read again may be off


@dataclass(frozen=True, eq=False)
class Face:
    """The smallest face that a policy lies on, as far as a gradient lets it stay there.

    Parameters
    ----------
    listed : (F,) flat indices of the free weights, group by group; the sum of every group is fixed
    ends : (G,) where the groups end in `listed`
    move : (N, M) what nearly stands at a bound and is pushed there goes all the way at once
    """

    listed: np.ndarray
    ends: np.ndarray
    move: np.ndarray


class Bounding(Protocol):
    """What the tangent of a convex J bounds it on."""

    def bound(self, cost: float, weights: np.ndarray, gradient: np.ndarray) -> float:
        """The lower bound that J = `cost` and its gradient (N, M) at `weights` (N, M) prove."""
        ...


class FeasibleSet(Protocol):
    """A convex set of policies v (N, M), N decisions and M sensors, and the integral schedules in it.

    `vertex` carries the certificates: for the gradient g of a convex J at any v, J(v) - excess(v, g).sum() is a lower
    bound for every policy of the set.

    Attributes
    ----------
    shape : (N, M)
    places : how many sensors are used at a time
    """

    @property
    def shape(self) -> tuple[int, int]: ...

    @property
    def places(self) -> int: ...

    def vertex(self, gradient: np.ndarray) -> np.ndarray:
        """The cheapest allowed schedule (N, M), integral: argmin of g.w for g, `gradient` (N, M); on a tie the
        lowest index."""
        ...

    def project(self, weights: np.ndarray) -> np.ndarray:
        """The policy (N, M) of the set that is nearest to any `weights` (N, M)."""
        ...

    def excess(self, weights: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """(N,) v.g - min_w w.g, decision by decision: what could still be saved to first order.

        v is `weights` (N, M), g is `gradient` (N, M).
        """
        ...

    def round(self, weights: np.ndarray, backward: bool = False) -> np.ndarray:
        """An allowed integral schedule (N, M) whose use of every sensor follows that of `weights` (N, M).

        With `backward` it follows from the end to the start.
        """
        ...

    def uniform(self) -> np.ndarray:
        """A policy (N, M) of the set that favours no sensor."""
        ...

    def check(self, weights: np.ndarray) -> list[Mistake]:
        """Why weights (N, M) do not belong to the set, in words that name sensor and interval; empty when they do."""
        ...

    def face(self, weights: np.ndarray, gradient: np.ndarray, near: float) -> Face:
        """The face of `weights` (N, M): entries within `near` of a bound, to which `gradient` (N, M) pushes, stay."""
        ...

    def exchange_masks(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where a sensor's use may end and where one may begin, (N, M) each, for single exchanges on one interval.

        `weights` (N, M).
        """
        ...

    def swap_mask(self, weights: np.ndarray) -> np.ndarray:
        """(N-1,) whether intervals k and k+1 of a schedule, `weights` (N, M), may change places."""
        ...

    def part(self, first: int, last: int) -> FeasibleSet:
        """The set of intervals first .. last - 1 alone, for choosers that go from interval to interval."""
        ...

    # ---- what follows from the above; overridden where compiled loops do it faster

    def bound(self, cost: float, weights: np.ndarray, gradient: np.ndarray) -> float:
        """The lower bound for every policy of the set that J and its gradient (N, M) at `weights` (N, M) prove."""
        return cost - float(np.sum(self.excess(weights, gradient)))

    def contains(self, weights: np.ndarray) -> bool:
        """Whether weights (N, M) belong to the set."""
        return not self.check(weights)

    def mixture(
        self, constants: np.ndarray, gradients: np.ndarray, last: int, rounds: int, wanted: float = np.inf
    ) -> float:
        """max over shares lam of min over w of sum_i lam_i (a_i + g_i.w), by at most `rounds` steps of entropic ascent.

        Parameters
        ----------
        constants : (K,) a_i
        gradients : (K, N, M) g_i
        last : the cut to start from
        rounds : steps
        wanted : value at which to stop

        Returns the best value met: a lower bound, wherever it stops.
        """
        shares, best = np.zeros(len(constants)), -np.inf
        shares[last] = 1.0
        for turn in range(rounds):
            used = np.where(shares > 1e-9, shares, 0.0)
            w = self.vertex(np.tensordot(used, gradients, 1))
            values = constants + np.tensordot(gradients, w, 2)
            best = max(best, float(used @ values) / float(np.sum(used)))
            spread = float(np.ptp(values))
            if not spread > 0.0 or best >= wanted:
                break
            shares = (shares + 1e-4) * np.exp(3.0 / spread / np.sqrt(turn + 1.0) * (values - np.max(values)))
            shares /= np.sum(shares)
        return best


@dataclass(frozen=True, eq=False)
class IntervalPolytopes(FeasibleSet):
    """Every interval by itself: 0 <= v_kj <= upper_kj and sum_j v_kj = select.

    Parameters
    ----------
    upper : (N, M) largest weight of each sensor: 0 outside its windows, 1 inside, `select` for 'idle'
    select : sum of the weights of an interval
    edges : (N+1,) times of the intervals, for rounding and for words; None is intervals of equal length
    names : (M,) of the sensors, for words; their numbers 1 .. M if left out
    """

    upper: np.ndarray
    select: int
    edges: np.ndarray | None = None
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "upper", np.ascontiguousarray(self.upper, dtype=float))

    @property
    def shape(self) -> tuple[int, int]:
        """(N, M)"""
        N, M = self.upper.shape
        return N, M

    @property
    def places(self) -> int:
        """`select`"""
        return self.select

    @cached_property
    def lengths(self) -> np.ndarray:
        """(N,) of the intervals."""
        return np.ones(len(self.upper)) if self.edges is None else np.diff(self.edges)

    def vertex(self, gradient: np.ndarray) -> np.ndarray:
        """The cheapest open weights (N, M) of every interval for `gradient` (N, M)."""
        return polytope.vertex(gradient, self.upper, self.select)

    def project(self, weights: np.ndarray) -> np.ndarray:
        """v_j = clip(y_j - lam, 0, upper_j) with the sum `select` on every interval; y is `weights` (N, M)."""
        return polytope.project(weights, self.upper, self.select)

    def excess(self, weights: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """(N,) interval by interval, for `weights` (N, M) and `gradient` (N, M)."""
        return polytope.excess(weights, gradient, self.upper, self.select)

    def round(self, weights: np.ndarray, backward: bool = False) -> np.ndarray:
        """Sum-up rounding (N, M) of weights (N, M), see scheduling/rounding.py."""
        return sum_up(weights, self.lengths, self.upper, self.select, backward)

    def uniform(self) -> np.ndarray:
        """The available sensors in equal shares (N, M)."""
        return polytope.uniform(self.upper, self.select)

    def face(self, weights: np.ndarray, gradient: np.ndarray, near: float) -> Face:
        """The groups are the intervals; `weights` (N, M), `gradient` (N, M)."""
        return Face(*polytope_face(weights, gradient, self.upper, near))

    def mixture(
        self, constants: np.ndarray, gradients: np.ndarray, last: int, rounds: int, wanted: float = np.inf
    ) -> float:
        """As in FeasibleSet, compiled; constants (K,), gradients (K, N, M)."""
        return polytope.mixture(constants, gradients, last, self.upper, self.select, rounds, wanted)

    def exchange_masks(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where one sensor's worth of weight can be taken, and where it finds room, (N, M) each. `weights` (N, M)."""
        return weights > 0.5, weights <= self.upper - 0.5

    def swap_mask(self, weights: np.ndarray) -> np.ndarray:
        """(N-1,) whether what intervals k and k+1 use, rows of `weights` (N, M), is available on the other one."""
        return np.all((weights[1:] <= self.upper[:-1]) & (weights[:-1] <= self.upper[1:]), axis=1)

    def part(self, first: int, last: int) -> IntervalPolytopes:
        """Intervals first .. last - 1."""
        edges = None if self.edges is None else self.edges[first : last + 1]
        return IntervalPolytopes(self.upper[first:last], self.select, edges, self.names)

    def contains(self, weights: np.ndarray) -> bool:
        """Whether weights (N, M) belong to the set up to ROUNDING."""
        inside = (weights >= -ROUNDING) & (weights <= self.upper + ROUNDING)
        return bool(np.all(inside) and np.all(np.abs(np.sum(weights, axis=1) - self.select) <= ROUNDING))

    def check(self, weights: np.ndarray) -> list[Mistake]:
        """One mistake for each way in which a sensor, or the sum, of weights (N, M) is wrong, at the first interval."""
        if weights.shape != self.shape:
            N, M = self.shape
            what = f"the weights are {' x '.join(map(str, weights.shape))}, there are {plural(N, 'interval')}"
            return [Mistake(("schedule",), f"{what} and {plural(M, 'sensor')}", f"weights ({N}, {M})")]
        found: list[Mistake] = []

        def add(wrong: np.ndarray, text: str, values: np.ndarray, hint: str) -> None:
            if np.any(wrong):
                k = int(np.argmax(wrong))
                more = f", and on {plural(int(np.sum(wrong)) - 1, 'other interval')}" if np.sum(wrong) > 1 else ""
                found.append(Mistake(("schedule", k), f"{self._when(k)} {text.format(values[k])}{more}", hint))

        for j in range(self.shape[1]):
            name = self.names[j] if self.names else str(j + 1)
            v, most = weights[:, j], self.upper[:, j]
            share = f"sensor '{name}' has weight {{:g}}"
            with np.errstate(invalid="ignore"):
                add(~np.isfinite(v), share, v, "weights are finite numbers")
                add(v < -ROUNDING, share, v, "a weight is not negative")
                closed = most <= 0.0
                hint = "use it inside its windows only; a window must cover the whole interval"
                add(closed & (v > ROUNDING), f"{share}, but is not available", v, hint)
                limits = most[~closed]
                hint = f"at most {np.max(limits, initial=0.0):g}"
                add(~closed & (v > most + ROUNDING) & np.isfinite(v), share, v, hint)
        sums = np.sum(weights, axis=1)
        wrong = np.isfinite(sums) & (np.abs(sums - self.select) > ROUNDING)
        hint = f"{plural(self.select, 'sensor')} at a time: the weights of an interval add up to {self.select}"
        add(wrong, "the weights add up to {:g}" + f", not to {self.select}", sums, hint)
        return found

    def _when(self, k: int) -> str:
        if self.edges is None:
            return f"on interval {k + 1}"
        return f"on interval {k + 1}, between t = {self.edges[k]:g} and {self.edges[k + 1]:g},"
