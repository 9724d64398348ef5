"""The choices of a problem without an end as letters: one step each, exact for its clock.

Steps: F, G Q G' and the reading. Samples: the exact flow of the plant over a step; a running integral is a charge after
the reading. Continuous sensing: the Riccati flow over a step with a fixed choice is again a reading and a prediction,

    S(t) = G + Phi (S(0)^-1 + O)^-1 Phi',   G = E21 E11^-1,   O = E11^-1 E12,   Phi = E11^-T,   E = exp(t [-A' L; Xi A])

and the integral of tr(R S) over it is taken by Gauss's rule, with nodes enough that more change nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.readings.span_charges import charged_spans
from occontrol.numerics.linalg import symmetrise, whiten
from occontrol.numerics.transition import transitions
from occontrol.scheduling.periodic.letters import Letters, smallest_covariance

SHORT = 0.25  # norm of the exponent up to which it is taken at once
NODES = (4, 6, 8, 10, 13, 17, 22, 28, 36)
EXACT = 1e-12  # relative change of a charge that further nodes may still make
HARD = (1.0, 4.0)  # times the smallest covariance, from which that is tested; from far larger ones the rule falls short


@dataclass(frozen=True, eq=False)
class Filled:
    """A problem as letters.

    Parameters
    ----------
    letters : in the units of the problem; charges are per step, or per unit of time
    smallest : (n, n) covariance below which no schedule stays
    """

    letters: Letters
    smallest: np.ndarray


@dataclass(frozen=True, eq=False)
class Parts:
    """What every clock needs.

    Parameters
    ----------
    gains : (A, n, n) information of each choice, or its rate
    prices : (A,) times cost_weight
    everything : (n, n) information of all sensors together
    running : (n, n) R
    """

    gains: np.ndarray
    prices: np.ndarray
    everything: np.ndarray
    running: np.ndarray


def parts_of(problem: PeriodicProblem) -> Parts:
    """Information and prices of all choices.

    Parameters
    ----------
    problem : PeriodicProblem with A choices and n states
    """
    n, own, price = problem.states, {}, {}
    for sensor in problem.sensors:
        rows = np.zeros((0, n))
        if sensor.rows:
            (rows,) = whiten(sensor.noise.at(0.0), sensor.C.at(0.0))
        own[sensor.name] = rows.T @ rows
        price[sensor.name] = problem.cost_weight * float(sensor.cost.at(0.0)[0, 0])
    zero = np.zeros((n, n))
    gains = np.array([sum((own[name] for name in choice), zero) for choice in problem.choices])
    idle = sum(price[s.name] for s in problem.sensors if s.is_idle)
    prices = [sum(price[name] for name in c) + idle * (problem.places - len(c)) for c in problem.choices]
    return Parts(gains, np.array(prices), sum(own.values(), zero), symmetrise(problem.running.at(0.0)))


def fill(problem: PeriodicProblem) -> Filled:
    """The letters of a problem.

    Parameters
    ----------
    problem : PeriodicProblem

    Raises InfeasibleError where no schedule has a limit, SolveFailed where a step is too long for its integral.
    """
    parts = parts_of(problem)
    return _rate(problem, parts) if problem.sensing == "rate" else _readings(problem, parts)


def _readings(problem: PeriodicProblem, parts: Parts) -> Filled:
    n, count, h = problem.states, len(problem.choices), problem.step
    M, constant = parts.running, 0.0
    if problem.discrete:
        F, Q = problem.stepped.F.at(0.0), problem.stepped.Q.at(0.0)
        if problem.stepped.G is not None:
            G = problem.stepped.G.at(0.0)
            Q = G @ Q @ G.T
    else:
        span = np.array([0.0]), np.array([h])
        F, Q = (each[0] for each in transitions(problem.flowing.A, problem.flowing.noise, *span))
        if problem.running_at == "integral":
            whole = charged_spans(problem.flowing, problem.running, *span, 0.0)
            M, constant = whole.charge[0], float(whole.constant[0])
    Q = symmetrise(Q)
    seen = np.zeros((count, 1, n, n)) if problem.running_at == "prior" else parts.gains[:, None]
    letters = Letters(
        np.tile(F, (count, 1, 1)), np.tile(Q, (count, 1, 1)), parts.gains, seen,
        np.tile(M / h, (count, 1, 1, 1)), (parts.prices + constant) / h,
    )  # fmt: skip
    return Filled(letters, smallest_covariance(F, Q, parts.everything))


def _rate(problem: PeriodicProblem, parts: Parts) -> Filled:
    h, A, noise = problem.step, problem.flowing.A.at(0.0), symmetrise(problem.flowing.noise.at(0.0))
    whole = flow(A, noise, parts.everything, h)
    smallest = smallest_covariance(*whole)
    steps = [flow(A, noise, L, h) for L in parts.gains]
    before = None
    for nodes in NODES:
        charges = [_charges(A, noise, L, parts.running, h, nodes) for L in parts.gains]
        F, Q, gained = (np.array([step[i] for step in steps]) for i in range(3))
        seen, weight, constant = (np.array([c[i] for c in charges]) for i in range(3))
        found = Letters(F, Q, gained, seen, weight, constant + parts.prices)
        tried = [found.step(s * smallest, a)[1] for s in HARD for a in range(found.count)]
        if before is not None and np.all(np.abs(np.subtract(tried, before)) <= EXACT * np.abs(tried)):
            return Filled(found, smallest)
        before = tried
    what = f"the covariance changes too much within a step of {h:g} to be integrated"
    raise SolveFailed(f"{what}\n  hint: horizon: {{infinite: true, step: ..}} shorter")


def _charges(A: np.ndarray, noise: np.ndarray, L: np.ndarray, R: np.ndarray, h: float, nodes: int):
    """O_i, M_i (C, n, n) and the constant of the mean of tr(R S) over a step."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    seen, weight, constant = [], [], 0.0
    for x, w in zip((1 + places) / 2, weights / 2, strict=True):
        F, Q, o = flow(A, noise, L, h * x)
        seen.append(o)
        weight.append(symmetrise(w * F.T @ R @ F))
        constant += w * float(np.vdot(R, Q))
    return np.array(seen), np.array(weight), constant


def flow(A: np.ndarray, noise: np.ndarray, L: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Phi, G and O (n, n) of the Riccati flow over a time with information rate L.

    Parameters
    ----------
    A, noise, L : (n, n)
    t : time
    """
    from scipy.linalg import expm

    from occontrol.scheduling.periodic.steady import follow

    n = len(A)
    exponent = np.block([[-A.T, L], [noise, A]]) * t
    # in units in which both halves are alike, so that neither is lost in the other
    unit = np.sqrt(max(float(np.linalg.norm(exponent[n:, :n])), 1e-300) / max(float(np.linalg.norm(L * t)), 1e-300))
    unit = unit if 1e-100 < unit < 1e100 else 1.0
    exponent[n:, :n] /= unit
    exponent[:n, n:] *= unit
    doublings = max(0, int(np.ceil(np.log2(max(float(np.linalg.norm(exponent, 2)), 1e-300) / SHORT))))
    E = expm(exponent / 2**doublings)
    first = np.linalg.inv(E[:n, :n])
    F, G, gained = first.T, symmetrise(E[n:, :n] @ first) * unit, symmetrise(first @ E[:n, n:]) / unit
    for _ in range(doublings):
        F, G, gained = follow(F.copy(), G, gained, F.copy(), G, gained)
    return F, G, gained
