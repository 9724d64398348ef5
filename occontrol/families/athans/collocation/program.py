"""The nonlinear program of the collocation on one mesh.

Unknowns, in this order: the weights v_k (M) of the intervals; then element by element the packed covariances at the s
collocation points (Radau IIA: the last one is the end of the element) and, for Gauss-Legendre, at the end; in the
information form their inverses. Element e has its own coordinates x = D_e x^, D_e D_e' = the covariance that a
simulated policy has at its end, so that all unknowns are near the identity. Constraints: per element the Runge-Kutta
equations of the packed rate dSigma/dt = dH/dP (CasADi's AD of the Hamiltonian, which keeps its form in any
coordinates), then sum_j v_kj = select.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.kinds import Casadi, CasadiFunction, CasadiSparsity
from occontrol.core.monitor import Monitor
from occontrol.families.athans.collocation.mesh import Mesh
from occontrol.families.athans.hamiltonian import canonical_equations, information_rates
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.linalg import symmetrise, triangle_weights, unvech, vech
from occontrol.numerics.nlp import IpoptOptions, NlpOutcome, Program, solve_nlp


class Transcription:
    """The nonlinear program of one mesh."""

    def __init__(self, problem: SchedulingProblem, table: tuple, mesh: Mesh, terminal: np.ndarray, information: bool):
        """`terminal` is W (n, n)."""
        self.problem, self.table, self.mesh, self.terminal = problem, table, mesh, terminal
        self.information = information
        n, self.elements = problem.states, len(mesh.starts)
        self.packed = n * (n + 1) // 2
        self.stages = len(table[2])
        self.ends_apart = bool(table[2][-1] < 1.0)
        self.unknown = self.stages + self.ends_apart  # packed covariances of one element
        self.frames = frames(mesh.ends[1:])
        self.inverses = np.linalg.inv(self.frames)

    def _element(self) -> CasadiFunction:
        """Residuals (packed, unknown) and cost of one element, from the symbolic Hamiltonian."""
        import casadi

        A_rk, b, _ = self.table
        n, m, s, p = self.problem.states, len(self.problem.sensors), self.stages, self.packed
        canonical = canonical_equations(n, m)
        before, inner = casadi.SX.sym("before", p), casadi.SX.sym("inner", p, self.unknown)
        turn, v, h = casadi.SX.sym("turn", n, n), casadi.SX.sym("v", m), casadi.SX.sym("h")
        first = vech(turn @ unvech(before) @ turn.T)
        alpha = self.problem.cost_weight
        A, noise = casadi.SX.sym("A", n, n * s), casadi.SX.sym("Xi", n, n * s)
        rates, costs = casadi.SX.sym("L", n, n * m * s), casadi.SX.sym("q", m, s)
        running = casadi.SX.sym("R", n, n * s)
        slopes, cost = [], 0
        nothing = casadi.SX.zeros(n, n)
        for i in range(s):
            state, block = unvech(inner[:, i]), slice(n * i, n * (i + 1))
            L = rates[:, n * m * i : n * m * (i + 1)]
            if self.information:
                # Riccati duality: the inverse obeys the same equation with -A', L(v), Xi in the places of A, Xi, L
                total = sum((v[j] * L[:, n * j : n * (j + 1)] for j in range(m)), nothing)
                swapped = {"A": -A[:, block].T, "noise": total, "rates": noise[:, block], "weights": 1, "costs": 0}
                dual = canonical_equations(n, 1)
                found = dual(covariance=state, costate=nothing, cost_weight=0, running=nothing, **swapped)
                slopes.append(vech(found["covariance_rate"]))
                state = casadi.solve(state, casadi.SX.eye(n)) if self.problem.running is not None else nothing
            found = canonical(
                covariance=state,
                costate=nothing,
                weights=v,
                A=A[:, block],
                noise=noise[:, block],
                rates=L,
                costs=costs[:, i],
                cost_weight=alpha,
                running=running[:, block],
            )
            if not self.information:
                slopes.append(vech(found["covariance_rate"]))
            # with P = 0 the Hamiltonian is the integrand of the cost
            cost += h * b[i] * found["hamiltonian"]
        residuals = [inner[:, i] - first - h * sum(A_rk[i, j] * slopes[j] for j in range(s)) for i in range(s)]
        if self.ends_apart:
            residuals.append(inner[:, s] - first - h * sum(b[j] * slopes[j] for j in range(s)))
        inputs = [before, inner, turn, v, h, A, noise, rates, costs, running]
        varies = [x is before or x is inner or x is v for x in inputs]  # no derivatives by the data
        outputs = [casadi.horzcat(*residuals), cost]
        return casadi.Function("element", inputs, outputs, {"is_diff_in": varies})

    def _parameters(self) -> list[np.ndarray]:
        """The numeric inputs h, A, Xi, L, q, R of all elements side by side."""
        problem, n, s, E = self.problem, self.problem.states, self.stages, self.elements
        times = self.mesh.times(self.table[2]).ravel()

        def beside(values: np.ndarray) -> np.ndarray:  # (E s, n, k) -> (n, E s k)
            return np.ascontiguousarray(np.moveaxis(values, 1, 0)).reshape(values.shape[1], -1)

        D, inverse = (np.repeat(x, s, axis=0) for x in (self.frames, self.inverses))
        white = [information_rates(x.C.sample(times) @ D, x.noise.sample(times)) for x in problem.sensors]
        rates = np.moveaxis(np.stack(white, axis=1), 1, 2).reshape(E * s, n, -1)  # L_1 .. L_M side by side
        costs = np.stack([x.cost.sample(times)[:, 0, 0] for x in problem.sensors])
        running = np.zeros((E * s, n, n)) if problem.running is None else problem.running.sample(times)
        drift = inverse @ problem.plant.A.sample(times) @ D
        noise = inverse @ problem.plant.noise.sample(times) @ np.swapaxes(inverse, 1, 2)
        running = np.swapaxes(D, 1, 2) @ running @ D
        return [self.mesh.lengths[None], *map(beside, (drift, noise, rates)), costs, beside(running)]

    def solve(self, weights: np.ndarray, options: IpoptOptions, monitor: Monitor, unit: float) -> NlpOutcome:
        """Ipopt from the mesh's simulated covariance and `weights` (N, M).

        Parameters
        ----------
        weights : (N, M)
        options : IpoptOptions
        monitor : Monitor
        unit : a typical share of one interval in the cost
        """
        import casadi

        problem, E, p = self.problem, self.elements, self.packed
        N, M = weights.shape
        x = casadi.MX.sym("x", M * N + p * self.unknown * E)
        v, y = casadi.reshape(x[: M * N], M, N), casadi.reshape(x[M * N :], p, self.unknown * E)
        last = y[:, self.unknown - 1 :: self.unknown]
        identity = np.eye(problem.states)[None]
        initial = problem.plant.covariance
        if self.information:
            initial = np.linalg.inv(initial)
            turns = np.swapaxes(np.concatenate([identity, self.inverses[:-1]]) @ self.frames, 1, 2)
        else:
            turns = self.inverses @ np.concatenate([identity, self.frames[:-1]])
        first = casadi.DM(vech(initial)[:, None])
        before = casadi.horzcat(first, last[:, :-1]) if E > 1 else first
        by_element = v[:, self.mesh.interval.tolist()]
        element = self._element()
        inputs = (before, y, np.hstack(list(turns)), by_element, *self._parameters())
        residuals, costs = element.map(E)(*inputs)
        terminal = self.frames[-1].T @ self.terminal @ self.frames[-1]
        end = casadi.SX.sym("end", p)
        final = casadi.solve(unvech(end), casadi.SX.eye(problem.states)) if self.information else unvech(end)
        charge = casadi.Function("charge", [end], [casadi.trace(casadi.SX(casadi.DM(terminal)) @ final)])
        cost = casadi.sum2(costs) + charge(last[:, -1])
        # where the bounds leave no choice there is nothing to constrain
        room = np.sum(problem.upper, axis=1)
        free = np.flatnonzero(room > problem.select + 1e-9)
        forced = np.ones(N, bool)
        forced[free] = False
        upper = np.where(problem.upper >= problem.select, np.where(problem.upper > 0, np.inf, 0.0), problem.upper)
        lower = np.where(forced[:, None], problem.upper, 0.0)
        upper = np.where(forced[:, None], problem.upper, upper)
        sums = casadi.sum1(v)[:, free.tolist()].T if len(free) else casadi.MX(0, 1)
        rows = p * self.unknown * E
        program = Program(
            variables=x,
            objective=cost,
            constraints=casadi.vertcat(casadi.vec(residuals), sums),
            lower=np.concatenate([lower.ravel(), np.full(rows, -np.inf)]),
            upper=np.concatenate([upper.ravel(), np.full(rows, np.inf)]),
            g_lower=np.concatenate([np.zeros(rows), np.full(len(free), float(problem.select))]),
            g_upper=np.concatenate([np.zeros(rows), np.full(len(free), float(problem.select))]),
            spell=self._spell,
            unit=unit,
            jacobian=self._jacobian(element, inputs, free),
        )
        state = self.mesh.stages
        if self.ends_apart:
            state = np.concatenate([state, self.mesh.ends[1:, None]], axis=1)
        inverses = self.inverses[:, None]
        state = inverses @ state @ np.swapaxes(inverses, -1, -2)
        start = np.concatenate([weights.ravel(), vech(np.linalg.inv(state) if self.information else state).ravel()])
        return solve_nlp(program, start, options, monitor)

    def _jacobian(self, element: CasadiFunction, inputs: tuple, free: np.ndarray) -> Casadi:
        """The constraints' Jacobian, put together from the elements' dense blocks.

        CasADi would find it by some hundred sweeps through all elements, twenty times the work.
        """
        import casadi

        E, p, u, M = self.elements, self.packed, self.unknown, len(self.problem.sensors)
        size, N = p * u, self.problem.intervals
        blocks = element.jacobian()
        found = blocks.map(E)(*inputs, casadi.MX(p, u * E), casadi.MX(1, E))
        starts = M * N + size * np.arange(E)  # columns of the unknowns of each element
        rows, columns, values = [], [], []
        # of the residuals' derivatives (the first outputs) those by `before`, which is given for the first, `inner`, v
        for i, first, known in ((0, starts - p, 1), (1, starts, 0), (3, M * self.mesh.interval, 0)):
            row, column = np.array(blocks.sparsity_out(i).get_triplet(), dtype=int).reshape(2, -1)
            rows.append((row + size * np.arange(known, E)[:, None]).ravel())
            columns.append((column + first[known:, None]).ravel())
            values.append(found[i].nz[len(row) * known :])
        rows.append(np.repeat(size * E + np.arange(len(free)), M))
        columns.append((M * free[:, None] + np.arange(M)).ravel())
        values.append(casadi.MX.ones(len(free) * M))
        shape = (size * E + len(free), M * N + size * E)
        pattern, order = _pattern(shape, np.concatenate(rows), np.concatenate(columns))
        return casadi.MX(pattern, casadi.vertcat(*values)[order])

    def _spell(self, row: int) -> str:
        element = row // (self.packed * self.unknown)
        if element >= self.elements:
            return "the sum of the weights"
        return f"the covariance equation at t = {self.mesh.starts[element]:.6g}"

    def weights(self, x: np.ndarray) -> np.ndarray:
        """The weights (N, M) in a point `x` (variables,) of the program."""
        shape = self.problem.upper.shape
        return x[: shape[0] * shape[1]].reshape(shape)

    def covariances(self, x: np.ndarray) -> np.ndarray:
        """The covariances (E+1, n, n) at the ends of the elements, from a point `x` (variables,) of the program."""
        y = x[self.problem.upper.size :].reshape(self.elements, self.unknown, self.packed)
        ends = unvech(y[:, -1])
        ends = self.frames @ (np.linalg.inv(ends) if self.information else ends) @ np.swapaxes(self.frames, 1, 2)
        return np.concatenate([self.problem.plant.covariance[None], ends])

    def costates(self, found: NlpOutcome) -> np.ndarray:
        """(E, n, n) at the starts of the elements, from the multipliers of the Runge-Kutta equations.

        The covariance at the start of an element enters each of its rows with the factor -1, so -sum_i multiplier_i is
        the derivative of the optimal cost by its packed entries: the costate, in the element's coordinates, times the
        triangle's weights.
        """
        rows = self.packed * self.unknown * self.elements
        multipliers = found.multipliers[:rows].reshape(self.elements, self.unknown, self.packed)
        costate = unvech(-np.sum(multipliers, axis=1) / triangle_weights(self.problem.states))
        if self.information:  # d/dSigma = -Y (d/dY) Y
            starts = self.inverses @ self.covariances(found.x)[:-1] @ np.swapaxes(self.inverses, 1, 2)
            inverse = np.linalg.inv(starts)
            costate = -inverse @ costate @ inverse
        return np.swapaxes(self.inverses, 1, 2) @ costate @ self.inverses


def frames(covariances: np.ndarray) -> np.ndarray:
    """Triangular D (E, n, n) with D D' = `covariances` (E, n, n), lifted off zero where they are singular."""
    diagonal = np.einsum("eii->ei", covariances)
    largest = np.max(diagonal, axis=1, keepdims=True)
    scale = np.sqrt(np.maximum(diagonal, np.where(largest > 0, 1e-8 * largest, 1.0)))
    unit = symmetrise(covariances / scale[:, :, None] / scale[:, None, :])
    values, vectors = np.linalg.eigh(unit)
    lifted = (vectors * np.maximum(values, 1e-9)[:, None]) @ np.swapaxes(vectors, 1, 2)
    return scale[:, :, None] * np.linalg.cholesky(lifted)


def _pattern(shape: tuple[int, int], rows: np.ndarray, columns: np.ndarray) -> tuple[CasadiSparsity, list[int]]:
    """CasADi's sparsity of entries at (rows, columns), each once, and the order in which it wants them."""
    import casadi

    order = np.lexsort((rows, columns))
    starts = np.searchsorted(columns[order], np.arange(shape[1] + 1))
    return casadi.Sparsity(*shape, starts.tolist(), rows[order].tolist()), order.tolist()
