"""What must not change a whole solve of the families vlambda, robust, hybrid and precision.

Every function returns a dict of the invariances that were tried: None where it holds, or what is wrong in words.
States are written in units of powers of two whose ratios reach 1e12, clocks shifted by 1.7e9, units of time changed by
1e-9 and 1e9, costs multiplied, states and sensors put in another order, a sensor given twice, slots cut in two.
vlambda, hybrid and precision count steps from 0: they have no origin of time that could be shifted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol import certify, solve
from occontrol.core.plant import DiscretePlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor
from occontrol.core.solution import Solution
from occontrol.families.hybrid.imm import filter_measurements
from occontrol.families.hybrid.plant import JumpPlant, Mode
from occontrol.families.hybrid.problem import Problem as JumpProblem
from occontrol.families.hybrid.sensor import JumpSensor
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.moments import Moments
from occontrol.families.precision.plant import NonlinearPlant
from occontrol.families.precision.problem import Problem as PrecisionProblem
from occontrol.families.precision.program import Program, solve_program
from occontrol.families.precision.unscented import UnscentedFilter
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.problem import Problem as RobustProblem
from occontrol.families.vlambda.problem import Problem as SelectionProblem
from occontrol.families.vlambda.sensor import DiscreteSensor
from tests.invariances import ORIGIN, by_command_line
from tests.invariances_shared import Found, bounded, near, powers, same, tried

METHODS_OF_VLAMBDA = ("optimal", "eigenspace", "trace")


def vlambda(rng: np.random.Generator) -> Found:
    """A random selection problem, by the exact search and by the rules."""
    n, M = int(rng.integers(2, 5)), int(rng.integers(2, 4))
    F = rng.normal(size=(n, n))
    F *= rng.uniform(0.6, 1.1) / np.max(np.abs(np.linalg.eigvals(F)))
    G, S = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    Q, P = G @ G.T * 0.3, S @ S.T * 10.0 ** rng.choice([0, 6])
    H, R = [rng.normal(size=(1, n)) for _ in range(M)], rng.uniform(0.1, 1, M) * 10.0 ** rng.choice([0, -6])
    more = {"steps": int(rng.integers(4, 7)), "epoch": int(rng.integers(1, 3))}
    more["criterion"] = str(rng.choice(["largest-eigenvalue", "trace"]))

    def problem(e=1.0, order=None, sensors=None, factor=1.0, **changes) -> SelectionProblem:
        e, order = e * np.ones(n), np.arange(n) if order is None else order
        both, square = np.outer(e, e), np.ix_(order, order)
        plant = DiscretePlant(
            (F * np.outer(e, 1 / e))[square], (Q * both * factor)[square], (P * both * factor)[square]
        )
        suite = [DiscreteSensor(f"s{j}", (H[j] / e)[:, order], R[j] * factor) for j in sensors or range(M)]
        return SelectionProblem("random", plant, suite, scales=e[order], **{**more, **changes})

    found: Found = {}
    for method in METHODS_OF_VLAMBDA:
        first = solve(problem(), method)

        def states(first=first, method=method) -> str | None:
            other = solve(problem(powers(rng, n)), method)
            if not np.array_equal(first.schedule.weights, other.schedule.weights):
                return "another choice"
            return same(first, other, 1e-12)

        tried(found, f"states {method}", states)
        factor = float(10.0 ** rng.uniform(-9, 9))
        tried(
            found, f"costs {method}", lambda m=method, a=first, f=factor: same(a, solve(problem(factor=f), m), 1e-9, f)
        )
    first = solve(problem(), "optimal")
    order = rng.permutation(n)
    turned = list(reversed(range(M)))
    tried(found, "order", lambda: same(first, solve(problem(order=order, sensors=turned), "optimal"), 1e-9))

    def twice() -> str | None:
        plain = problem()
        again = DiscreteSensor("again", H[0], R[0])
        return same(first, solve(replace(plain, sensors=[*plain.sensors, again]), "optimal"), 1e-9)

    def useless() -> str | None:
        plain = problem()
        blunt = DiscreteSensor("blunt", H[0], R[0] * 1e12)
        return bounded(first, solve(replace(plain, sensors=[blunt, *plain.sensors]), "optimal"))

    tried(found, "twice", twice)
    tried(found, "useless", useless)
    tried(found, "certify", lambda: same(first, certify(first.problem, first.schedule), 1e-12))
    tried(found, "command line", lambda: by_command_line(replace(problem(), scales=None)))
    return found


def robust(rng: np.random.Generator) -> Found:
    """A random switching problem, by the search."""
    n, M, slots = int(rng.integers(2, 4)), int(rng.integers(2, 4)), int(rng.integers(3, 6))
    A = rng.normal(size=(n, n))
    A -= (max(np.linalg.eigvals(A).real.max(), 0) + 0.1) * rng.uniform(0.5, 1.2) * np.eye(n)
    B, K = rng.normal(size=(n, int(rng.integers(1, n + 1)))), 0.3 * rng.normal(size=(1, n))
    C = [rng.normal(size=(1, n)) * rng.uniform(0.5, 3) for _ in range(M)]
    weight, center = np.diag(rng.uniform(0.3, 3, n)), rng.normal(size=n)
    edges = np.ceil(rng.uniform(1, 3) / slots * 64) / 64 * np.arange(slots + 1)

    def problem(e=1.0, unit=1.0, at=0.0, order=None, sensors=None, factor=1.0, size="volume") -> RobustProblem:
        e, order = e * np.ones(n), np.arange(n) if order is None else order
        root, square = np.sqrt(unit), np.ix_(order, order)
        plant = UncertainPlant(
            (A * np.outer(e, 1 / e) / unit)[square],
            ((e[:, None] * B) / root)[order],
            (K / e / root)[:, order],
            (weight / np.outer(e, e))[square],
            (center * e * factor)[order],
            factor**2,
        )
        suite = [Sensor(f"s{j}", (C[j] / e / root)[:, order], [[1.0]]) for j in sensors or range(M)]
        return RobustProblem("random", plant, suite, at + edges * unit, size)

    found: Found = {}
    first = solve(problem())
    if first.schedule is None:  # no sequence keeps the states bounded: that must not depend on anything either
        there = [problem(powers(rng, n)), problem(unit=1e-9), problem(unit=1e9), problem(at=ORIGIN)]
        return {"unobservable": None if all(solve(p).schedule is None for p in there) else "observable elsewhere"}
    e = powers(rng, n)

    def moved(problem: RobustProblem, a: Solution) -> Solution:
        return certify(problem, Schedule(problem.edges, a.schedule.weights, a.schedule.names))

    def states() -> str | None:
        other = solve(problem(e))
        reach = [each.result["observability_horizon"] for each in (first, other)]
        if reach[0] != reach[1]:
            return f"observable up to {reach[0]!r} and {reach[1]!r}"
        return same(first, other, 1e-12, float(np.prod(e)))

    tried(found, "states", states)
    for unit in (1e-9, 1e9):
        tried(found, f"time {unit:g}", lambda u=unit: same(first, solve(problem(unit=u)), 1e-9))
    tried(found, "clock", lambda: same(first, solve(problem(at=ORIGIN)), 1e-9))
    trace = solve(problem(size="trace"))
    factor = float(10.0 ** rng.uniform(-6, 6))
    costs = "costs"
    tried(found, costs, lambda: same(trace, solve(problem(factor=factor, size="trace")), 1e-9, factor**2))
    order, turned = rng.permutation(n), list(reversed(range(M)))
    tried(found, "order", lambda: same(first, solve(problem(order=order, sensors=turned)), 1e-9))

    def twice() -> str | None:
        plain = problem()
        return same(first, solve(replace(plain, sensors=[*plain.sensors, Sensor("again", C[0], [[1.0]])])), 1e-9)

    def cut() -> str | None:
        middle = edges[1] / 2
        finer = replace(problem(), edges=np.insert(edges, 1, middle))
        again = certify(finer, first.schedule)
        return near("cost", first.result["cost"], again.result["cost"], 1e-9) or bounded(first, again, cuts=True)

    def halved() -> str | None:
        finer = replace(problem(), edges=np.linspace(edges[0], edges[-1], 2 * slots + 1))
        return bounded(first, solve(finer), cuts=True)

    tried(found, "twice", twice)
    tried(found, "certify", lambda: same(first, moved(problem(), first), 1e-12))
    tried(found, "cut", cut)
    tried(found, "finer", halved)
    tried(found, "command line", lambda: by_command_line(problem()))
    return found


def hybrid(rng: np.random.Generator) -> Found:
    """A random jumping plant and its estimator on given readings.

    Simulated runs are not compared: the noise is drawn with the symmetric root of F W F', so that the same seed gives
    other runs in other units, of the same distribution.
    """
    n, r, steps = int(rng.integers(2, 4)), int(rng.integers(2, 4)), 8
    A = [rng.normal(size=(n, n)) for _ in range(r)]
    A = [a * rng.uniform(0.5, 1.05) / np.max(np.abs(np.linalg.eigvals(a))) for a in A]
    F, W = [rng.normal(size=(n, 1)) for _ in range(r)], rng.uniform(0.05, 0.5, r)
    T = rng.dirichlet(np.ones(r) * 3, size=r)
    C, R = [rng.normal(size=(1, n)) for _ in range(2)], rng.uniform(0.1, 1.0, 2)
    S, mean = rng.normal(size=(n, n)), rng.normal(size=n)
    readings = {k: [(int(rng.integers(2)), rng.normal(size=1))] for k in range(1, steps + 1)}

    def estimated(e: np.ndarray, turned: bool = False):
        modes = [Mode(f"m{i}", A[i] * np.outer(e, 1 / e), [[W[i]]], F[i] * e[:, None]) for i in range(r)]
        plant = JumpPlant(modes, S @ S.T * np.outer(e, e), mean * e, transition_matrix=T)
        sensors = [JumpSensor(f"s{j}", C[j] / e, [[R[j]]]) for j in ((1, 0) if turned else (0, 1))]
        given = {k: [(1 - j if turned else j, z) for j, z in each] for k, each in readings.items()}
        return filter_measurements(plant, sensors, steps, given)

    def compared(other, e: np.ndarray, share: float) -> str | None:
        pairs = {
            "probabilities": (plain.probabilities, other.probabilities),
            "mean": (plain.mean, other.mean / e),
            "covariance": (plain.covariance, other.covariance / np.outer(e, e)),
        }
        for name, (a, b) in pairs.items():
            apart = float(np.max(np.abs(a - b)) / np.max(np.abs(a)))
            if apart > share:
                return f"another {name}, by {apart:.2g}"
        return None

    found: Found = {}
    plain, e = estimated(np.ones(n)), powers(rng, n)
    tried(found, "states", lambda: compared(estimated(e), e, 1e-9))
    tried(found, "order", lambda: compared(estimated(np.ones(n), True), np.ones(n), 1e-12))

    def command_line() -> str | None:
        modes = [Mode(f"m{i}", A[i], [[W[i]]], F[i]) for i in range(r)]
        plant = JumpPlant(modes, S @ S.T, mean, transition_matrix=T)
        sensors = [JumpSensor(f"s{j}", C[j], [[R[j]]]) for j in range(2)]
        return by_command_line(JumpProblem("random", plant, sensors, steps, runs=3))

    tried(found, "command line", command_line)
    return found


def precision(rng: np.random.Generator) -> Found:
    """A random program of least precision."""
    n, m = int(rng.integers(2, 5)), int(rng.integers(2, 6))
    a, h = rng.normal(size=(n, n)), rng.normal(size=(m, n))
    P = a @ a.T + 0.2 * np.eye(n)
    bound, prices = rng.uniform(0.3, 0.8) * P, rng.uniform(0.5, 2, m)
    found: Found = {}

    def solved(t: np.ndarray, s: np.ndarray, factor: float = 1.0, order=None):
        order = np.arange(m) if order is None else order
        moments = Moments(P * np.outer(t, t), (t[:, None] * (P @ h.T) * s), s[:, None] * (h @ P @ h.T) * s).only(order)
        return solve_program(Program(moments, bound * np.outer(t, t), (prices * s**2 * factor)[order]))

    one_n, one_m = np.ones(n), np.ones(m)
    plain = solved(one_n, one_m)

    def agree(other, factor: float = 1.0, share: float = 1e-9) -> str | None:
        if plain.status is not other.status:
            return f"{plain.status} and {other.status}"
        if not np.isfinite(plain.objective):  # no precision is enough
            return None
        low, high = plain.lower_bound, other.lower_bound / factor
        if low > other.objective / factor * (1 + share) or high > plain.objective * (1 + share):
            return f"a bound of {low!r}, {high!r} is above a cost of {plain.objective!r}, {other.objective / factor!r}"
        gap = max(plain.objective - low, other.objective / factor - high) / abs(plain.objective)
        return near("cost", plain.objective, other.objective / factor, share + gap)

    tried(found, "states", lambda: agree(solved(powers(rng, n), one_m)))
    tried(found, "states and sensors", lambda: agree(solved(powers(rng, n), powers(rng, m))))
    tried(found, "costs", lambda: agree(solved(one_n, one_m, 1e7), 1e7))
    tried(found, "order", lambda: agree(solved(one_n, one_m, order=rng.permutation(m))))
    given = Moments(P, P @ h.T, h @ P @ h.T)
    found_here = PrecisionProblem("random", given, bound_matrix=bound, prices=prices)
    tried(found, "command line", lambda: by_command_line(found_here))
    tried(found, "time", lambda: timed(rng, float(10.0 ** rng.uniform(-9, 9))))
    return found


def timed(rng: np.random.Generator, unit: float) -> str | None:
    """Whether a plant of differential equations needs the same precisions with its clock in another unit."""
    a, b, c = rng.uniform(0.2, 1.0, 3).tolist()
    S = rng.normal(size=(2, 2))

    def solved(unit: float) -> Solution:
        f = [f"(x2 - {a!r}*x1**3)/{unit!r}", f"(-{b!r}*x1 + {c!r}*sin(t/{unit!r}))/{unit!r}"]
        plant = NonlinearPlant(S @ S.T + np.eye(2), f=f, step=0.05 * unit, substeps=4, noise=0.01 * np.eye(2))
        measured = NonlinearMeasurement(2, h=["x1", f"x2 + 0.1*cos(t/{unit!r})"])
        return solve(PrecisionProblem("random", None, plant, measured, UnscentedFilter(), bound_factor=0.4, batch=2))

    one, other = solved(1.0), solved(unit)
    if one.status is not other.status:
        return f"{one.status} and {other.status}"
    return near("objective", float(one.result["objective"]), float(other.result["objective"]), 1e-7)


OTHERS = {"vlambda": vlambda, "robust": robust, "hybrid": hybrid, "precision": precision}
