"""A cycle judged by other code: a covariance filter of its own, and an adaptive integrator for continuous sensing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.numerics.linalg import symmetrise
from occontrol.numerics.transition import transitions

AGREE = 1e-8  # relative: the cycle comes back to where it began, and costs what is said


@dataclass(frozen=True, eq=False)
class PlainCycle:
    """One cycle, followed from a prior covariance.

    Parameters
    ----------
    cost : per step or unit of time
    running, observation : its parts; observation before it is weighted
    back : (n, n) the covariance after the cycle
    """

    cost: float
    running: float
    observation: float
    back: np.ndarray


def plain_cycle(problem: PeriodicProblem, word: np.ndarray, start: np.ndarray) -> PlainCycle:
    """What a cycle costs from a prior covariance, by Joseph's form, or by an adaptive integrator.

    Parameters
    ----------
    problem : PeriodicProblem
    word : (p,) letters
    start : (n, n) prior covariance at its first step
    """
    sensors = {s.name: s for s in problem.sensors}
    R = symmetrise(problem.running.at(0.0))
    running = observation = 0.0
    S = start
    idle = [s for s in problem.sensors if s.is_idle]
    for a in word:
        choice = problem.choices[a]
        used = [sensors[name] for name in choice] + idle * (problem.places - len(choice))
        price = sum(float(s.cost.at(0.0)[0, 0]) for s in used)
        C = np.vstack([np.zeros((0, problem.states)), *[s.C.at(0.0) for s in used]])
        noise = [s.noise.at(0.0) for s in used]
        if problem.sensing == "rate":
            S, more = _flow(problem, C, noise, S, R)
            running, observation = running + more, observation + price * problem.step
            continue
        after = _joseph(S, C, noise)
        F, Q, charge = _step(problem, R)
        running += float(np.vdot(R, S)) if problem.running_at == "prior" else charge(after)
        observation += price
        S = symmetrise(F @ after @ F.T + Q)
    time = len(word) * problem.step
    return PlainCycle((running + problem.cost_weight * observation) / time, running / time, observation / time, S)


def _joseph(S: np.ndarray, C: np.ndarray, noise: list[np.ndarray]) -> np.ndarray:
    if not len(C):
        return S
    theta = _diagonal(noise)
    K = np.linalg.solve(C @ S @ C.T + theta, C @ S).T
    rest = np.eye(len(S)) - K @ C
    return symmetrise(rest @ S @ rest.T + K @ theta @ K.T)


def _diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    from scipy.linalg import block_diag

    return block_diag(*[b for b in blocks if b.size])


def _step(problem: PeriodicProblem, R: np.ndarray):
    """F, Q of one step, and what a posterior covariance is charged."""
    if problem.discrete:
        G = np.eye(len(problem.stepped.Q.at(0.0))) if problem.stepped.G is None else problem.stepped.G.at(0.0)
        return problem.stepped.F.at(0.0), G @ problem.stepped.Q.at(0.0) @ G.T, lambda X: float(np.vdot(R, X))
    h = problem.step
    F, Q = (each[0] for each in transitions(problem.flowing.A, problem.flowing.noise, np.zeros(1), np.full(1, h)))
    if problem.running_at != "integral":
        return F, Q, lambda X: float(np.vdot(R, X))
    return F, Q, lambda X: _flow(problem, np.zeros((0, problem.states)), [], X, R)[1]


def _flow(problem: PeriodicProblem, C: np.ndarray, noise: list[np.ndarray], S: np.ndarray, R: np.ndarray):
    """The covariance after one step of continuous sensing, and the integral of tr(R S) over it."""
    from scipy.integrate import solve_ivp

    A, Xi, n = problem.flowing.A.at(0.0), problem.flowing.noise.at(0.0), len(S)
    L = C.T @ np.linalg.solve(_diagonal(noise), C) if len(C) else np.zeros((n, n))
    scale = np.sqrt(np.outer(np.diag(S), np.diag(S)))

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        X = y[:-1].reshape(n, n)
        return np.append((A @ X + X @ A.T + Xi - X @ L @ X).ravel(), np.vdot(R, X))

    tolerance = 1e-12 * np.append(scale.ravel(), max(float(np.vdot(R, S)), 1e-300) * problem.step)
    done = solve_ivp(rate, (0.0, problem.step), np.append(S.ravel(), 0.0), "DOP853", rtol=1e-11, atol=tolerance)
    return symmetrise(done.y[:-1, -1].reshape(n, n)), float(done.y[-1, -1])
