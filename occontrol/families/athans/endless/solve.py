"""From many targets without an end to a Solution: bounds, a joint cycle, checks, what a run folder holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import SolveFailed
from occontrol.core.kinds import PlainDict
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Certificate, Solution, Status, make_solution
from occontrol.families.athans.endless.bound import Bounds, Target, bounds_of, targets_of
from occontrol.families.athans.endless.problem import EndlessTargetsProblem
from occontrol.families.athans.periodic.check import AGREE, plain_cycle
from occontrol.families.athans.periodic.method import Periodic
from occontrol.families.athans.periodic.text import rounded_down
from occontrol.families.athans.result import AthansResult, ContinuousNumbers, TopNumbers
from occontrol.numerics.linalg import symmetrise
from occontrol.scheduling.periodic.joint import Costs, improved, laid_out
from occontrol.scheduling.periodic.potential import cycle_of

FEW = 4  # targets up to which every period is tried
PERIODS = 8  # lengths that are tried of more targets
FIRST, AFTER, KEPT = 400, 4_000, 3  # exchanges tried of every layout, and of the best few
LISTED = 200  # targets up to which their costs stand in result.json


def solve(problem: EndlessTargetsProblem, method: Periodic, monitor: Monitor) -> Solution:
    """The best joint cycle that was found, and what is proven for all schedules.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    method : its options
    monitor : Monitor

    Raises InfeasibleError where no schedule keeps the covariance of a target bounded, SolveFailed where no cycle was
    found.
    """
    began = stopwatch.seconds()
    targets = targets_of(problem)
    bounds = bounds_of(problem, targets, method.relative_gap, method.max_nodes, monitor)
    monitor.stage = "cycles"
    words = search(problem, targets, bounds.rates, method.max_period, monitor)
    return assemble(problem, method.name, targets, words, bounds, method.relative_gap, monitor, began)


def search(
    problem: EndlessTargetsProblem, targets: Sequence[Target], rates: Sequence[np.ndarray], longest: int,
    monitor: Monitor,
) -> np.ndarray:  # fmt: skip
    """The best joint cycle (K, P) that was found.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    targets : of the problem
    rates : (K, R) looks a step, several of them
    longest : steps of a cycle
    monitor : Monitor

    Raises SolveFailed where no cycle that was looked at keeps the covariances bounded.
    """
    costs, capacity = Costs([t.letters for t in targets], [t.uses for t in targets]), problem.capacity
    random, K, found = np.random.default_rng(1), len(targets), []
    round_ = -(-K // max(1, int(np.sum(capacity))))
    longest = max(longest, 4 * round_)
    periods = np.arange(1, longest + 1)
    if K > FEW:
        periods = np.unique(np.geomspace(max(2, round_), longest, PERIODS).round().astype(int))
    tries = FIRST if K <= FEW else FIRST + 40 * K
    for P in periods:
        for each in rates:
            if monitor.stop and found:
                break
            words = laid_out(
                costs, [_of_letters(t, r) for t, r in zip(targets, each, strict=True)], int(P), capacity, random
            )
            words, cost = improved(costs, words, capacity, tries, random, monitor)
            found.append((cost, len(found), words))
    best = sorted(found)[:KEPT]
    done = [improved(costs, words, capacity, AFTER + 200 * K, random, monitor) for _, _, words in best]
    words, cost = min(done, key=lambda x: x[1])
    if not np.isfinite(cost):
        what = f"no cycle of up to {longest} steps that was looked at keeps all covariances bounded"
        raise SolveFailed(f"{what}\n  hint: method: {{name: periodic, max_period: ..}} longer")
    return words


def _of_letters(target: Target, rates: np.ndarray) -> np.ndarray:
    """(A,) rates of the letters that use one resource, from those (R,) of the resources."""
    found = np.zeros(target.letters.count)
    for a, uses in enumerate(target.uses):
        if np.sum(uses) == 1:
            found[a] = float(uses @ rates)
    return found


@dataclass(frozen=True, eq=False)
class _Parts:
    """What each target costs: by letters, and by other code; running and prices, how far it comes back."""

    cost: np.ndarray
    plain: np.ndarray
    running: np.ndarray
    paid: np.ndarray
    apart: float


def _parts(targets: Sequence[Target], words: np.ndarray) -> _Parts:
    rows, apart = [], 0.0
    for target, word in zip(targets, words, strict=True):
        cycle = cycle_of(target.letters, word)
        if cycle is None:
            raise SolveFailed(f"the covariance of target '{target.alone.name}' has no limit")
        start = symmetrise(target.root @ cycle.priors[0] @ target.root.T)
        plain = plain_cycle(target.alone, np.array([target.choices[a] for a in word]), start)
        scale = np.sqrt(np.outer(np.diag(start), np.diag(start)))
        apart = max(apart, float(np.max(np.abs(plain.back - start) / np.maximum(scale, 1e-300))))
        rows.append((cycle.cost, plain.cost, plain.running, plain.observation))
    cost, plain, running, paid = np.array(rows).T
    return _Parts(cost, plain, running, paid, apart)


def assemble(
    problem: EndlessTargetsProblem, name: str, targets: Sequence[Target], words: np.ndarray, bounds: Bounds, gap: float,
    monitor: Monitor, began: float,
) -> Solution:  # fmt: skip
    """The Solution of a joint cycle and its bounds, checked by an adaptive integrator.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    name : of the method
    targets : of the problem
    words : (K, P) letters
    bounds : Bounds
    gap : relative gap at which it is certified
    monitor : Monitor
    began : stopwatch.seconds() at the start
    """
    words = shortest(words)
    parts = _parts(targets, words)
    cost, plain = float(np.sum(parts.cost)), float(np.sum(parts.plain))
    certificate = Certificate(cost, bounds.integer)
    status = Status.CERTIFIED if certificate.relative_gap <= gap else Status.FEASIBLE
    message = (
        f"No schedule of looks that last whole steps costs less than {rounded_down(bounds.integer, 7)} a unit of time."
    )
    if monitor.interrupted:
        status, message = Status.INTERRUPTED, f"{Status.INTERRUPTED.text} {message}"
    if not abs(plain - cost) <= AGREE * abs(cost) or not parts.apart <= 100 * AGREE:
        status = Status.DISAGREES
        message = f"the cycle is said to cost {cost:.12g}, an independent integration says {plain:.12g}"
    schedule = schedule_of(problem, targets, words)
    monitor.report(0, cost, bounds.integer, stage="check")
    averaged = None if bounds.averaged is None else bounds.averaged
    continuous = None
    if averaged is not None:
        continuous = ContinuousNumbers(plain, averaged, (plain - averaged) / abs(plain))
    per_target: PlainDict = {"cost": parts.cost.tolist(), "error": parts.running.tolist()}
    P = words.shape[1]
    numbers = AthansResult(
        name=problem.name, top=TopNumbers(cost, certificate.lower_bound, certificate.relative_gap, "grid"),
        cost=cost, lower_bound=certificate.lower_bound, relative_gap=certificate.relative_gap,
        allowance=1e-10 * abs(bounds.integer), observation_cost=float(np.sum(parts.paid)),
        cost_weight=problem.cost_weight, running_cost=float(np.sum(parts.running)), prediction_error=0.0,
        predicted_mean_square_error=0.0, continuous=continuous, discretisation_error=None,
        relaxed_cost=float(averaged if averaged is not None else bounds.integer),
        relaxed_lower_bound=float(averaged if averaged is not None else bounds.integer), singular_fraction=None,
        intervals=P, readings=None, integration_steps=None, integration_error=None, added_edges=None, warnings=[],
        switches=schedule.switches, sweeps={}, extra={"prices": bounds.prices.tolist()}, schedule=schedule.segments(),
        proven_optimal=certificate.relative_gap <= 1e-9, period=P,
        bounds={"averaged": averaged, "integer": bounds.integer}, targets=problem.targets,
        per_target=per_target if problem.targets <= LISTED else None,
    )  # fmt: skip
    arrays = {
        "times": schedule.edges, "edges": schedule.edges, "weights": schedule.weights,
        "per_target_cost": parts.cost, "per_target_error": parts.running, "per_target_bound": bounds.parts,
        "prices": np.tile(bounds.prices, (P, 1)),
    }  # fmt: skip
    return make_solution(
        problem=problem, method=name, status=status, message=message, iterations=0, numbers=numbers, monitor=monitor,
        began=began, arrays=arrays, schedule=schedule, certificate=certificate,
    )  # fmt: skip


def schedule_of(problem: EndlessTargetsProblem, targets: Sequence[Target], words: np.ndarray) -> LookSchedule:
    """A joint cycle (K, P) as looks.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    targets : of the problem
    words : (K, P) letters
    """
    return problem.schedule_of(
        [
            [tuple(int(r) for r in np.flatnonzero(t.uses[a])) for a in word]
            for t, word in zip(targets, words, strict=True)
        ]
    )


def shortest(words: np.ndarray) -> np.ndarray:
    """A joint cycle without repetitions of itself.

    Parameters
    ----------
    words : (K, P) letters
    """
    P = words.shape[1]
    for d in range(1, P + 1):
        if P % d == 0 and np.array_equal(words, np.tile(words[:, :d], (1, P // d))):
            return words[:, :d]
    return words
