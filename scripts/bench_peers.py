"""Other ways to solve the relaxation, each with a time limit, and the evaluator that scores the policies of all.

The evaluator is the plain form of the recursion (`node_path`: numpy, no compiled loops): cost of a policy, and its gap
to the bound that the same plain form gives for our policy of gap 1e-6.
Peers: Ipopt collocation (the project's own), CasADi single shooting with RK4 and limited-memory BFGS, SciPy's L-BFGS-B
on softmax weights with the exact gradient of our own sweep, and the recursion as a semidefinite program with Clarabel.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.athans.discretise import discretise, feasible_set, half_predicts
from occontrol.families.athans.node_path import node_path
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep

GAP = 1e-4
MARKS = 60  # policies of one run that are scored at most


@dataclass
class Run:
    """One run of one method: policies with the seconds at which they stood; `more` says how it ended."""

    method: str
    policies: list[tuple[float, np.ndarray]] = field(default_factory=list)
    seconds: float = 0.0
    more: str = ""
    gaps: list[tuple[float, float]] = field(default_factory=list)

    @property
    def reached(self) -> float | None:
        """Seconds to the target gap, or None."""
        return next((s for s, gap in self.gaps if gap <= GAP), None)

    @property
    def at_least(self) -> float:
        """Seconds to the target gap, or all that were spent without reaching it."""
        return self.seconds if self.reached is None else self.reached


class Evaluator:
    """Cost of a policy by the plain recursion and its relative gap to the plain bound of our best policy."""

    def __init__(self, problem: SchedulingProblem):
        self.recursion, self.halves = discretise(problem), half_predicts(problem)
        self.feasible_set = feasible_set(problem)
        best = minimise_relaxed(Sweep(self.recursion), self.feasible_set, options=RelaxedOptions(1e-6)).weights
        cost, gradient = self.score(best)
        self.bound = self.feasible_set.bound(cost, best, gradient)

    def score(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J (running weights left out) and dJ/dv (N, M)."""
        r = self.recursion
        path = node_path(r, self.halves, weights)
        cost = float(np.vdot(r.cost, weights) + np.vdot(r.terminal, path.covariance[-1]))
        return cost, path.switching * r.steps[:, None]

    def gap(self, weights: np.ndarray) -> float:
        """Relative gap of a policy, first made exactly feasible."""
        cost, _ = self.score(self.feasible_set.project(weights))
        return (cost - self.bound) / abs(cost)

    def judge(self, run: Run) -> Run:
        """Score the run's policies, all if they are few."""
        marks = run.policies
        if len(marks) > MARKS:
            marks = [marks[i] for i in np.unique(np.geomspace(1, len(marks), MARKS).astype(int) - 1)]
        run.gaps = [(seconds, self.gap(v)) for seconds, v in marks]
        return run


def ours(problem: SchedulingProblem, gap: float = GAP) -> Run:
    """From the problem to the certified gap: discretisation, work space and relaxation."""
    started = time.perf_counter()
    sweep = Sweep(discretise(problem))
    found = minimise_relaxed(sweep, feasible_set(problem), options=RelaxedOptions(gap))
    seconds = time.perf_counter() - started
    return Run("this project", [(seconds, found.weights)], seconds, f"{found.sweeps['gradients']} sweeps")


def collocation(problem: SchedulingProblem, limit: float) -> Run:
    """The project's own Ipopt collocation; only its last policy is scored."""
    from occontrol.families.athans.collocation.solve import solve_collocation
    from occontrol.families.athans.methods import Collocation

    started = time.perf_counter()
    found = solve_collocation(problem, Collocation(), Monitor(time_limit=limit))
    seconds = time.perf_counter() - started
    return Run("collocation", [(seconds, found.weights)], seconds, f"{found.iterations} iterations, {found.status}")


def _rates(problem: SchedulingProblem, r: Recursion) -> np.ndarray:
    rows = np.split(r.rows[0], r.offsets[1:-1])
    return np.stack([c.T @ c for c in rows])


def single_shooting(problem: SchedulingProblem, limit: float) -> Run:
    """Covariance by RK4 through mapaccum, weights on the simplex, Ipopt with limited-memory BFGS.

    The Runge-Kutta steps per interval are as many as the sharpest sensor needs for stability at the start, at least
    two: more would be slower, fewer overflow.
    """
    import casadi

    r = discretise(problem)
    n, M, N, h = r.states, r.sensors, r.intervals, float(r.steps[0])
    A, noise, L = problem.plant.A.at(0.0), problem.plant.noise.at(0.0), _rates(problem, r)
    stiffness = 2 * h * max(np.linalg.norm(rate @ r.initial, 2) for rate in L)
    pieces = int(np.clip(np.ceil(stiffness / 2.5), 2, 40))
    S, v = casadi.SX.sym("S", n, n), casadi.SX.sym("v", M)
    information = sum(v[j] * casadi.SX(casadi.sparsify(casadi.DM(L[j]))) for j in range(M))
    half = casadi.mtimes(casadi.DM(A), S)
    rate = casadi.Function("rate", [S, v], [half + half.T + casadi.DM(noise) - casadi.mtimes([S, information, S])])
    x, step = S, h / pieces
    for _ in range(pieces):
        k1 = rate(x, v)
        k2 = rate(x + step / 2 * k1, v)
        k3 = rate(x + step / 2 * k2, v)
        x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + step * k3, v))
    whole = casadi.Function("interval", [S, v], [x]).mapaccum(N)
    V = casadi.MX.sym("V", M, N)
    last = whole(casadi.DM(r.initial), V)[:, -n:]
    objective = casadi.dot(casadi.DM(r.cost.T), V) + casadi.dot(casadi.DM(r.terminal), last)
    run = Run("single shooting", more=f"{pieces} Runge-Kutta steps per interval")
    watch = _Watch(M * N, N, lambda z: run.policies.append((time.perf_counter() - started, z.reshape(N, M))))
    options = {
        "print_time": False,
        "show_eval_warnings": False,
        "iteration_callback": watch.callback,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "hessian_approximation": "limited-memory",
            "limited_memory_max_history": 20,
            "max_iter": 3000,
            "max_wall_time": limit,
            "tol": 1e-7,
        },
    }
    program = {"x": casadi.vec(V), "f": objective, "g": casadi.sum1(V).T}
    solver = casadi.nlpsol("shooting", "ipopt", program, options)
    started = time.perf_counter()
    found = solver(x0=np.full(M * N, 1.0 / M), lbx=0.0, ubx=1.0, lbg=1.0, ubg=1.0)
    run.seconds = time.perf_counter() - started
    run.policies.append((run.seconds, np.array(found["x"]).reshape(N, M)))
    run.more += f", {solver.stats()['return_status']}"
    return run


class _Watch:
    """Ipopt's iteration callback that hands over the iterate."""

    def __init__(self, size: int, rows: int, take: Callable[[np.ndarray], None]):
        import casadi

        class Callback(casadi.Callback):
            def __init__(self) -> None:
                super().__init__()
                self.construct("watch", {})

            def get_n_in(self) -> int:
                return casadi.nlpsol_n_out()

            def get_n_out(self) -> int:
                return 1

            def get_name_in(self, i: int) -> str:
                return casadi.nlpsol_out(i)

            def get_sparsity_in(self, i: int) -> casadi.Sparsity:
                name = casadi.nlpsol_out(i)
                count = {"f": 1, "x": size, "lam_x": size, "g": rows, "lam_g": rows}.get(name, 0)
                return casadi.Sparsity.dense(count, 1) if count else casadi.Sparsity(0, 0)

            def eval(self, arguments: list) -> list[int]:
                take(np.array(arguments[0]).ravel())
                return [0]

        self.callback = Callback()


def softmax(problem: SchedulingProblem, limit: float) -> Run:
    """SciPy's L-BFGS-B on z with v = softmax(z), cost and gradient from our own sweep."""
    from scipy.optimize import minimize

    started = time.perf_counter()
    r = discretise(problem)
    sweep, run = Sweep(r), Run("softmax L-BFGS-B")

    def weights(z: np.ndarray) -> np.ndarray:
        z = z.reshape(r.intervals, r.sensors)
        e = np.exp(z - np.max(z, axis=1, keepdims=True))
        return e / np.sum(e, axis=1, keepdims=True)

    def value(z: np.ndarray) -> tuple[float, np.ndarray]:
        v = weights(z)
        J, g = sweep.cost_and_gradient(v)
        return J, (v * (g - np.sum(v * g, axis=1, keepdims=True))).ravel()

    def callback(z: np.ndarray) -> None:
        run.policies.append((time.perf_counter() - started, weights(z)))
        if time.perf_counter() - started > limit:
            raise StopIteration

    options = {"maxcor": 20, "maxiter": 100_000, "maxfun": 1_000_000, "ftol": 1e-14, "gtol": 1e-9}
    minimize(value, np.zeros(r.cost.size), jac=True, method="L-BFGS-B", callback=callback, options=options)
    run.seconds = time.perf_counter() - started
    run.more = f"{sweep.backward_count} sweeps"
    return run


def semidefinite(problem: SchedulingProblem, limit: float) -> Run:
    """The same recursion in information form, one matrix inequality per interval, by CVXPY and Clarabel.

    With Z = F^-T Y+ F^-1 and Q = G G' the predict Y- <= (Z^-1 + G G')^-1 is [[Z - Y-, Z G], [G'Z, I + G'Z G]] >= 0; the
    update Y+ = Y- + h sum_j v_j L_j is linear; tr(W S_N) is the trace of X with [[X, V], [V', Y+]] >= 0, V'V = F'WF.
    """
    import cvxpy as cp

    from occontrol.numerics.linalg import square_root

    r = discretise(problem)
    n, N, L = r.states, r.intervals, _rates(problem, r)
    v = cp.Variable(r.cost.shape, nonneg=True)
    first = r.transition[r.predict[0]] @ r.initial @ r.transition[r.predict[0]].T + r.noise[r.predict[0]]
    before: object = np.linalg.inv(first)
    limits: list = [cp.sum(v, axis=1) == problem.select, v <= problem.upper]
    flat = L.reshape(len(L), -1).T
    for k in range(N):
        after = before + cp.reshape(flat @ (r.steps[k] * v[k]), (n, n), order="C")
        if k == N - 1:
            break
        inverse, G = np.linalg.inv(r.transition[r.predict[k + 1]]), square_root(r.noise[r.predict[k + 1]])
        Z = inverse.T @ after @ inverse
        before = cp.Variable((n, n), symmetric=True)
        limits.append(cp.bmat([[Z - before, Z @ G], [G.T @ Z, np.eye(n) + G.T @ Z @ G]]) >> 0)
    root = Sweep(r)._root
    X = cp.Variable((len(root), len(root)), symmetric=True)
    limits.append(cp.bmat([[X, root], [root.T, after]]) >> 0)
    program = cp.Problem(cp.Minimize(cp.sum(cp.multiply(r.cost, v)) + cp.trace(X)), limits)
    run = Run("SDP, Clarabel")
    started = time.perf_counter()
    try:
        program.solve(solver=cp.CLARABEL, time_limit=limit, tol_gap_rel=1e-5, tol_gap_abs=1e-7, tol_feas=1e-7)
    except cp.SolverError as error:
        run.more = f"{error}; "
    whole = time.perf_counter() - started
    run.seconds = (program.solver_stats.solve_time if program.solver_stats else None) or whole
    run.more += f"{program.status}; Clarabel's own seconds, with CVXPY {whole:.1f}"
    if v.value is not None:
        run.policies.append((run.seconds, np.asarray(v.value)))
    return run


PEERS: dict[str, Callable[[SchedulingProblem, float], Run]] = {
    "softmax L-BFGS-B": softmax,
    "SDP, Clarabel": semidefinite,
    "single shooting": single_shooting,
    "collocation": collocation,
}
