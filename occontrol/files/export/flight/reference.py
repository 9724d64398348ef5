"""The filter of the target in Python: the same operations in the same order, so that every bit is the same.

A sum runs from its first term to its last (np.add.accumulate does); what C does for one row after the other happens
here for all rows at once, which changes no order within a sum. The formulas stand in templates/a_head.c.
"""

from __future__ import annotations

import enum

import numpy as np

from occontrol.files.export.flight.content import Content


class Status(enum.IntEnum):
    """What a call on the target returns."""

    OK = 0
    NULL_POINTER = 1
    END = 2
    BAD_SAMPLE = 3
    SINGULAR = 4
    OVERFLOW = 5
    BAD_TABLE = 6
    OUTSIDE = 7
    BAD_STATE = 8


class ReferenceFilter:
    """State and functions of the target's filter.

    Parameters
    ----------
    content : Content with a filter
    """

    def __init__(self, content: Content):
        self.content, self.n, self.m = content, content.table("mean").shape[1], content.values
        self.type = np.dtype(content.options.dtype)
        self.full, self.plan = "full" in content.flags, "plan" in content.flags
        self.init()

    def init(self) -> None:
        """Back to the start of the horizon."""
        self.k, self.round, self.dimension, self.planned = 0, 0, 0, self.plan
        self.nis = self.type.type(0)
        self.x = self.content.table("mean")[0].copy()
        if self.full:
            self.pivot, self.lower = self._root(0)

    def init_at(self, k: int, x: np.ndarray) -> Status:
        """Start at node `k` with the estimate x (n,)."""
        plan = self.content.plan
        if not 0 <= k <= plan.intervals - (plan.again is not None):
            return Status.OUTSIDE
        if not np.all(np.isfinite(x)):
            return Status.BAD_STATE
        self.init()
        self.k, self.x = k, np.array(x, dtype=self.type)
        return Status.OK

    def _root(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        return self.content.row("root_pivot", k), _unit(self.content.row("root_lower", k), self.n)

    def factor(self) -> tuple[np.ndarray, np.ndarray]:
        """d (n,) and L (n, n) of the covariance."""
        return self._root(self.k) if self.planned else (self.pivot, self.lower)

    def step(self, z: np.ndarray, valid: np.ndarray | None = None) -> Status:
        """Advance by one interval.

        Parameters
        ----------
        z : (m,) values, NaN where missing
        valid : (m,) 0 where missing, or None
        """
        content, k = self.content, self.k
        if k >= content.plan.intervals:
            return Status.END
        values = int(content.table("values")[k])
        z = np.asarray(z, dtype=self.type)[:values]
        there = np.ones(values, dtype=bool) if valid is None else np.asarray(valid)[:values] != 0
        kept = np.flatnonzero(there & ~np.isnan(z))
        if np.any(np.isinf(z[kept])):
            return Status.BAD_SAMPLE
        return self._step(z, kept, values)

    def _step(self, z: np.ndarray, kept: np.ndarray, values: int) -> Status:
        """The step with the values of `z` (m,) that are `kept`, of so many."""
        content, k = self.content, self.k
        F = content.row("transition", k).reshape(self.n, self.n).T
        H = content.row("observe", k).reshape(self.n, self.m).T[kept]
        with np.errstate(all="ignore"):
            e, x = content.row("offset", k)[kept].copy(), content.row("input", k).copy()
            for c in range(self.n):
                e = e + H[:, c] * self.x[c]
                x = x + F[:, c] * self.x[c]
            e = z[kept] - e
            if self.planned and len(kept) == values:
                return self._planned_step(e, x)
            return self._full_step(F, H, kept, values, e, x) if self.full else self._gains_step(kept, values, e, x)

    def _planned_step(self, e: np.ndarray, x: np.ndarray) -> Status:
        K = self.content.row("gain", self.k).reshape(self.m, self.n)
        pivot, lower = (self.content.row(f"innovation_{part}", self.k) for part in ("pivot", "lower"))
        white, nis = e.copy(), self.type.type(0)
        for i in range(len(e)):
            for r in range(i):
                white[i] -= lower[i * (i - 1) // 2 + r] * white[r]
            if not pivot[i] > 0:
                return Status.SINGULAR
            nis = nis + white[i] * white[i] / pivot[i]
            x = x + K[i] * e[i]
        return self._accept(x, nis, len(e))

    def _gains_step(self, kept: np.ndarray, values: int, e: np.ndarray, x: np.ndarray) -> Status:
        if len(kept) == values:
            return self._planned_step(e, x)
        K = self.content.row("gain", self.k).reshape(self.m, self.n)
        for c, place in enumerate(kept):
            x = x + K[place] * e[c]
        status = self._accept(x, self.type.type(0), 0)
        self.planned = self.planned and status != Status.OK
        return status

    def _accept(self, x: np.ndarray, nis: np.floating, dimension: int) -> Status:
        if not np.all(np.isfinite(x)):
            return Status.OVERFLOW
        self.x, self.nis, self.dimension = x, nis, dimension
        self.k += 1
        if self.k == self.content.plan.intervals and self.content.plan.again is not None:
            self.k, self.round = self.content.plan.again, self.round + 1
        return Status.OK

    def time_after(self, steps: int = 0) -> float:
        """Time of the estimate after so many more `steps`."""
        plan, at, rounds = self.content.plan, self.k + steps, self.round
        if plan.again is None:
            return float(plan.edges[min(at, plan.intervals)])
        if at >= plan.intervals:
            more, place = divmod(at - plan.again, plan.intervals - plan.again)
            at, rounds = plan.again + place, rounds + more
        return float(plan.edges[at]) + float(rounds) * float(plan.edges[-1] - plan.edges[plan.again])

    def _full_step(
        self, F: np.ndarray, H: np.ndarray, kept: np.ndarray, values: int, e: np.ndarray, x: np.ndarray
    ) -> Status:
        n, count = self.n, len(kept)
        size = values + n
        noise = _unit(self.content.row("noise_lower", self.k), size)
        place = np.append(kept, np.arange(values, size))
        pivot, lower = self.factor()
        a = np.concatenate((H, F))
        for i in range(1, n):
            a[:, :i] = a[:, :i] + a[:, i : i + 1] * lower[i, :i]
        a = np.concatenate((a, noise[place]), axis=1)
        weight = np.append(pivot, self.content.row("noise_pivot", self.k)[:size])
        return self._sweep(a, weight, n + place + 1, count, e, x)

    def _sweep(
        self, a: np.ndarray, weight: np.ndarray, columns: np.ndarray, count: int, e: np.ndarray, x: np.ndarray
    ) -> Status:
        status, x, nis, pivot, lower = self._swept(a, weight, columns, count, e, x)
        if status == Status.OK:
            status = self._accept(x, nis, count)
        if status == Status.OK:
            self.pivot, self.lower, self.planned = pivot, lower, False
        return status

    def _swept(
        self, a: np.ndarray, weight: np.ndarray, columns: np.ndarray, count: int, e: np.ndarray, x: np.ndarray
    ) -> tuple[Status, np.ndarray, np.floating, np.ndarray, np.ndarray]:
        """Rows of the values kept, then of the states, made orthogonal; see occ_sweep in templates/b_full.c.

        Returns the status, x, its nis, pivots and lower triangle.
        """
        n, nis = self.n, self.type.type(0)
        a, weight = (np.concatenate((part, np.zeros_like(part[..., :1])), axis=-1) for part in (a, weight))
        new_pivot, new_lower = np.zeros(n, dtype=self.type), np.eye(n, dtype=self.type)
        multiple, before = np.zeros(count + n, dtype=self.type), a[0].copy()
        for i in range(count + n):
            wide = slice(0, columns[i] + columns[i] % 2)
            a[i:, wide] = a[i:, wide] - multiple[i:, None] * before[wide]
            terms = (weight[wide] * a[i, wide]) * a[i:, wide]
            even, odd = (np.add.accumulate(terms[:, first::2], axis=1)[:, -1] + self.type.type(0) for first in (0, 1))
            total = even + odd
            left = total[0]
            if not np.isfinite(left):
                return Status.OVERFLOW, x, nis, new_pivot, new_lower
            inverse = self.type.type(1) / left if left >= np.finfo(self.type).tiny else self.type.type(0)
            if i < count and not inverse > 0:
                return Status.SINGULAR, x, nis, new_pivot, new_lower
            multiple[i + 1 :] = total[1:] * inverse
            if i < count:
                nis = nis + (e[i] * e[i]) * inverse
                e[i + 1 :] = e[i + 1 :] - multiple[i + 1 : count] * e[i]
                x = x + multiple[count:] * e[i]
            else:
                new_pivot[i - count] = left
                new_lower[i - count + 1 :, i - count] = multiple[i + 1 :]
            before = a[i].copy()
        status = Status.OK if np.all(np.isfinite(x)) else Status.OVERFLOW
        return status, x, nis, new_pivot, new_lower

    def foreseen(self) -> tuple[np.ndarray, np.ndarray]:
        """Values (m,) that the next ones should be near to, and about their deviations (m,)."""
        content, k = self.content, self.k
        count = int(content.table("values")[k])
        H = content.row("observe", k).reshape(self.n, self.m).T[:count]
        h = np.array([H[i] @ self.x + content.row("offset", k)[i] for i in range(count)])
        if self.plan:
            return h, np.sqrt(content.row("innovation_pivot", k)[:count])
        return h, np.sqrt(np.einsum("ij,jk,ik->i", H, self.covariance(), H))

    def covariance(self) -> np.ndarray:
        """(n, n) of the estimate."""
        pivot, lower = self.factor()
        P = np.empty((self.n, self.n), dtype=self.type)
        with np.errstate(all="ignore"):
            for i in range(self.n):
                for j in range(i + 1):
                    terms = (lower[i, : j + 1] * pivot[: j + 1]) * lower[j, : j + 1]
                    P[i, j] = P[j, i] = np.add.accumulate(terms)[-1] + self.type.type(0)
        return P

    def variance(self) -> np.ndarray:
        """(n,) of the estimate."""
        if not self.full:
            return self.content.row("planned_variance", self.k)
        pivot, lower = self.factor()
        total = np.zeros(self.n, dtype=self.type)
        with np.errstate(all="ignore"):
            for c in range(self.n):
                l = lower[c:, c]  # noqa: E741
                total[c:] = total[c:] + (l * pivot[c]) * l
            return total

    def predict(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The prediction (p,) and its variances (p,)."""
        content, k = self.content, self.k
        w, v = content.row("predict_offset", k).copy(), content.row("predict_variance", k).copy()
        D = content.row("predict_matrix", k).reshape(self.n, -1)
        with np.errstate(all="ignore"):
            for i in range(self.n):
                w = w + D[i] * self.x[i]
            if self.full:
                pivot, lower = self.factor()
                for c in range(self.n):
                    total = D[c].copy()
                    for i in range(c + 1, self.n):
                        total = total + D[i] * lower[i, c]
                    v = v + (total * pivot[c]) * total
        return w, v


def _unit(packed: np.ndarray, size: int) -> np.ndarray:
    """A unit lower triangle from what is below its diagonal, row by row."""
    lower = np.eye(size, dtype=packed.dtype)
    lower[np.tril_indices(size, -1)] = packed[: size * (size - 1) // 2]
    return lower
