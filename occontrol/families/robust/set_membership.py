"""The set of all states that the measurements allow: its center, shape and level, from measured data.

Unknowns: center x (n,), inverse shape P^-1 (n, n), spent energy rho (a number). A state belongs to the set when
    (x - center)' P^-1 (x - center) <= d + rho
Measurements that are held between samples are taken in exactly: on a span with constant y, the least energy that leads
to a state is a quadratic form in (x - center, 1), and this form obeys the same game Riccati equation with one state
more; it is carried over the span by one span element, around the center of the span's start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.signal import Signal
from occontrol.families.robust.scattering import Flow


@dataclass(frozen=True, eq=False)
class PossibleStates:
    """An ellipsoid of possible states.

    Parameters
    ----------
    time : t
    center : (n,)
    inverse : (n, n) P^-1
    level : d + rho; negative when no admissible uncertainty explains the measurements

    Savkin, Evans & Skafidas, equations (6), (7).
    """

    time: float
    center: np.ndarray
    inverse: np.ndarray
    level: float

    @property
    def shape(self) -> np.ndarray:
        """P (n, n)."""
        P = np.linalg.inv(self.inverse)
        return (P + P.T) / 2

    @property
    def half_widths(self) -> np.ndarray:
        """(n,) how far the set reaches from the center along every coordinate."""
        return np.sqrt(np.maximum(self.level, 0.0) * np.diag(self.shape))

    def share(self, states: np.ndarray) -> np.ndarray:
        """(...,) (x - center)' P^-1 (x - center)/level of states (..., n): at most 1 inside."""
        away = states - self.center
        return np.einsum("...i,ij,...j->...", away, self.inverse, away) / self.level


@dataclass(frozen=True, eq=False)
class _Shifted(Signal):
    """A signal M(t) with the column M(t) c - r beside it (times `unit`), and a zero row below if asked for."""

    base: Signal
    center: np.ndarray
    offset: np.ndarray
    unit: float
    row: bool = False
    column: bool = True

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        m, n = self.base.shape
        return m + self.row, n + self.column

    @property
    def constant(self) -> bool:  # type: ignore[override]
        return self.base.constant

    def breaks(self, start: float, end: float) -> np.ndarray:
        return self.base.breaks(start, end)

    def sample(self, times: np.ndarray) -> np.ndarray:
        M = self.base.sample(times)
        if self.column:
            M = np.concatenate([M, ((M @ self.center - self.offset) * self.unit)[..., None]], axis=2)
        return np.concatenate([M, np.zeros((len(M), 1, M.shape[2]))], axis=1) if self.row else M


def initial_states(start: float, center: np.ndarray, weight: np.ndarray, level: float) -> PossibleStates:
    """The set before any measurement: `weight` X0 (n, n), `center` x0 (n,), level d."""
    return PossibleStates(start, np.asarray(center, dtype=float), np.asarray(weight, dtype=float), float(level))


def propagate(
    flow: Flow, states: PossibleStates, end: float, sensor: int | None, y: np.ndarray | None
) -> PossibleStates:
    """The set at `end` when one sensor reported the constant y (m,) since the set's own time.

    Parameters
    ----------
    flow : Flow of the plant and its sensors
    states : PossibleStates at the start of the span
    end : time
    sensor : its index, or None
    y : (m,) the value that was held, None when the sample is missing (then nothing is learnt from the span)

    Raises SolveFailed when the set becomes unbounded on the span.
    """
    n, c, t = flow.n, states.center, states.time
    used = sensor is not None and y is not None
    rows = [flow.rows[sensor]] if used else []  # type: ignore[index]
    targets = [np.asarray(y, dtype=float)] if used else []
    unit = 1.0 / _largest(flow, c, rows, targets, t, end)
    A = _Shifted(flow.A, c, np.zeros(n), unit, row=True)
    B = _Shifted(flow.B, c, np.zeros(n), unit, row=True, column=False)
    K = _Shifted(flow.K, c, np.zeros(flow.K.shape[0]), unit)
    C = [_Shifted(row, c, target, unit) for row, target in zip(rows, targets, strict=True)]
    form = np.zeros((n + 1, n + 1))
    form[:n, :n] = states.inverse
    form[n, n] = -states.level * unit**2  # the set is where the form is at most zero
    F, Q, R = Flow(A, B, K, C, flow.gain).element(t, end, 0 if used else None)
    back = np.linalg.inv(F)
    before = form + R
    form = back.T @ before @ np.linalg.solve(np.eye(n + 1) + back @ Q @ back.T @ before, back)
    inverse = (form[:n, :n] + form[:n, :n].T) / 2
    if np.linalg.eigvalsh(inverse)[0] <= 0:
        raise SolveFailed(f"the set of possible states becomes unbounded between t = {t:g} and {end:g}")
    cross = -(form[:n, n] + form[n, :n]) / 2 / unit
    move = np.linalg.solve(inverse, cross)
    return PossibleStates(end, c + move, inverse, float(cross @ move - form[n, n] / unit**2))


def _largest(flow: Flow, center: np.ndarray, rows, targets, start: float, end: float) -> float:
    """The size of what drives the center on the span: the unit of the extra state."""
    at = np.array([start, end])
    sizes = [np.max(np.abs(signal.sample(at) @ center), initial=0.0) for signal in (flow.A, flow.K)]
    sizes += [np.max(np.abs(row.sample(at) @ center - y), initial=0.0) for row, y in zip(rows, targets, strict=True)]
    return float(max(*sizes, 1e-150))
