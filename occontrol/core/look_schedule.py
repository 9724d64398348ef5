"""Schedules of many targets: which resource looks at which target on which interval, listed look by look."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.schedule import INTEGER, Schedule


@dataclass(frozen=True, eq=False, init=False)  # pyright: ignore[reportGeneralTypeIssues]
class LookSchedule(Schedule):
    """The looks of a schedule, in the order of interval, resource and target.

    Parameters
    ----------
    edges : (N+1,) increasing times
    interval, resource, target : (L,) numbers, one entry for every look
    share : (L,) 1 for a whole look; fractions belong to the relaxed problem
    resources, targets : names

    Raises ValueError for numbers that name nothing and for shares that are no shares.
    """

    interval: np.ndarray = field(repr=False)
    resource: np.ndarray = field(repr=False)
    target: np.ndarray = field(repr=False)
    resources: tuple[str, ...] = field(repr=False)
    targets: tuple[str, ...] = field(repr=False)

    def __init__(
        self,
        edges: np.ndarray,
        interval: np.ndarray,
        resource: np.ndarray,
        target: np.ndarray,
        share: np.ndarray,
        resources: tuple[str, ...],
        targets: tuple[str, ...],
    ):
        """`edges` (N+1,); `interval`, `resource`, `target` and `share` (L,) in any order; raises ValueError."""
        order = np.lexsort((target, resource, interval))
        listed = [np.asarray(x)[order] for x in (interval, resource, target)]
        share = np.asarray(share, dtype=float)[order]
        for x, most in zip(listed, (len(edges) - 1, len(resources), len(targets)), strict=True):
            if np.any(x < 0) or np.any(x >= most):
                raise ValueError("a look names an interval, a resource or a target that there is not")
        if not (np.all(np.isfinite(share)) and np.all(share >= 0) and np.all(share <= 1 + INTEGER)):
            raise ValueError("the shares of looks are not all numbers from 0 to 1")
        values = {
            "edges": np.asarray(edges, dtype=float), "interval": listed[0], "resource": listed[1], "target": listed[2],
            "resources": tuple(resources), "targets": tuple(targets), "names": tuple(targets),
            "weights": np.column_stack([*listed, share]).reshape(-1, 4),
        }  # fmt: skip
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def share(self) -> np.ndarray:
        """(L,) of the looks."""
        return self.weights[:, 3]

    @property
    def by_target(self) -> np.ndarray:
        """(N, targets) how much each target is looked at on every interval, by all resources together."""
        found = np.zeros((len(self.edges) - 1, len(self.targets)))
        np.add.at(found, (self.interval, self.target), self.share)
        return found

    @property
    def is_integer(self) -> bool:
        """Whether every look is whole."""
        return bool(np.all(np.abs(self.share - 1) <= INTEGER))

    @property
    def switches(self) -> int:
        """The number of inner edges at which what is looked at changes."""
        N = len(self.edges) - 1
        pair = self.resource * len(self.targets) + self.target
        now = {k: frozenset() for k in range(N)}
        ends = np.searchsorted(self.interval, np.arange(N + 1))
        for k in range(N):
            now[k] = frozenset(pair[ends[k] : ends[k + 1]].tolist())
        return sum(now[k] != now[k - 1] for k in range(1, N))

    @property
    def singular_fraction(self) -> float:
        """The share of the horizon on which a look is a fraction."""
        wrong = np.unique(self.interval[(self.share > 1e-3) & (self.share < 1 - 1e-3)])
        steps = np.diff(self.edges)
        return float(np.sum(steps[wrong]) / np.sum(steps))

    def segments(self) -> list[dict]:
        """[{start, end, resource, target}], looks at a target one after the other merged; fractions carry `share`."""
        order = np.lexsort((self.interval, self.target, self.resource))
        k, r, i, share = self.interval[order], self.resource[order], self.target[order], self.share[order]
        joined = np.zeros(len(k), dtype=bool)
        same = (r[1:] == r[:-1]) & (i[1:] == i[:-1]) & (k[1:] == k[:-1] + 1)
        joined[1:] = same & (np.abs(share[1:] - share[:-1]) <= INTEGER)
        first = np.flatnonzero(~joined)
        last = np.append(first[1:], len(k))[: len(first)] - 1
        found = []
        for a, b in zip(first, last, strict=True):
            record: dict = {
                "start": float(self.edges[k[a]]), "end": float(self.edges[k[b] + 1]),
                "resource": self.resources[r[a]], "target": self.targets[i[a]],
            }  # fmt: skip
            if abs(share[a] - 1) > INTEGER:
                record["share"] = float(share[a])
            found.append((k[a], r[a], i[a], record))
        return [record for *_, record in sorted(found, key=lambda x: x[:3])]
