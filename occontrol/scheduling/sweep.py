"""The forward and backward sweep over a Recursion: cost and gradient of a policy.

Memory is O(K n^2) for K steps; above `memory_budget` bytes only every B-th covariance is kept and the rest recomputed.
A recursion of many states that falls into small blocks is swept block by block (scheduling/blocks).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from occontrol.scheduling import kernels, kernels_blas, kernels_blas_back
from occontrol.scheduling.blocks.components import SPLIT, block_sweep
from occontrol.scheduling.criterion import Criterion
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.vectors import padded, width

SMALL = 56  # states up to which the loops beat BLAS calls (scripts/bench.py measures where they cross)
MEMORY_BUDGET = 1_000_000_000


class Sweep:
    """Cost and gradient of policies v (N, M) on one Recursion, with all work space allocated once; an Objective.

        J(v) = sum_kj cost_kj v_kj + sum_k [a_k tr(R S-) + b_k tr(R S+)] + tr(W S_K),   a = b = h/2 in continuous time
        dJ/dv_kj = cost_kj - h_k tr(L_j S+ P+ S+)          summed over the steps k of a decision

    The gradient of a sensor that is not available is its cost alone.
    `forward_count` and `backward_count` count sweeps.

    Parameters
    ----------
    recursion : Recursion
    memory_budget : bytes for covariances
    small : states up to which the loops are used
    criterion : Criterion of S_K in the place of tr(W S_K); W(S_K) is then found anew for every gradient
    whole : never block by block
    """

    splits: ClassVar[bool] = True  # whether blocks that nothing couples may be swept by themselves

    def __init__(
        self,
        recursion: Recursion,
        memory_budget: int = MEMORY_BUDGET,
        small: int = SMALL,
        criterion: Criterion | None = None,
        whole: bool = False,
    ):
        r = self.recursion = recursion
        apart = self.splits and criterion is None and not whole and recursion.states >= SPLIT
        self.blocks = block_sweep(recursion) if apart else None
        self._at, self.gradient = np.empty((0, 0)), np.empty((0, 0))
        n, N, rows = r.states, len(r.steps), r.rows.shape[1]
        self.small = n <= small
        self.dense = len(r.running) > 0
        # rows padded with zeros for the loops; plain for BLAS
        lay = padded if self.small else np.ascontiguousarray
        self._n = n
        self._available = np.ascontiguousarray(r.on_steps(r.available), dtype=float)
        self._F, self._Q, self._R = lay(r.transition), lay(r.noise), lay(r.running)
        self._rows, w = lay(r.rows), width(n) if self.small else n
        self._S, self._T = np.zeros((n, w)), np.zeros((n, w))
        budget = max(1, int(memory_budget / (8 * n * w)))
        self._segment = N if budget >= N else max(int(np.ceil(np.sqrt(N))), int(np.ceil(2 * N / budget)))
        segments = int(np.ceil(N / self._segment))
        self._store = np.zeros((min(self._segment, N), n, w))
        self._checkpoints = np.zeros((segments if segments > 1 else 0, n, w))
        self._none = np.empty((0, n, w))
        self._criterion, self._last = criterion, (r.transition[r.predict[N]], r.noise[r.predict[N]])
        self._weigh(r.terminal if criterion is None else np.eye(n))
        if self.small:
            self._FT = padded(np.swapaxes(r.transition, 1, 2))
            self._work = (np.empty(w),)
        else:
            block, panel = kernels_blas.BLOCK, kernels_blas.panel_width(n)
            self._work = (
                panel, np.empty(n * n), np.empty(n * panel), np.empty(n * panel), np.empty((n, n)),
                *(np.empty((block, n)) for _ in range(3)),
            )  # fmt: skip
        if self.dense:
            self._rows_work = (np.empty(n), np.empty(n)) if self.small else (np.empty((rows, n)), np.empty((rows, n)))
        else:
            p = len(self._root)
            self._V = np.zeros((p, w))
            if self.small:
                self._U = np.empty((p, w))
                self._columns = padded(np.swapaxes(r.rows, 1, 2))
                self._rows_work = np.empty((p, w)), np.empty((p, width(rows)))
            else:
                self._U = np.empty((max(1, kernels_blas_back.WAITING // p) * p, n))
                self._rows_work = (
                    np.empty((rows, n)), np.empty((p, n)), np.empty(p * rows), np.empty(rows, dtype=np.int64),
                    np.empty(r.sensors, dtype=np.bool_), np.empty(len(self._U) * rows),
                )  # fmt: skip
        self._products = np.empty((0, rows, 1 if self.dense else len(self._root)))
        self.forward_count = self.backward_count = 0

    def _weigh(self, weight: np.ndarray) -> None:
        """Take W (n, n) as the weight of S_K: `terminal`, W before predict K, and its factor."""
        F, noise = self._last
        self.terminal = F.T @ weight @ F
        self._terminal_noise = float(np.sum(weight * noise))
        root = _factor(self.terminal)
        if self._criterion is not None:  # the rank may change from policy to policy, the work space may not
            root = np.concatenate([root, np.zeros((len(weight) - len(root), len(weight)))])
        self._root = root

    def _forward(self, k0: int, k1: int, weights: np.ndarray, store: np.ndarray) -> float:
        r = self.recursion
        tail = (
            r.predict, self._rows, r.row_set, r.offsets, r.steps, weights, self._R, r.running_set, r.charges, store,
        )  # fmt: skip
        if self.small:
            return kernels.forward_small(k0, k1, self._S, self._T, self._F, self._FT, self._Q, *tail, *self._work)
        return kernels_blas.forward_large(k0, k1, self._S, self._T, self._F, self._Q, *tail, *self._work)

    def _run_forward(self, weights: np.ndarray, keep: bool) -> float:
        """Forward over all intervals; leaves S+ of the last update in _S and returns the cost."""
        r, N, size = self.recursion, len(self.recursion.steps), self._segment
        self._S[:, : self._n] = r.initial
        running = 0.0
        for s, k0 in enumerate(range(0, N, size)):
            k1 = min(k0 + size, N)
            if keep and len(self._checkpoints):
                self._checkpoints[s] = self._S
            running += self._forward(k0, k1, weights, self._store if keep and k1 == N else self._none)
        self.forward_count += 1
        if self._criterion is not None:
            S = self._S[:, : self._n]
            F, noise = self._last
            self._final = F @ S @ F.T + noise
            return float(np.vdot(r.cost, weights)) + running + self._criterion.value(self._final)
        final = float(np.vdot(self.terminal, self._S[:, : self._n]))
        return float(np.vdot(r.cost, weights)) + running + final + self._terminal_noise

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, M); one forward sweep."""
        if self.blocks is not None:
            self.forward_count += 1
            return self.blocks.cost(weights)
        return self._run_forward(self._on_steps(weights), keep=False)

    def _on_steps(self, weights: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(self.recursion.on_steps(weights), dtype=float)

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy, `weights` (N, M); one forward and one backward sweep."""
        if self.blocks is not None:
            self.forward_count += 1
            self.backward_count += 1
            self._at = weights.copy()
            value, self.gradient = self.blocks.cost_and_gradient(weights)
            return value, self.gradient.copy()
        return self._dense_gradient(weights)

    def _dense_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        r, N, size = self.recursion, len(self.recursion.steps), self._segment
        weights = self._on_steps(weights)
        value = self._run_forward(weights, keep=True)
        self._turn()
        gradient = np.empty((N, r.sensors))
        if self.dense:
            P = padded(self.terminal) if self.small else self.terminal.copy()
        else:
            self._V[:, : self._n] = self._root
            P = self._V
        for s in range(int(np.ceil(N / size)) - 1, -1, -1):
            k0, k1 = s * size, min((s + 1) * size, N)
            if k1 < N:
                self._S[:] = self._checkpoints[s]
                self._forward(k0, k1, weights, self._store)
            self._backward(k0, k1, P, weights, gradient)
        self.backward_count += 1
        self.gradient = r.by_decision(gradient)
        return value, self.gradient

    def _turn(self) -> None:
        """Between forward and backward: what the costate begins with, where the policy decides that."""
        if self._criterion is not None:
            self._weigh(self._criterion.gradient(self._final))

    def _backward(self, k0: int, k1: int, P: np.ndarray, weights: np.ndarray, gradient: np.ndarray) -> None:
        r = self.recursion
        common = (r.row_set, r.offsets, r.steps, weights, self._available, r.cost)
        if self.dense:
            tail = (*common, self._R, r.running_set, r.charges, self._store, gradient, *self._rows_work)
            if self.small:
                front = (k0, k1, P, self._T, self._F, self._FT, r.predict, self._rows)
                kernels.backward_small_dense(*front, *tail)
            else:
                kernels_blas_back.backward_large_dense(k0, k1, P, self._T, self._F, r.predict, self._rows, *tail)
            return
        front = (k0, k1, P, self._U, self._F, r.predict, self._rows)
        tail = (*common, self._store, gradient, *self._rows_work, self._products)
        if self.small:
            kernels.backward_small(*front, self._columns, *tail)
        else:
            kernels_blas_back.backward_large(*front, *tail)

    @property
    def shape(self) -> tuple[int, int]:
        """(N, M) of the policies."""
        return self.recursion.intervals, self.recursion.sensors

    @property
    def states(self) -> int:
        """n"""
        return self.recursion.states

    @property
    def floor(self) -> float:
        """What no policy can cost less than: 0, or -inf where the criterion may be negative."""
        return -np.inf if self._criterion is not None and self._criterion.signed else 0.0

    @property
    def criterion_value(self) -> float:
        """The criterion's value at the last covariance of the last cost; 0 without a criterion."""
        return 0.0 if self._criterion is None else self._criterion.value(self._final)

    @property
    def smoothing_error(self) -> float:
        """What the last cost has to lose before its tangent bounds the true criterion."""
        return 0.0 if self._criterion is None else self._criterion.smoothing_error(self._final)

    @property
    def foresees_exchanges(self) -> bool:
        """Whether scheduling/exchange.py applies: W is given, a decision is one step, all covariances fit in memory."""
        return self._criterion is None and self.recursion.owner is None and self._segment >= len(self.recursion.steps)

    @property
    def root(self) -> np.ndarray | None:
        """V (p, n), V'V = W before the last predict; None under a criterion or where not all covariances are kept."""
        return None if self._criterion is not None or self._segment < len(self.recursion.steps) else self._root

    @property
    def constant(self) -> float:
        """tr(W Q) of the last predict."""
        return self._terminal_noise

    def onward(self, start: np.ndarray, k0: int, k1: int, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """The running cost of steps k0 .. k1-1, and S+ (n, n) after them.

        Parameters
        ----------
        start : (n, n) S+ before step k0
        k0, k1 : steps
        weights : (N, M)
        """
        self._S[:, : self._n] = start
        running = self._forward(k0, k1, self._on_steps(weights), self._none)
        return running, self._S[:, : self._n].copy()

    @property
    def exact_exchanges(self) -> bool:
        """Whether the foreseen effect of an exchange is exact, and not only the least that it saves."""
        return self.foresees_exchanges and (self.blocks is not None or not self.dense)

    def remember_products(self) -> None:
        """Make every later `cost_and_gradient` keep S+ and, without a running weight, G = C S+ V' of all rows."""
        if not self.dense and not len(self._products):
            r = self.recursion
            self._products = np.empty((len(r.steps), r.rows.shape[1], len(self._root)))

    @property
    def kept(self) -> tuple[np.ndarray, np.ndarray]:
        """S+ (K, n, at least n) and G (K, r, p) of the last `cost_and_gradient`; G after `remember_products`."""
        if self.blocks is not None and len(self._at):
            counts, at, self._at = (self.forward_count, self.backward_count), self._at, self._at[:0]
            self._dense_gradient(at)
            self.forward_count, self.backward_count = counts
        return self._store, self._products


def _factor(matrix: np.ndarray) -> np.ndarray:
    """V (p, n) with V'V = matrix (n, n), p its numerical rank, at least one row."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    kept = values > 1e-15 * max(values[-1], 0.0) * len(values)
    kept[-1] = True
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(np.maximum(values[kept], 0.0))).T)
