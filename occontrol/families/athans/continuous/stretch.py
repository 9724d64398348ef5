"""A stretch of panels: the covariance at their ends, the costate and what the sensors would gain at their nodes.

Neighbouring panels whose lengths times norms sum to at most GROUP make one step of the square root of the covariance;
inside such a group everything follows from one linear equation, [x; y]' = H [x; y], whose transitions are well
conditioned there: the covariance from x = I, y = Sigma, the costate P = V' V from x = V', y = Sigma V'.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occontrol.families.athans.continuous.panels import Panels, PolicyData
from occontrol.numerics.gauss import NODES, gauss_nodes, integration_matrix
from occontrol.numerics.linalg import square_root
from occontrol.numerics.riccati_flow import (
    closed_loop,
    covariance_after,
    flow_series,
    fractional,
    march,
    norms,
    reduced_roots,
    term_count,
    transitions,
    values_at,
)

EPSILON = 2.2e-16
GROUP = 1.0
LARGEST_GROUP = 32
STRETCH_BYTES = 3e7


def stretch_length(data: PolicyData) -> int:
    """How many panels fit into STRETCH_BYTES."""
    matrices = 3 if data.constant else 2 * NODES
    if data.problem.running is not None:
        matrices += 3 * NODES
    return int(np.clip(STRETCH_BYTES / (8 * (2 * len(data.scale)) ** 2 * matrices), 1, 2048))


def grouped(sizes: np.ndarray, most: float) -> np.ndarray:
    """Place of each panel in its group: groups are neighbours with sizes (P,) that sum to at most `most`."""
    place, sum_of = np.zeros(len(sizes), dtype=int), 0.0
    for p, size in enumerate(sizes.tolist()):
        sum_of += size
        if p and sum_of <= most and place[p - 1] < LARGEST_GROUP - 1:
            place[p] = place[p - 1] + 1
        else:
            sum_of = size
    return place


def _gathered(data: PolicyData, panels: Panels, H: np.ndarray, begun: np.ndarray, firsts: np.ndarray) -> np.ndarray:
    """Gamma of the groups that begin at the panels `firsts`, (G, n, n): Gamma' Gamma = int F' L F dt, by rows."""
    nodes, rule = gauss_nodes()
    n = H.shape[-1] // 2
    terms = flow_series(H, begun[:, :, :n], term_count(np.max(norms(H), axis=0)))
    X = values_at(nodes, [t[:, :n] for t in terms])
    rows = data.information_roots(panels) * np.sqrt(panels.lengths[:, None] * rule)[..., None, None]
    rows = np.swapaxes(np.linalg.solve(X, np.swapaxes(rows, -1, -2)), -1, -2)
    found = []
    for first, end in zip(firsts, [*firsts[1:], len(panels)], strict=True):
        tall = np.concatenate([rows[first:end].reshape(-1, n), np.zeros((n, n))])
        found.append(np.linalg.qr(tall, mode="r"))
    return np.array(found)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Neighbouring panels of a policy and the flow along them, in balanced coordinates.

    Parameters
    ----------
    data : PolicyData
    panels : P of them
    H : (U, D, 2n, 2n) distinct polynomials length * H;  which : (P,) the one of each panel
    group : (P,) of G groups
    begun, ended : (P, 2n, 2n) transitions from the start of the group to start and end of each panel
    gamma : (G, n, n) of each group
    roots : (G+1, n, n) S at the starts of the groups and the end
    carry : (G, n, n) E of each group;  loop : (G, n, n) K of each group, see `march`
    rounding : (2, G) how far G and Q of a group may be off, in norm
    """

    data: PolicyData
    panels: Panels
    H: np.ndarray
    which: np.ndarray
    group: np.ndarray
    begun: np.ndarray
    ended: np.ndarray
    gamma: np.ndarray
    roots: np.ndarray
    carry: np.ndarray
    loop: np.ndarray
    rounding: np.ndarray

    @classmethod
    def of(cls, data: PolicyData, panels: Panels, root: np.ndarray, sharp: bool = False) -> Stretch:
        """The stretch that starts with the square root `root` (n, n) of the covariance.

        sharp : G is gathered from the rows of the sensors instead, so that what is hardly seen is known to all digits
        """
        chosen, which = data.distinct(panels)
        H = data.polynomials(chosen)
        step = transitions(H)[which]
        sizes = np.sum(norms(H), axis=1)[which]
        # inside a stiff transient a running cost needs the covariance of every panel from its own start
        # (none: a sum below zero, which even panels of size zero do not reach)
        place = grouped(sizes, GROUP if data.problem.running is None else -1.0)
        begun = np.empty_like(step)
        begun[place == 0] = np.eye(step.shape[-1])
        for k in range(1, int(np.max(place)) + 1):
            here = np.flatnonzero(place == k)
            begun[here] = step[here - 1]
            step[here] = step[here] @ step[here - 1]
        last = np.append(place[1:] == 0, True)
        F, G, Q = fractional(step[last])
        if sharp:
            gamma = _gathered(data, panels, H[which], begun, np.flatnonzero(place == 0))
        else:
            gamma = np.swapaxes(square_root(G), -1, -2)
        roots, carry, loop = march(root, F, gamma, Q)
        rounding = EPSILON * np.stack([norms(G) * (not sharp), norms(Q)])
        group = np.cumsum(place == 0) - 1
        return cls(data, panels, H, which, group, begun, step, gamma, roots, carry, loop, rounding)

    @property
    def size(self) -> float:
        """Bytes."""
        arrays = [self.H, self.begun, self.ended, self.gamma, self.roots, self.carry, self.loop]
        return sum(a.nbytes for a in [*arrays, *(self.inner if self.data.problem.running is not None else ())])

    def covariance_after(self, chosen: np.ndarray) -> np.ndarray:
        """The covariances (k, n, n) at the ends of the panels whose numbers are `chosen` (k,)."""
        F, G, Q = fractional(self.ended[chosen])
        return covariance_after(reduced_roots(self.roots[self.group[chosen]], G), F, Q)

    def stiffness(self) -> np.ndarray:
        """(P,) length * tr(Sigma L) at the start of each panel."""
        n = self.roots.shape[-1]
        S = self.roots[self.group]
        return np.einsum("pij,pik,pkj->p", S, self.H[self.which, 0, :n, n:], S, optimize=True)

    def back(self, costate: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Sigma V' at the nodes (P, NODES, n, p); S' V', V' (2, n, p) at the start from those at the end; rounding.

        The last is what rounding changes tr(V Sigma V') by: V Sigma dG Sigma V' at the start of a group, V dQ V' at its
        end, and g' (R' dR + dR' R) g for the factor R of I + S' G S, where |dR| <= 4 eps |Gamma| |S|.

        `costate` is V' (n, p) at the end.
        """
        n = self.roots.shape[-1]
        starts = np.empty((len(self.carry), 2 * n, costate.shape[-1]))
        g, v = costate
        ends, before = np.empty(len(starts)), np.empty((len(starts), *g.shape))
        for k in reversed(range(len(self.carry))):
            ends[k] = np.vdot(v, v)
            g, v = self.carry[k] @ g, self.loop[k].T @ v
            starts[k, :n], before[k] = v, g
        starts[:, n:] = self.roots[:-1] @ before
        after = starts[:, n:]
        seen = np.linalg.norm(self.gamma @ after, axis=(1, 2))
        # |Gamma| |S| state by state: one that nothing sees may be as large as it likes
        size = np.linalg.norm(self.gamma, axis=1) * np.linalg.norm(self.roots[:-1], axis=2)
        turned = np.sum(size, axis=1) * np.linalg.norm(before, axis=(1, 2))
        lost = self.rounding[0] @ np.linalg.norm(after, axis=(1, 2)) ** 2 + self.rounding[1] @ ends
        lost += 4 * EPSILON * (turned @ seen)
        begin = self.begun @ starts[self.group]
        count = term_count(np.max(norms(self.H), axis=0))
        terms = flow_series(self.H[self.which], begin, count)
        return values_at(gauss_nodes()[0], [t[:, n:] for t in terms]), np.stack([g, v]), float(lost)

    @cached_property
    def inner(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sigma, K and Y = Sigma K^-T at the nodes, (P, NODES, n, n) each; K from the start of the panel."""
        n = self.roots.shape[-1]
        count = term_count(np.max(norms(self.H), axis=0))
        identity = np.broadcast_to(np.eye(2 * n), (len(self.H), 2 * n, 2 * n))
        Z = values_at(gauss_nodes()[0], flow_series(self.H, identity, count))[self.which]
        F, G, Q = fractional(Z)
        S = self.roots[:-1, None]
        reduced = reduced_roots(S, G)
        sigma = covariance_after(reduced, F, Q)
        return sigma, closed_loop(reduced, F, G), Z[..., n:, :n] + Z[..., n:, n:] @ (S @ np.swapaxes(S, -1, -2))

    def running_rate(self) -> np.ndarray:
        """tr(R Sigma) at the nodes, (P, NODES)."""
        return np.sum(self.data.running(self.panels.node_times) * self.inner[0], axis=(2, 3))

    def running_back(self, costate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """X and Y, (P, NODES, n, n), with X Y' = Sigma P_R Sigma at the nodes, where -dP_R/dt = .. + R.

        `costate` (n, n), P_R at the end, is overwritten by P_R at the start. With K(t) the closed-loop transition from
        the start of a panel, Pi = K' P_R K obeys dPi/dt = -K' R K.
        """
        _, rule = gauss_nodes()
        _, K, Y = self.inner
        R = self.data.running(self.panels.node_times)
        density = self.panels.lengths[:, None, None, None] * (np.swapaxes(K, -1, -2) @ R @ K)
        flat = density.reshape(len(K), NODES, -1)
        pi = ((rule - integration_matrix()) @ flat).reshape(density.shape)
        whole = (rule @ flat).reshape(len(K), *costate.shape)
        for p in reversed(range(len(K))):
            later = self.loop[p].T @ costate @ self.loop[p]
            pi[p] += later
            costate[:] = later + whole[p]
        return Y @ pi, Y
