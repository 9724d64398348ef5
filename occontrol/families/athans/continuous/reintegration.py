"""Independent re-integration of a finished policy in continuous time, with a bound that holds for all switching times.

It shares no numerics with the discretised recursion: exact linear fractional flows on adaptive Gauss panels
(numerics/riccati_flow.py, a stretch of panels at a time in families/athans/continuous/stretch.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.schedule import Schedule
from occontrol.families.athans.continuous.minimum_integral import minimum_integral
from occontrol.families.athans.continuous.panels import Panels, PolicyData
from occontrol.families.athans.continuous.parts import Part, parts_of, together
from occontrol.families.athans.continuous.stretch import Stretch, stretch_length
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.gauss import gauss_nodes, legendre_coefficients, tail
from occontrol.numerics.linalg import square_root

ROUNDS = 6
KEPT_BYTES = 3e8
RESOLVED = 1e-9  # of the largest switching function


@dataclass(frozen=True, eq=False)
class ContinuousCheck:
    """What a policy costs in continuous time, and a lower bound for every schedule.

    Parameters
    ----------
    cost : cost_weight * observation_cost + running_cost + prediction_error
    lower_bound : no schedule, whatever its switching times, costs less; already lowered by `error`
    observation_cost : int sum_j q_j v_j dt
    running_cost : int tr(R Sigma) dt
    prediction_error : tr(W Sigma(T))
    predicted_mean_square_error : prediction_error plus the plant noise between T and Tp
    covariance_at_edges : (K+1, n, n) at the edges of the schedule
    error : allowance for the numerical errors of cost and bound, in cost units
    """

    cost: float
    lower_bound: float
    observation_cost: float
    running_cost: float
    prediction_error: float
    predicted_mean_square_error: float
    covariance_at_edges: np.ndarray
    error: float

    @property
    def relative_gap(self) -> float:
        """(cost - lower_bound)/|cost|; 0 when both vanish."""
        gap = self.cost - self.lower_bound
        return gap / abs(self.cost) if self.cost else (0.0 if gap == 0 else float("inf"))


def reintegrate(problem: SchedulingProblem, schedule: Schedule, rtol: float = 1e-9) -> ContinuousCheck:
    """Integrate covariance and costate along a policy, fractional or not, and bound the optimum from what they say.

    J* >= J(v) - int [sum_j v_j s_j - min_{w in V(t)} sum_j w_j s_j] dt,   s_j = alpha q_j - tr(L_j Sigma P Sigma)

    V(t) are the weights that the windows, open in continuous time, allow at t. On every panel the s_j are replaced by
    the polynomials through their Gauss nodes; the minimum of those is integrated from below (see `minimum_integral`).
    The bound is lowered by the estimated distance between s_j and its polynomial (decay of the Legendre coefficients;
    panels are halved until it is small), by an estimate of what rounding does to the covariance (with a large prior
    and a sharp sensor), and by rtol |J| for everything else (data between the nodes).

    Parameters
    ----------
    problem : SchedulingProblem with n states, M sensors
    schedule : Schedule, edges (K+1,), weights (K, M), over the problem's horizon
    rtol : relative tolerance of cost and bound

    Returns
    -------
    ContinuousCheck

    Raises KeyError when the schedule lacks one of the problem's sensors, SolveFailed where the numbers overflow or the
    horizon is too long for the fastest rate of the data.
    Athans (1971), equations (3.12), (4.1)-(4.4), (5.3), (5.4), (5.12); the bound is the relaxed problem's convexity.
    """
    data = PolicyData.of(problem, schedule)
    everything = Part(data, np.arange(problem.states), np.arange(len(problem.sensors)))
    parts = parts_of(problem, schedule) or [everything]
    split = len(parts) > 1
    outputs, later_noise = zip(*(part.data.prediction(rtol) for part in parts), strict=True)
    panels = [_resolved(part.data, output, rtol) for part, output in zip(parts, outputs, strict=True)]
    sweeps: list[_Sweep | None] = [None] * len(parts)
    prices = _Prices(data, data.breaks()) if split else None
    sharp = False
    for remaining in reversed(range(ROUNDS)):
        for i, part in enumerate(parts):
            if sweeps[i] is None:
                sweep = sweeps[i] = _Sweep(part.data, panels[i], outputs[i], sharp)
                sweep.forward()
                sweep.backward()
        done: list[_Sweep | _Prices] = [s for s in (*sweeps, prices) if s is not None]
        observation, running, predicted, rounding = (
            sum(getattr(s, name) for s in done)
            for name in ("observation_cost", "running_cost", "prediction_error", "rounding")
        )
        cost = problem.cost_weight * observation + running + predicted
        errors, count = sum(float(np.sum(s.errors)) for s in done), sum(len(s.panels) for s in done)
        allowed = 0.1 * rtol * abs(cost)
        blunt = not sharp and rounding > allowed
        shortest = 1e-12 * problem.steps.sum()
        rough = [(s.errors > 0.5 * allowed / count) & (s.panels.lengths > shortest) & (errors > allowed) for s in done]
        if not (remaining and (blunt or any(np.any(r) for r in rough))):
            break
        sharp = sharp or blunt
        for i in range(len(parts)):
            if blunt or np.any(rough[i]):
                panels[i], sweeps[i] = panels[i].divide(1 + rough[i]), None
        if prices is not None and np.any(rough[-1]):
            prices = _Prices(data, prices.panels.divide(1 + rough[-1]))
    columns = [*(part.columns for part in parts), everything.columns][: len(done)]
    given = [(s.panels, s.switching, c) for s, c in zip(done, columns, strict=True)]
    common, switching = together(data.edges, len(problem.sensors), given) if split else (panels[0], done[0].switching)
    if not np.all(np.isfinite([cost, rounding, errors, np.sum(switching)])):
        raise SolveFailed(
            "the check in continuous time overflowed: the covariance leaves the range of floating-point numbers\n"
            "  hint: an unstable plant that is not measured over a long horizon does that"
        )
    room, limit = data.room(common), 0.1 * rtol * abs(cost)
    gained, _ = minimum_integral(common.lengths, switching, room, problem.select, limit)
    weights = np.einsum("pm,pim->pi", data.weights[common.interval], switching)
    spent = float(common.lengths @ weights @ gauss_nodes()[1])
    error = rtol * abs(cost) + errors + rounding
    covariance = np.zeros((len(data.edges), problem.states, problem.states))
    for part, sweep in zip(parts, sweeps, strict=True):
        covariance[:, part.states[:, None], part.states] = sweep.covariance_at_edges if sweep is not None else np.nan
    return ContinuousCheck(
        cost=cost,
        lower_bound=cost - max(spent - gained, 0.0) - error,
        observation_cost=observation,
        running_cost=running,
        prediction_error=predicted,
        predicted_mean_square_error=predicted + sum(later_noise),
        covariance_at_edges=covariance,
        error=error,
    )


def switching_at_edges(problem: SchedulingProblem, schedule: Schedule, rtol: float = 1e-9) -> tuple[float, np.ndarray]:
    """J of a policy and the switching functions s_j (K+1, M) at its edges, by the same flow.

    Parameters
    ----------
    problem : SchedulingProblem with M sensors
    schedule : Schedule, edges (K+1,), weights (K, M), over the problem's horizon
    rtol : relative tolerance of what is integrated

    Raises KeyError when the schedule lacks one of the problem's sensors, SolveFailed where the numbers overflow.
    """
    data = PolicyData.of(problem, schedule)
    output, _ = data.prediction(rtol)
    panels = _resolved(data, output, rtol)
    for remaining in reversed(range(ROUNDS)):
        sweep = _Sweep(data, panels, output)
        sweep.forward()
        cost = problem.cost_weight * sweep.observation_cost + sweep.running_cost + sweep.prediction_error
        sweep.backward()
        if not np.all(np.isfinite([cost, np.sum(sweep.switching)])):
            raise SolveFailed("the flow along the schedule overflowed")
        # here the values at the ends of the panels count, so every panel has to resolve them
        rough = np.max(tail(sweep.switching), axis=1) > RESOLVED * np.max(np.abs(sweep.switching))
        rough &= panels.lengths > 1e-12 * problem.steps.sum()
        if not remaining or not np.any(rough):
            break
        panels = panels.divide(1 + rough)
    # the polynomials through the nodes, at the ends of the first panel of every interval and of the last one
    left = np.append(True, panels.interval[1:] != panels.interval[:-1])
    coefficients = legendre_coefficients(sweep.switching)
    begins = np.einsum("pcm,c->pm", coefficients[left], (-1.0) ** np.arange(coefficients.shape[1]))
    ends = np.sum(coefficients[-1:], axis=1)
    return cost, np.concatenate([begins, ends])


class _Sweep:
    """One pass forward (covariance) and back (costate), stretch by stretch; what fits into memory is computed once."""

    def __init__(self, data: PolicyData, panels: Panels, output: np.ndarray, sharp: bool = False):
        self.data, self.panels, self.output, self.sharp = data, panels, output, sharp
        self.room = data.room(panels)
        length = stretch_length(data)
        self.parts = [slice(first, first + length) for first in range(0, len(panels), length)]
        self.roots: list[np.ndarray] = []
        self.kept: list[Stretch | None] = []

    def stretches(self, keep: bool = True) -> Iterator[Stretch]:
        """All stretches from the start on; with `keep` the last one stays, and the others while there is room."""
        root, size = square_root(self.data.problem.plant.covariance / np.outer(self.data.scale, self.data.scale)), 0.0
        for part in self.parts:
            stretch = Stretch.of(self.data, self.panels[part], root, self.sharp)
            if keep and size + stretch.size > KEPT_BYTES:
                self.kept[:], size = [None] * len(self.kept), 0.0
            if keep:
                size += stretch.size
                self.kept.append(stretch)
                self.roots.append(root)
            root = stretch.roots[-1]
            yield stretch
        self.final = root

    def forward(self) -> None:
        """Covariance at the edges and the parts of the cost."""
        data, panels = self.data, self.panels
        problem, (_, rule) = data.problem, gauss_nodes()
        at_edge = np.append(panels.interval[1:] != panels.interval[:-1], True)
        covariances = [problem.plant.covariance[None]]
        self.running_cost, self.running_error = 0.0, np.zeros(len(panels))
        for part, stretch in zip(self.parts, self.stretches(), strict=True):
            covariances.append(stretch.covariance_after(np.flatnonzero(at_edge[part])))
            if problem.running is not None:
                rate = stretch.running_rate()
                self.running_cost += float(stretch.panels.lengths @ rate @ rule)
                self.running_error[part] = stretch.panels.lengths * tail(rate)
        covariances[1:] = [c * np.outer(data.scale, data.scale) for c in covariances[1:]]
        self.covariance_at_edges = np.concatenate(covariances)
        self.prediction_error = float(np.sum((self.output @ self.final) ** 2))
        self.rates = data.cost_rates(panels.node_times)
        charged = np.einsum("pm,pim->pi", data.weights[panels.interval], self.rates)
        self.cost_error = problem.cost_weight * panels.lengths * tail(charged)
        self.observation_cost = float(panels.lengths @ charged @ rule)

    def backward(self) -> None:
        """Switching functions at the nodes (P, NODES, M) and the error of the bound by panel."""
        data, panels = self.data, self.panels
        problem = data.problem
        # the costate of the predicted error: S' V' and V'
        costate = np.stack([self.final.T @ self.output.T, self.output.T])
        accumulated = np.zeros((problem.states, problem.states))
        self.switching, self.rounding = problem.cost_weight * self.rates, 0.0
        for index in reversed(range(len(self.parts))):
            part = self.parts[index]
            stretch = self.kept.pop() or Stretch.of(data, panels[part], self.roots[index], self.sharp)
            usable = self.room[part] > 0
            seen, costate, lost = stretch.back(costate)
            self.rounding += lost
            self.switching[part] -= data.gains(stretch.panels, usable, seen, seen)
            if problem.running is not None:
                left, right = stretch.running_back(accumulated)
                self.switching[part] -= data.gains(stretch.panels, usable, left, right)
        bound = _doubt(data, panels, tail(self.switching))
        self.errors = panels.lengths * bound + self.cost_error + self.running_error


class _Prices:
    """What sensors cost, where parts of the plant are integrated by themselves; read like a _Sweep."""

    running_cost = prediction_error = rounding = 0.0

    def __init__(self, data: PolicyData, panels: Panels):
        problem, self.panels = data.problem, panels
        rates, weights = data.cost_rates(panels.node_times), data.weights[panels.interval]
        charged = np.einsum("pm,pim->pi", weights, rates)
        self.observation_cost = float(panels.lengths @ charged @ gauss_nodes()[1])
        self.switching = problem.cost_weight * rates
        self.errors = panels.lengths * (problem.cost_weight * tail(charged))
        self.errors += panels.lengths * _doubt(data, panels, tail(self.switching))


def _doubt(data: PolicyData, panels: Panels, ripple: np.ndarray) -> np.ndarray:
    """(P,) how far switching functions that are off by `ripple` (P, M) may move the rate of the bound."""
    most = np.max(np.where(data.room(panels) > 0, ripple, 0.0), axis=1)
    return np.sum(data.weights[panels.interval] * ripple, axis=1) + data.problem.select * most


def _resolved(data: PolicyData, output: np.ndarray, rtol: float) -> Panels:
    """Panels that resolve the data, and with a running weight stiff transients, too."""
    panels = data.resolve(data.breaks(), rtol)
    return panels if data.problem.running is None else _graded(data, panels, output)


def _graded(data: PolicyData, panels: Panels, output: np.ndarray) -> Panels:
    """Divide panels until length * tr(Sigma L) <= 1 at their start: a running cost is felt inside stiff transients.

    What Sigma was at the start decays as 1/t, so a panel is cut into pieces each as long as all before it together.
    """
    shortest = 1e-14 * (data.edges[-1] - data.edges[0])
    while True:
        stiffness = np.concatenate([s.stiffness() for s in _Sweep(data, panels, output).stretches(keep=False)])
        if not np.all(np.isfinite(stiffness)):
            return panels
        pieces = np.ceil(np.log2(np.clip(stiffness, 1.0, 2.0**40))).astype(int)
        pieces = np.where(panels.lengths > shortest, pieces, 0)
        if not np.any(pieces):
            return panels
        place = np.concatenate([np.arange(k + 1) for k in pieces])
        index = np.repeat(np.arange(len(panels)), pieces + 1)
        ends = panels.lengths[index] * 2.0 ** (place - pieces[index])
        begins = np.where(place == 0, 0.0, ends / 2)
        panels = Panels(panels.starts[index] + begins, ends - begins, panels.interval[index])
