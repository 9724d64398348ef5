"""The extended Kalman filter of the target in Python, operation by operation as templates/b_move.c has it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from occontrol.files.export.flight.content import Content
from occontrol.files.export.flight.elementary import Elementary
from occontrol.files.export.flight.reference import ReferenceFilter, Status

AHEAD, SHARES = (0.0, 0.5, 0.5, 1.0), (1.0, 2.0, 2.0, 1.0)  # of the four slopes of a Runge-Kutta step


class FormulaReference(ReferenceFilter):
    """State and functions of the filter of a nonlinear plant.

    Parameters
    ----------
    content : Content with formulas
    """

    def __init__(self, content: Content):
        model = content.plan.formulas
        assert model is not None
        self.model, self.mathematics = model, Elementary(content.options.dtype)
        self._known: dict[tuple, tuple] = {}  # spans that were moved over before: replays begin alike
        super().__init__(content)

    @cached_property
    def _run(self) -> dict[str, Callable[[np.ndarray, np.floating], list[np.ndarray]]]:
        return {name: program.runner(self.content.options.dtype) for name, program in self.content.programs.items()}

    def _number(self, value: float) -> np.floating:
        return self.type.type(value)

    def _step(self, z: np.ndarray, kept: np.ndarray, values: int) -> Status:
        before = self.x, self.pivot, self.lower, self.nis, self.planned
        with np.errstate(all="ignore"):
            status = self._move(self.k)
            self.nis = self._number(0)
            if status == Status.OK and len(kept):
                h, slope, noise = self._expect(self.k)
                factor = _factorised(noise, self._spanned)
                e = z[kept] - h[kept]
                angle = self.content.row("angle", self.k)[kept] != 0 if self._angles else np.zeros(len(e), dtype=bool)
                pi, turn = self._number(np.pi), self._number(2 * np.pi)
                for i in np.flatnonzero(angle):
                    e[i] = e[i] - turn * self.mathematics.floor((e[i] + pi) / turn)
                a = np.zeros((len(kept) + self.n, self.n + values), dtype=self.type)
                a[: len(kept), : self.n] = self._times_factor(slope[kept])
                a[: len(kept), self.n :] = (np.tril(factor, -1) + np.eye(values, dtype=self.type))[kept]
                a[len(kept) :, : self.n] = self.lower
                weight = np.append(self.pivot, np.diag(factor))
                columns = np.append(self.n + kept + 1, np.full(self.n, self.n + values))
                status, self.x, self.nis, self.pivot, self.lower = self._swept(a, weight, columns, len(kept), e, self.x)
        if status != Status.OK:
            self.x, self.pivot, self.lower, self.nis, self.planned = before
            return status
        self.k, self.dimension, self.planned = self.k + 1, len(kept), False
        return status

    @property
    def _angles(self) -> bool:
        return "angles" in self.content.flags

    @property
    def _spanned(self) -> np.floating:
        return self._number(16 * np.finfo(self.type).eps)

    def _times_factor(self, rows: np.ndarray) -> np.ndarray:
        found = rows.copy()
        for i in range(1, self.n):
            found[:, :i] = found[:, :i] + rows[:, i : i + 1] * self.lower[i, :i]
        return found

    def _expect(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """h (m,), its slope (m, n) and the noise (m, m) of the readings at the end of interval k, at x."""
        plan, t = self.content.plan, self._number(self.content.table("edges")[k + 1, 0])
        m = sum(plan.rows[j] for j in plan.active[k])
        h, slope, noise = np.zeros(m), np.zeros((m, self.n)), np.zeros((m, m))
        h, slope, noise = (part.astype(self.type) for part in (h, slope, noise))
        first = 0
        for j in plan.active[k]:
            if plan.rows[j]:
                place = slice(first, first + plan.rows[j])
                own, slope[place], noise[place, place] = self._run[f"report_{j}"](self.x, t)
                h[place] = own[:, 0]
                first += plan.rows[j]
        return h, slope, noise

    def _move(self, k: int) -> Status:
        n, model = self.n, self.model
        since, length = (float(self.content.table(name)[k, 0]) for name in ("since", "lengths"))
        if not length > 0:
            return Status.OK
        key = k, self.x.tobytes(), self.pivot.tobytes(), self.lower.tobytes()
        if key in self._known:
            status, self.x, self.nis, self.pivot, self.lower = self._known[key]
            return status
        moved, q = self.lower.copy(), np.zeros((n, n), dtype=self.type)
        noisy = "noise" in self._run
        if model.discrete:
            t = self._number(since)
            if noisy:
                q = self._run["noise"](self.x, t)[0]
            right, slope = self._run["right"](self.x, t)
            self.x, moved = right[:, 0], _product(slope, moved)
        else:
            count = 2.0 * model.substeps
            h = self._number(length / count)
            third = h / self._number(3)
            for i in range(2 * model.substeps):
                t = self._number(since + (length * i) / count)
                if noisy:
                    share = self._number(4 if i % 2 else 2 if i else 1) * third
                    q = q + share * self._run["noise"](self.x, t)[0]
                slope = self._single_step(t, h)
                if noisy:
                    q = _symmetric(_product(_product(slope, q), slope.T))
                moved = _product(slope, moved)
            if noisy:
                q = q + third * self._run["noise"](self.x, self._number(since + (length * count) / count))[0]
        weight, columns = self.pivot, np.full(n, n)
        if noisy:
            q = _factorised(q, self._spanned)
            moved = np.hstack((moved, np.tril(q, -1) + np.eye(n, dtype=self.type)))
            weight, columns = np.append(weight, np.diag(q)), n + np.arange(n) + 1
        nothing = np.zeros(0, dtype=self.type)
        result = self._swept(moved, weight, columns, 0, nothing, self.x)
        self._known[key] = result
        status, self.x, self.nis, self.pivot, self.lower = result
        return status

    def _single_step(self, t: np.floating, h: np.floating) -> np.ndarray:
        n, one = self.n, self._number(1)
        f, total = np.zeros((2, n), dtype=self.type)
        change, slope = np.zeros((2, n, n), dtype=self.type)
        for ahead, share in zip(AHEAD, SHARES, strict=True):
            c = self._number(ahead) * h
            inner = c * change
            inner[range(n), range(n)] = inner[range(n), range(n)] + one
            right, jacobian = self._run["right"](self.x + c * f, t + c)
            f, change = right[:, 0], _product(jacobian, inner)
            total = total + self._number(share) * f
            slope = slope + self._number(share) * change
        self.x = self.x + (h / self._number(6)) * total
        slope = slope * (h / self._number(6))
        slope[range(n), range(n)] = slope[range(n), range(n)] + one
        return slope

    def predict(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The prediction (p,) and its variances (p,), the estimate moved on to that time; None beyond the numbers."""
        here = self.x, self.pivot, self.lower, self.nis
        with np.errstate(all="ignore"):
            status = Status.OK
            for k in range(self.k, self.model.last):
                status = self._move(k) if status == Status.OK else status
            found = super().predict() if status == Status.OK else None
        self.x, self.pivot, self.lower, self.nis = here
        return found

    def foreseen(self) -> tuple[np.ndarray, np.ndarray]:
        """Values (m,) that the next readings should be near to, and the deviations (m,) of their noise."""
        here = self.x, self.pivot, self.lower, self.nis
        with np.errstate(all="ignore"):
            self._move(self.k)
            h, _, noise = self._expect(self.k)
        self.x, self.pivot, self.lower, self.nis = here
        return h, np.sqrt(np.maximum(np.diag(noise), 0))


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a b (n, n), every sum from its first term to its last."""
    return np.add.accumulate(a[:, :, None] * b[None], axis=1)[:, -1] + a.dtype.type(0)


def _symmetric(a: np.ndarray) -> np.ndarray:
    """The matrix whose lower triangle is that of `a`."""
    return np.tril(a) + np.tril(a, -1).T


def _factorised(q: np.ndarray, spanned: np.floating) -> np.ndarray:
    """L below the diagonal and d on it, q = L diag(d) L'; see occ_factorise."""
    found, zero = q.copy(), q.dtype.type(0)
    for i in range(len(q)):
        for j in range(i + 1):
            left = q[i, j]
            for c in range(j):
                left = left - (found[i, c] * found[c, c]) * found[j, c]
            if i == j:
                found[i, i] = left if left > spanned * q[i, i] else zero
            else:
                found[i, j] = left / found[j, j] if found[j, j] > 0 else zero
    return found
