"""What continuous sensing tells of constant parameters: the information of every sensor on every interval.

    L_kj = int over interval k of Phi' C_j' Theta_j^-1 C_j Phi dt,    Phi = Phi(t, t0)

by Gauss-Legendre panels, halved until the polynomials through their nodes are the rows Theta^-1/2 C Phi. An interval is
then a candidate as a reading is, and the switching function at any time within it follows from the same nodes:

    s_j(t) = alpha q_j(t) - tr(W F^-1 h' h F^-1),    h = Theta_j^-1/2 C_j(t) Phi(t, t0),    W = dphi/dS at F^-1
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from occontrol.core.signal import ConstantSignal
from occontrol.families.athans.continuous.minimum_integral import minimum_integral
from occontrol.families.athans.discretise import scaled_rows
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.gauss import NODES, gauss_nodes, tail
from occontrol.numerics.transition import transitions
from occontrol.scheduling.information import InformationObjective
from occontrol.scheduling.seen import Seen

SMOOTH = 1e-10  # of the largest entry: what the polynomials through the nodes may miss of the rows
DEEPEST, MOST_PANELS = 24, 60_000
TIGHT = 1e-9  # of the cost: what the bound in continuous time may hold back for kinks


@dataclass(frozen=True, eq=False)
class Watched:
    """A problem of continuous sensing as seen from its start, on P panels of Q nodes.

    Parameters
    ----------
    owner : (P,) the interval that each panel lies in
    lengths : (P,) of the panels
    rows : (P, Q, r, n) Theta^-1/2 C Phi of all sensors at the nodes, one below the other
    offsets : (M+1,) rows of sensor j are offsets[j]:offsets[j+1]
    rates : (P, Q, M) alpha q
    seen : Seen of the intervals
    across : (N+1, n, n) Phi(edge, t0)
    kept : (n, d) directions of the state at the start that `seen` is in terms of
    """

    owner: np.ndarray
    lengths: np.ndarray
    rows: np.ndarray
    offsets: np.ndarray
    rates: np.ndarray
    seen: Seen
    across: np.ndarray
    kept: np.ndarray

    @property
    def prices(self) -> np.ndarray:
        """(N, M) what a sensor costs on an interval."""
        over = self.lengths[:, None] * np.einsum("q,pqm->pm", gauss_nodes()[1], self.rates)
        prices = np.zeros((self.owner[-1] + 1, over.shape[1]))
        np.add.at(prices, self.owner, over)
        return prices

    def switching(self, objective: InformationObjective, weights: np.ndarray) -> np.ndarray:
        """(P, Q, M) the switching functions at the nodes.

        Parameters
        ----------
        objective : whose J it is, perhaps smoothed
        weights : (N, M) policy that sees every direction

        Raises ValueError for a policy that does not.
        """
        S = objective.design.covariance(weights)
        if S is None:
            raise ValueError("the policy leaves a direction unseen")
        G = S @ objective.criterion.gradient(S) @ S
        rows = self.rows @ self.kept
        told = np.einsum("pqri,ij,pqrj->pqr", rows, G, rows, optimize=True)
        saved = np.stack([np.sum(told[:, :, a:b], axis=2) for a, b in self._parts], axis=2)
        return self.rates - saved

    @property
    def _parts(self) -> list[tuple[int, int]]:
        return list(zip(self.offsets[:-1], self.offsets[1:], strict=True))

    def saved_between_edges(
        self, objective: InformationObjective, weights: np.ndarray, room: np.ndarray, select: float
    ) -> float:
        """By how much the bound of a policy falls for schedules that may change between the edges.

        min over schedules that change at the edges of int s.w dt, less that over all schedules

        Parameters
        ----------
        objective : whose tangent bounds, perhaps smoothed
        weights : (N, M) policy that sees every direction
        room : (N, M) the largest weights
        select : what the weights of an interval sum to
        """
        s = self.switching(objective, weights)
        over = self.lengths[:, None] * np.einsum("q,pqm->pm", gauss_nodes()[1], s)
        least = np.zeros((len(room), over.shape[1]))
        np.add.at(least, self.owner, over)
        # one panel an interval, of a constant: the minimum over schedules that change at the edges
        at_edges = minimum_integral(np.ones(len(room)), np.repeat(least[:, None], NODES, axis=1), room, select, 0.0)[0]
        size = float(np.sum(np.abs(over)))
        free, _ = minimum_integral(self.lengths, s, room[self.owner], select, TIGHT * size)
        missed = 2 * select * float(np.sum(self.lengths * np.max(tail(s), axis=1)))
        return max(at_edges - free, 0.0) + missed


def watched(problem: SchedulingProblem) -> Watched:
    """The information of every sensor on every interval of a problem, all directions kept.

    Parameters
    ----------
    problem : of continuous sensing without plant noise, N intervals
    """
    start, edges = float(problem.edges[0]), problem.elapsed
    kinks = [signal.breaks(start, float(problem.edges[-1])) for signal in problem.signals.values()]
    inside = np.concatenate([np.empty(0), *kinks]) - start
    cuts = np.unique(np.concatenate([edges, inside[(inside > 0) & (inside < edges[-1])]]))
    cuts = cuts[np.append(np.diff(cuts) > 1e-13 * edges[-1], True)]
    cuts = np.union1d(cuts, edges)
    nodes = gauss_nodes()[0]
    for depth in range(DEEPEST + 1):
        rows, rates, offsets, ends = _at_nodes(problem, cuts)
        flat = rows.reshape(len(rows), NODES, -1)
        size = np.max(np.abs(flat), axis=(0, 1), initial=0.0)
        rough = np.any(tail(flat) > SMOOTH * np.where(size > 0, size, 1.0), axis=1)
        rough |= np.any(tail(rates) > SMOOTH * max(float(np.max(np.abs(rates), initial=0.0)), 1e-300), axis=1)
        if not np.any(rough) or len(rough) + np.sum(rough) > MOST_PANELS or depth == DEEPEST:
            break
        cuts = np.union1d(cuts, (cuts[:-1] + cuts[1:])[rough] / 2)
    lengths = np.diff(cuts)
    owner = np.clip(np.searchsorted(edges, cuts[:-1] + lengths * nodes[0], side="right") - 1, 0, problem.intervals - 1)
    across = ends[np.searchsorted(cuts, edges)]
    at = float(problem.predict_at or problem.edges[-1])
    beyond, _ = transitions(problem.plant.A, _still(problem), edges[-1:], np.array([at - start]), start)
    last = beyond[0] @ across[-1]
    seen = Seen(_by_interval(rows, offsets, lengths, owner, problem.intervals), problem.output.at(at) @ last, last)
    return Watched(owner, lengths, rows, offsets, rates, seen, across, np.eye(problem.states))


def _still(problem: SchedulingProblem) -> ConstantSignal:
    return ConstantSignal(np.zeros((problem.states, problem.states)))


def _at_nodes(
    problem: SchedulingProblem, cuts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rows (P, Q, r, n), rates (P, Q, M), offsets (M+1,), and Phi (P+1, n, n) at the cuts."""
    P, n, start = len(cuts) - 1, problem.states, float(problem.edges[0])
    times = np.concatenate([(cuts[:-1, None] + np.diff(cuts)[:, None] * gauss_nodes()[0]), cuts[1:, None]], axis=1)
    times = np.concatenate([cuts[:1], times.ravel()])
    F, _ = transitions(problem.plant.A, _still(problem), times[:-1], times[1:], start)
    across = np.empty((len(times), n, n))
    across[0] = np.eye(n)
    for i, f in enumerate(F):
        across[i + 1] = f @ across[i]
    inner = across[1:].reshape(P, NODES + 1, n, n)
    at = start + times[1:].reshape(P, NODES + 1)[:, :-1].ravel()
    scaled, index, offsets = scaled_rows(problem.sensors, at)
    rows = scaled[index].reshape(P, NODES, -1, n) @ inner[:, :-1]
    rates = np.column_stack([s.cost.sample(at)[:, 0, 0] for s in problem.sensors]) * problem.cost_weight
    return rows, rates.reshape(P, NODES, -1), offsets, np.concatenate([across[:1], inner[:, -1]])


def _by_interval(
    rows: np.ndarray, offsets: np.ndarray, lengths: np.ndarray, owner: np.ndarray, intervals: int
) -> np.ndarray:
    """(N, M, n, n) rows whose products are the information of every interval and sensor."""
    n, weights = rows.shape[-1], np.sqrt(lengths[:, None] * gauss_nodes()[1])
    scaled = weights[:, :, None, None] * rows
    found = np.zeros((intervals, len(offsets) - 1, n, n))
    first = np.searchsorted(owner, np.arange(intervals + 1))
    for j, (a, b) in enumerate(itertools.pairwise(offsets)):
        if b == a:
            continue
        for k in range(intervals):
            stacked = scaled[first[k] : first[k + 1], :, a:b].reshape(-1, n)
            R = np.linalg.qr(stacked, mode="r")
            found[k, j, : len(R)] = R
    return found
