"""Independent re-integration of a finished policy in continuous time, with a bound that holds for all switching times.

It shares no numerics with the discretised recursion: exact linear fractional flows on adaptive Gauss panels
(numerics/riccati_flow.py), with the costate in the coordinates of a square root of the covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.schedule import Schedule
from occontrol.core.scheduling import SchedulingProblem
from occontrol.numerics.gauss import NODES, gauss_nodes, integration_matrix, tail
from occontrol.numerics.linalg import square_root
from occontrol.numerics.minimum_integral import minimum_integral
from occontrol.numerics.riccati_flow import closed_loop_transition, march
from occontrol.solvers.continuous_panels import Panels, PolicyData

ROUNDS = 6
CHUNK_BYTES = 6e7


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
    panels are halved until it is small) and by rtol |J| for everything else (data between the nodes, rounding).

    Parameters
    ----------
    problem : SchedulingProblem with n states, M sensors
    schedule : Schedule, edges (K+1,), weights (K, M), over the problem's horizon
    rtol : relative tolerance of cost and bound

    Returns
    -------
    ContinuousCheck

    Raises KeyError when the schedule lacks one of the problem's sensors.
    Athans (1971), equations (3.12), (4.1)-(4.4), (5.3), (5.4), (5.12); the bound is the relaxed problem's convexity.
    """
    data = PolicyData.of(problem, schedule)
    output, later_noise = data.prediction(rtol)
    panels = data.resolve(data.breaks(), rtol)
    if problem.running is not None:
        panels = _graded(data, panels)
    for remaining in reversed(range(ROUNDS)):
        sweep = _Sweep(data, panels, output)
        sweep.forward()
        cost = problem.cost_weight * sweep.observation_cost + sweep.running_cost + sweep.prediction_error
        sweep.backward()
        allowed = 0.1 * rtol * abs(cost)
        if np.sum(sweep.errors) <= allowed:
            break
        rough = (sweep.errors > 0.5 * allowed / len(panels)) & (panels.lengths > 1e-12 * problem.steps.sum())
        if not (remaining and np.any(rough)):
            break
        panels = panels.divide(1 + rough)
    room = data.room(panels)
    gained, _ = minimum_integral(panels.lengths, sweep.switching, room, problem.select, 0.1 * rtol * abs(cost))
    weights = np.einsum("pm,pim->pi", data.weights[panels.interval], sweep.switching)
    spent = float(panels.lengths @ weights @ gauss_nodes()[1])
    error = rtol * abs(cost) + float(np.sum(sweep.errors))
    return ContinuousCheck(
        cost=cost,
        lower_bound=cost - max(spent - gained, 0.0) - error,
        observation_cost=sweep.observation_cost,
        running_cost=sweep.running_cost,
        prediction_error=sweep.prediction_error,
        predicted_mean_square_error=sweep.prediction_error + later_noise,
        covariance_at_edges=sweep.covariance_at_edges,
        error=error,
    )


class _Sweep:
    """One pass forward (square root S of the covariance) and back (Psi = S' P_W S, and P_R of the running cost)."""

    def __init__(self, data: PolicyData, panels: Panels, output: np.ndarray):
        n, steps = len(data.scale), NODES + 1
        self.data, self.panels, self.output = data, panels, output
        per_panel = 8 * steps * (12 * n * n + 3 * n * len(data.weights[0]) + (2 * n) ** 2 * (1 if data.constant else 4))
        self.chunk = max(1, min(256, int(CHUNK_BYTES / per_panel)))
        self.firsts = list(range(0, len(panels), self.chunk))
        self.checkpoints: list[np.ndarray] = []
        self.kept: tuple | None = None

    def forward(self) -> None:
        """Covariance at the edges and the parts of the cost."""
        data, panels = self.data, self.panels
        problem = data.problem
        root = square_root(problem.plant.covariance / (data.scale * data.scale[:, None]))
        roots_at_edges = [root]
        self.running_cost, self.running_error = 0.0, np.zeros(len(panels))
        for first in self.firsts:
            self.checkpoints.append(root)
            part = panels[first : first + self.chunk]
            S, _, _ = self.kept = _chain(data, part, root)
            root = S[-1, -1]
            following = np.append(panels.interval, -1)[first + 1 : first + 1 + len(part)]
            roots_at_edges += list(S[following != part.interval, -1])
            if problem.running is not None:
                at_nodes = S[:, 1:-1]
                rate = np.sum((data.running(part.node_times) @ at_nodes) * at_nodes, axis=(2, 3))
                self.running_cost += float(part.lengths @ rate @ gauss_nodes()[1])
                self.running_error[first : first + len(part)] = part.lengths * tail(rate)
        edge = np.array(roots_at_edges) * data.scale[:, None]
        self.covariance_at_edges = edge @ np.swapaxes(edge, 1, 2)
        self.prediction_error = float(np.sum((self.output @ root) ** 2))
        charged = np.einsum("pm,pim->pi", data.weights[panels.interval], data.cost_rates(panels.node_times))
        self.cost_error = problem.cost_weight * panels.lengths * tail(charged)
        self.observation_cost = float(panels.lengths @ charged @ gauss_nodes()[1])
        self.final = root

    def backward(self) -> None:
        """Switching functions at the nodes (P, NODES, M) and the error of the bound by panel."""
        data, panels = self.data, self.panels
        problem = data.problem
        half = self.output @ self.final
        psi = half.T @ half
        costate = np.zeros_like(psi)
        self.switching = problem.cost_weight * data.cost_rates(panels.node_times)
        for index in reversed(range(len(self.firsts))):
            first = self.firsts[index]
            part = panels[first : first + self.chunk]
            if index < len(self.firsts) - 1:
                self.kept = _chain(data, part, self.checkpoints[index])
            assert self.kept is not None
            S, E, K = self.kept
            value = np.empty_like(S[:, 1:-1])
            for p in reversed(range(len(part))):
                for i in reversed(range(NODES)):
                    psi = E[p, i + 1] @ psi @ E[p, i + 1].T
                    value[p, i] = psi
                psi = E[p, 0] @ psi @ E[p, 0].T
            at_nodes = S[:, 1:-1]
            value = at_nodes @ value @ np.swapaxes(at_nodes, -1, -2)
            if K is not None:
                value += _running_part(data, part, S, K, costate)
            for j in range(len(problem.sensors)):
                white = data.whitened(j, part.node_times)
                self.switching[first : first + len(part), :, j] -= np.sum((white @ value) * white, axis=(2, 3))
        ripple = tail(self.switching)
        room = data.room(panels)
        weights = data.weights[panels.interval]
        bound = np.sum(weights * ripple, axis=1) + problem.select * np.max(np.where(room > 0, ripple, 0.0), axis=1)
        self.errors = panels.lengths * bound + self.cost_error + self.running_error


def _chain(data: PolicyData, panels: Panels, root: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """S at start, nodes and end (P, NODES+2, n, n), E of each step, and with a running cost K of each step."""
    F, gamma, driven = data.factors(panels)
    count, steps, n, _ = F.shape
    S, E = np.empty((count, steps + 1, n, n)), np.empty_like(F)
    for p in range(count):
        S[p, 0] = root
        march(S[p], E[p], np.ascontiguousarray(F[p]), np.ascontiguousarray(gamma[p]), np.ascontiguousarray(driven[p]))
        root = S[p, steps]
    if data.problem.running is None:
        return S, E, None
    before = S[:, :-1]
    return S, E, closed_loop_transition(before @ np.swapaxes(before, -1, -2), F, gamma)


def _running_part(data: PolicyData, panels: Panels, S: np.ndarray, K: np.ndarray, costate: np.ndarray) -> np.ndarray:
    """Sigma P_R Sigma at the nodes of a chunk; `costate`, P_R at its end, is overwritten by P_R at its start.

    With K(t) the closed-loop transition from the start of a panel, Pi = K' P_R K obeys dPi/dt = -K' R K.
    """
    _, rule = gauss_nodes()
    remaining = rule - integration_matrix()
    R = data.running(panels.node_times)
    total = np.empty_like(K)
    total[:, 0] = K[:, 0]
    for i in range(1, NODES + 1):
        total[:, i] = K[:, i] @ total[:, i - 1]
    at_nodes = total[:, :NODES]
    density = panels.lengths[:, None, None, None] * (np.swapaxes(at_nodes, -1, -2) @ R @ at_nodes)
    to_go = np.einsum("ij,pjab->piab", remaining, density, optimize=True)
    whole = np.einsum("j,pjab->pab", rule, density, optimize=True)
    pi = np.empty_like(to_go)
    for p in reversed(range(len(panels))):
        later = total[p, NODES].T @ costate @ total[p, NODES]
        pi[p] = later + to_go[p]
        costate[:] = later + whole[p]
    inverse = np.linalg.inv(at_nodes)
    covariance = S[:, 1:-1] @ np.swapaxes(S[:, 1:-1], -1, -2)
    half = inverse @ covariance
    return np.swapaxes(half, -1, -2) @ pi @ half


def _graded(data: PolicyData, panels: Panels) -> Panels:
    """Divide panels until length * tr(Sigma L) <= 1 at their start: a running cost is felt inside stiff transients."""
    root = square_root(data.problem.plant.covariance / (data.scale * data.scale[:, None]))
    finished: list[Panels] = []
    pending = [panels[k : k + 1] for k in reversed(range(len(panels)))]
    n, span = len(root), data.edges[-1] - data.edges[0]
    while pending:
        panel = pending.pop()
        information = data.matrices(panel)[0, 0, :n, n:]
        stiffness = panel.lengths[0] * np.sum((information @ root) * root)
        if stiffness > 1.0 and panel.lengths[0] > 1e-14 * span:
            halves = panel.divide(np.array([2]))
            pending += [halves[1:], halves[:1]]
            continue
        S, _, _ = _chain(data, panel, root)
        root = S[-1, -1]
        finished.append(panel)
    return Panels(*[np.concatenate([getattr(p, f) for p in finished]) for f in ("starts", "lengths", "interval")])
