"""The averaged bound: what sensors would cost that could be used in shares at every step.

f(v) = charges of the steady covariance with information L(v) = sum_a v_a L_a. Information is operator-concave from step
to step and charges are convex in it, so along any schedule the means of Y and v do no worse than the schedule, and
    J >= min_v f(v) >= f(v) - [g.v - min_a g_a]
from the gradient g at any shares v: one Riccati and one Lyapunov equation each. In continuous time the same holds for
the flow, and switching fast enough comes as close as one likes.
Source: Le Ny, Feron & Dahleh (2011) state the bound as an LMI; Mourikis & Roumeliotis (2006).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import InfeasibleError
from occontrol.numerics.linalg import symmetrise
from occontrol.scheduling.periodic.letters import Letters
from occontrol.scheduling.periodic.phases import Phases, always

LEAST = 1e-9  # share that a step of the search leaves to every letter
ROUNDS = 40  # of the exchange of shares after the search
ALLOWANCE = 1e-11  # of the cost: what rounding in two matrix equations may have done to the bound


@dataclass(frozen=True, eq=False)
class Averaged:
    """The averaged optimum and what it proves.

    Parameters
    ----------
    lower_bound : of every schedule, a step or a unit of time
    cost : f at the shares
    shares : (A,) of the letters, sum 1
    covariance : (n, n) steady, prior in discrete time
    potential : (n, n) Z = S P S, what prior information is worth there
    """

    lower_bound: float
    cost: float
    shares: np.ndarray
    covariance: np.ndarray
    potential: np.ndarray


Evaluated = tuple[float, np.ndarray, np.ndarray, np.ndarray]  # f, gradient (A,), covariance, potential


def averaged_steps(letters: Letters, phases: Phases | None = None) -> Averaged:
    """The averaged optimum of letters that share their plant.

    Parameters
    ----------
    letters : in units in which the smallest covariance is the identity
    phases : which letters there are at which step; None is all of them always

    Raises InfeasibleError where no shares keep the covariance bounded.
    """
    from occontrol.scheduling.periodic.steady import settle

    F, Q, M, n = letters.F[0], letters.Q[0], letters.weight[0], letters.states
    word, eye = np.zeros(1, dtype=np.int64), np.eye(n)

    def evaluate(v: np.ndarray) -> Evaluated | None:
        L, seen = np.tensordot(v, letters.L, 1), np.tensordot(v, letters.seen, 1)
        S, settled = settle(F[None].copy(), Q[None].copy(), L[None], word, eye)
        if not settled:
            return None
        after = symmetrise(np.linalg.solve(eye + S @ L, S))
        at = [symmetrise(np.linalg.solve(eye + S @ o, S)) for o in seen]
        value = float(v @ letters.constant) + sum(float(np.vdot(m, X)) for m, X in zip(M, at, strict=True))
        D = F @ (eye - after @ L)
        charged = np.zeros((n, n))
        for m, X, o in zip(M, at, seen, strict=True):
            K = eye - X @ o
            charged += K.T @ m @ K
        P = steady_costate(D, charged)
        inside = after @ F.T @ P @ F @ after
        gradient = letters.constant - np.einsum("ij,aij->a", inside, letters.L)
        for i, (m, X) in enumerate(zip(M, at, strict=True)):
            gradient -= np.einsum("ij,aij->a", X @ m @ X, letters.seen[:, i])
        return value, gradient, S, symmetrise(S @ P @ S)

    return _minimise(evaluate, phases or always(letters.count))


def averaged_flow(
    A: np.ndarray,
    noise: np.ndarray,
    gains: np.ndarray,
    running: np.ndarray,
    prices: np.ndarray,
    phases: Phases | None = None,
) -> Averaged:
    """The averaged optimum in continuous time: A S + S A' + Xi - S L(v) S = 0, f = tr(R S) + q.v.

    Parameters
    ----------
    A, noise, running : (n, n) of the plant, Xi and R
    gains : (A, n, n) information rates of the letters
    prices : (A,) their price rates
    phases : which letters there are in which step; None is all of them always

    Raises InfeasibleError where no shares keep the covariance bounded.
    """
    from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

    def evaluate(v: np.ndarray) -> Evaluated | None:
        L = np.tensordot(v, gains, 1)
        values, vectors = np.linalg.eigh(L)
        C = vectors * np.sqrt(np.maximum(values, 0.0))
        try:
            S = symmetrise(solve_continuous_are(A.T, C, noise, np.eye(len(A))))
            closed = A - S @ L
            if not np.max(np.linalg.eigvals(closed).real) < 0:
                return None
            P = symmetrise(solve_continuous_lyapunov(closed.T, -running))
        except (np.linalg.LinAlgError, ValueError):
            return None
        value = float(np.vdot(running, S) + v @ prices)
        return value, prices - np.einsum("ij,aij->a", S @ P @ S, gains), S, symmetrise(S @ P @ S)

    return _minimise(evaluate, phases or always(len(gains)))


def steady_costate(closed: np.ndarray, charged: np.ndarray) -> np.ndarray:
    """P = closed' P closed + charged, by doubling; the spectral radius of `closed` is below 1.

    Parameters
    ----------
    closed : (n, n)
    charged : (n, n) symmetric
    """
    P, D = charged, closed
    for _ in range(60):
        more = D.T @ P @ D
        P = symmetrise(P + more)
        if np.max(np.abs(more)) <= 1e-16 * np.max(np.abs(P)):
            break
        D = D @ D
    return P


def _minimise(evaluate: Callable[[np.ndarray], Evaluated | None], phases: Phases) -> Averaged:
    """The best of what a search over the shares of every phase has seen, with the best certificate.

    Phases with the same letters have the same shares (f is convex): x (C, A) of C patterns, v = sum_c times_c x_c.
    """
    from scipy.optimize import minimize

    opened, times = phases.patterns
    place = np.flatnonzero(opened)
    best: list = [None, -np.inf]  # (f, x, S, Z, g) of the least f, the bound

    def spread(entries: np.ndarray) -> np.ndarray:
        x = np.zeros(opened.shape)
        x.flat[place] = np.maximum(entries, 0.0)
        return x / np.sum(x, axis=1, keepdims=True)

    def look(x: np.ndarray) -> Evaluated | None:
        v = times @ x
        found = evaluate(v)
        if found is None or not np.isfinite(found[0]):
            return None
        f, g, S, Z = found
        gap = float(g @ v - times @ np.min(np.where(opened, g, np.inf), axis=1))
        best[1] = max(best[1], f - gap - ALLOWANCE * (abs(f) + float(np.abs(g) @ v)))
        if best[0] is None or f < best[0][0]:
            best[0] = (f, x, S, Z, g)
        return f, g, S, Z

    start = spread(np.ones(len(place)))
    if look(start) is None:
        raise InfeasibleError("no shares of the sensors keep the covariance bounded for ever")
    if np.any(np.sum(opened, axis=1) > 1):
        scale, rows, columns = abs(best[0][0]) or 1.0, *np.nonzero(opened)
        sums = (rows == np.arange(len(opened))[:, None]).astype(float)

        def objective(entries: np.ndarray) -> tuple[float, np.ndarray]:
            found = look(spread(entries))
            if found is None:
                return 1e6, np.zeros(len(place))
            return found[0] / scale, times[rows] * found[1][columns] / scale

        minimize(
            objective, start.flat[place], jac=True, method="SLSQP", bounds=[(LEAST, 1.0)] * len(place),
            constraints=[{"type": "eq", "fun": lambda e: sums @ e - 1.0, "jac": lambda e: sums}],
            options={"ftol": 1e-15, "maxiter": 200},
        )  # fmt: skip
        _exchange(look, best, opened)
    f, x, S, Z, _ = best[0]
    return Averaged(min(best[1], f), f, times @ x, S, Z)


def _exchange(look: Callable[[np.ndarray], Evaluated | None], best: list, opened: np.ndarray) -> None:
    """Move shares from the worst letter in use to the best one, by halved steps, until that gains nothing."""
    step, rows = 0.5, np.arange(len(opened))
    for _ in range(ROUNDS):
        f, x, _, _, g = best[0]
        if f - best[1] <= 1e-10 * abs(f):
            return
        to = np.argmin(np.where(opened, g, np.inf), axis=1)
        of = np.argmax(np.where(x > 0, g, -np.inf), axis=1)
        w = x.copy()
        moved = step * x[rows, of]
        w[rows, of] -= moved
        w[rows, to] += moved
        if (found := look(w)) is None or found[0] >= f:
            step /= 2
