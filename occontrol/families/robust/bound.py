"""Lower bounds for robust switching, from the convex relaxation in which a slot may be shared between sensors.

N = (P^-1 - X)^-1 obeys an ordinary Kalman Riccati equation with A + BB'X, so N^-1 at the end is concave in N^-1 at any
earlier edge and in the shares v, and a size is convex in P^-1. One policy v, optimal or not, therefore gives at every
edge j a plane below the best size that is still within reach from there:
    V_j(N) >= c_j - <G_j, N^-1>
The policy comes from the common kernel and solver (scheduling/), on a split recursion; its
planes are then computed on the exact slots (complex-step derivatives), so the splitting error never enters a bound.
Unknown: v (N, M), rows in the simplex.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.robust.criteria import Smoothed, Supported
from occontrol.families.robust.game import ordinary_elements
from occontrol.families.robust.scattering import Element, advance, retreat
from occontrol.families.robust.slots import Slots
from occontrol.scheduling.feasible_set import FeasibleSet, IntervalPolytopes
from occontrol.scheduling.recursion import Recursion

STEP = 1e-30  # of the complex-step derivative
PANELS = 60  # split intervals for the first policy


@dataclass(frozen=True, eq=False)
class Plane:
    """V_j(N) >= constant[j] - <slope[j], N^-1> at the edges first .. N.

    Parameters
    ----------
    constant : (N+1,), -inf before the edge from which the plane holds
    slope : (N+1, n, n)
    """

    constant: np.ndarray
    slope: np.ndarray


def mixed_elements(slots: Slots, weights: np.ndarray, first: int = 0) -> Element:
    """Elements (N, M, n, n), complex: their real part is slot k under shares v_k, the imaginary one STEP d/dv_kj.

    `weights` v (N - first, M).
    """
    M, free = slots.sensors, slots.free
    directions = weights[first:, None, :] + 1j * STEP * np.eye(M)
    found = []
    for j in range(M):
        game = slots.spans.elements(np.ascontiguousarray(directions[:, j]), first)
        found.append(ordinary_elements(game, free[first:-1], free[first + 1 :]))
    return tuple(np.stack(parts, axis=1) for parts in zip(*found, strict=True))  # type: ignore[return-value]


@dataclass
class Walk:
    """A relaxed policy from one edge to the end: its size, gradient, and the path for its planes."""

    value: float
    gradient: np.ndarray
    ordinary: np.ndarray
    costate: np.ndarray


def walk(slots: Slots, weights: np.ndarray, start: np.ndarray, first: int = 0, power: float = np.inf) -> Walk:
    """Size at the end and its exact derivative in the shares.

    `weights` are the shares (N - first, M), `start` is N (n, n) at edge `first`. `power` picks the supporting function
    of a size with a kink, see `Size.support`.
    """
    return _walk(slots, weights, start, first, Supported(slots.size, slots.level, power))


def _walk(slots: Slots, weights: np.ndarray, start: np.ndarray, first: int, criterion: Smoothed | Supported) -> Walk:
    elements = mixed_elements(slots, weights, first)
    real = tuple(np.ascontiguousarray(np.real(part[:, 0])) for part in elements)
    count = slots.count - first
    N = np.empty((count + 1, *start.shape))
    N[0] = start
    slope = np.empty((count, slots.sensors, *start.shape))
    for k in range(count):
        after = advance(N[k], tuple(part[k] for part in elements))  # type: ignore[arg-type]
        slope[k] = np.imag(after) / STEP
        N[k + 1] = np.real(after[0])
    costate = np.empty_like(N)
    value, costate[-1] = criterion.linearised(N[-1])
    for k in range(count - 1, -1, -1):
        costate[k] = retreat(N[k], costate[k + 1], tuple(part[k] for part in real))  # type: ignore[arg-type]
    gradient = np.einsum("kij,kmij->km", costate[1:], slope)
    return Walk(value, gradient, N, costate)


def shares(slots: Slots, first: int = 0) -> IntervalPolytopes:
    """The policies (N - first, M) that share every slot from edge `first` on between the sensors."""
    return IntervalPolytopes(np.ones((slots.count - first, slots.sensors)), 1)


def plane_of(
    slots: Slots, weights: np.ndarray, path: Walk, first: int = 0, allowed: FeasibleSet | None = None
) -> Plane:
    """The plane of a walk: convexity in (N^-1, v) and the least that a pure choice can add in every slot.

    Parameters
    ----------
    slots, path, first : of the walk
    weights : (N - first, M), of the walk
    allowed : FeasibleSet of the choices (N - first, M) that the plane holds for; all of them if left out
    """
    count = slots.count
    cheapest = (allowed or shares(slots, first)).vertex(path.gradient)
    excess = np.sum(weights[first:] * path.gradient, axis=1) - np.sum(cheapest * path.gradient, axis=1)
    still = np.concatenate([np.cumsum(excess[::-1])[::-1], [0.0]])
    slope = path.ordinary @ path.costate @ path.ordinary
    constant = path.value - still + np.einsum("kij,kij->k", path.costate, path.ordinary)
    whole = Plane(np.full(count + 1, -np.inf), np.zeros((count + 1, *slope.shape[1:])))
    whole.constant[first:], whole.slope[first:] = constant, (slope + np.swapaxes(slope, 1, 2)) / 2
    return whole


@dataclass
class ExactSweep:
    """Size and gradient of shared slots from edge `first` on: an Objective for the relaxation's solver.

    Parameters
    ----------
    slots : Slots
    start : (n, n) N at edge `first`
    first : edge
    power : of the smoothed size, see `Size.smooth`
    """

    slots: Slots
    start: np.ndarray
    first: int = 0
    power: float = 64.0
    forward_count: int = field(default=0, init=False)
    backward_count: int = field(default=0, init=False)

    @property
    def shape(self) -> tuple[int, int]:
        """(N - first, M) of the policies."""
        return self.slots.count - self.first, self.slots.sensors

    @property
    def states(self) -> int:
        """n"""
        return len(self.start)

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """The size at the end and its gradient, (N - first, M), at `weights` (N - first, M)."""
        full = np.concatenate([np.zeros((self.first, self.slots.sensors)), weights])
        smoothed = Smoothed(self.slots.size, self.slots.level, self.power)
        path = _walk(self.slots, full, self.start, self.first, smoothed)
        self.backward_count += 1
        return path.value, path.gradient

    def cost(self, weights: np.ndarray) -> float:
        """The size at the end for `weights` (N - first, M)."""
        return self.cost_and_gradient(weights)[0]


def split_recursion(slots: Slots, terminal: np.ndarray, panels: int = PANELS) -> tuple[Recursion, int]:
    """The Recursion of the common kernel for N: predict with A + BB'X, update with each C_j, every slot in equal parts.

    Returns the Recursion and the number of parts of a slot.

    `terminal` is the weight (n, n) on N at the end.
    """
    parts = max(1, int(np.ceil(panels / slots.count)))
    n, M, flow = slots.start.shape[0], slots.sensors, slots.flow
    share = np.linspace(0, 1, 2 * parts + 1)[:-1]
    halves = np.append((slots.edges[:-1, None] + np.diff(slots.edges)[:, None] * share).ravel(), slots.edges[-1])
    F, Q, R = flow.elements(halves[:-1], halves[1:])
    X = _weights_at(halves, (F, Q, R))
    F, Q, _ = ordinary_elements((F, Q, R), X[:-1], X[1:])
    transition = np.concatenate([F[:1], F[2::2] @ F[1:-1:2], F[-1:]])
    noise = np.concatenate([Q[:1], F[2::2] @ Q[1:-1:2] @ np.swapaxes(F[2::2], 1, 2) + Q[2::2], Q[-1:]])
    middles = halves[1::2]
    count = len(middles)
    rows = np.concatenate([s.sample(middles) for s in flow.rows], axis=1)
    offsets = np.concatenate([[0], np.cumsum([s.shape[0] for s in flow.rows])]).astype(np.int64)
    recursion = Recursion(
        initial=slots.start,
        transition=np.ascontiguousarray(transition),
        noise=np.ascontiguousarray((noise + np.swapaxes(noise, 1, 2)) / 2),
        predict=np.arange(count + 1),
        rows=np.ascontiguousarray(rows),
        row_set=np.arange(count),
        offsets=offsets,
        steps=np.ascontiguousarray(halves[2::2] - halves[:-1:2]),
        cost=np.zeros((count, M)),
        running=np.zeros((0, n, n)),
        running_set=np.zeros(count, dtype=np.int64),
        terminal=terminal,
        available=np.ones((count, M)),
    )
    return recursion, parts


def _weights_at(times: np.ndarray, element: Element) -> np.ndarray:
    """X at a finer grid of times, by walking the sensor-free spans back from the end."""
    F, Q, R = element
    n = F.shape[-1]
    X = np.zeros((len(times), n, n))
    for k in range(len(times) - 2, -1, -1):
        X[k] = F[k].T @ X[k + 1] @ np.linalg.solve(np.eye(n) - Q[k] @ X[k + 1], F[k]) - R[k]
        X[k] = (X[k] + X[k].T) / 2
    return X


def relaxed_policy(slots: Slots, gap: float = 1e-5, monitor: Monitor | None = None) -> tuple[np.ndarray, Plane, float]:
    """A good shared policy v (N, M), its plane, and the lower bound that the plane gives at the start.

    Parameters
    ----------
    slots : Slots
    gap : relative target of the relaxation
    monitor : for interruption and time; it is told of no progress
    """
    from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
    from occontrol.scheduling.sweep import Sweep

    watch = (monitor or Monitor()).child(silent=True)
    M = slots.sensors
    v = np.full((slots.count, M), 1.0 / M)
    linear = slots.size.terms[0][0] == "trace" and len(slots.size.terms) == 1
    criterion = Smoothed(slots.size, slots.level, 8)
    N = _walk(slots, v, slots.start, 0, criterion).ordinary
    recursion, parts = split_recursion(slots, criterion.gradient(N[-1]))
    panels = IntervalPolytopes(recursion.available, 1)
    for _ in range(1 if linear else 2):
        outcome = minimise_relaxed(Sweep(recursion), panels, None, RelaxedOptions(1e-4, 400), watch)
        v = np.clip(outcome.weights.reshape(slots.count, parts, M).mean(axis=1), 0.0, 1.0)
        v /= np.sum(v, axis=1, keepdims=True)
        terminal = criterion.gradient(_walk(slots, v, slots.start, 0, criterion).ordinary[-1])
        recursion = replace(recursion, terminal=(terminal + terminal.T) / 2)
    best = _better(slots, v, np.inf, None)
    for power in (16.0, 128.0) if slots.size.has_kink else (np.inf,):
        sweep = ExactSweep(slots, slots.start, power=power)
        options = RelaxedOptions(gap, slots.spans.affordable(120))
        v = minimise_relaxed(sweep, shares(slots), v, options, watch).weights
        best = _better(slots, v, power, best)
    return best


def _better(slots: Slots, v: np.ndarray, power: float, best):
    path = walk(slots, v, slots.start, power=power)
    plane = plane_of(slots, v, path)
    bound = value_of(plane, 0, slots.start)
    return (v, plane, bound) if best is None or bound > best[2] else best


def value_of(plane: Plane, edge: int, ordinary: np.ndarray) -> float:
    """The plane's bound at one N, `ordinary` (n, n)."""
    return float(plane.constant[edge] - np.sum(plane.slope[edge] * np.linalg.inv(ordinary)))
