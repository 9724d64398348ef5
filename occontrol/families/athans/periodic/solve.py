"""From a problem without an end to a Solution: cycle, bounds, checks, and everything that a run folder holds."""

from __future__ import annotations

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import SolveFailed, plural
from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Certificate, Solution, Status, make_solution
from occontrol.families.athans.periodic.check import AGREE, PlainCycle, plain_cycle
from occontrol.families.athans.periodic.method import Periodic, Shares
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.periodic.prove import Proven, Setting, averaged_of, prove, setting_of
from occontrol.families.athans.periodic.transient import transient
from occontrol.families.athans.result import AthansResult, ContinuousNumbers, TopNumbers
from occontrol.numerics.linalg import symmetrise
from occontrol.scheduling.periodic.certificate import TreeProof, checked_bound
from occontrol.scheduling.periodic.drawn import drawn, mean_at_most, shares_of_phases
from occontrol.scheduling.periodic.potential import Cycle, cycle_of

PROOF = ("proof_words", "proof_points", "proof_potential", "proof_starts")


def solve(problem: PeriodicProblem, method: Periodic, monitor: Monitor) -> Solution:
    """The best cycle that was found, and what is proven for all schedules.

    Parameters
    ----------
    problem : PeriodicProblem
    method : its options
    monitor : Monitor

    Raises InfeasibleError where no schedule keeps the covariance bounded, SolveFailed where no cycle was found.
    """
    began = stopwatch.seconds()
    setting = setting_of(problem)
    proven = prove(problem, setting, method, monitor)
    proof = None if proven.tree is None else proven.tree.proof(setting.root)
    tree_bound = None
    if proven.tree is not None and proof is not None:
        # two codes whose rounding differs: what stands is what both prove
        checked = checked_bound(proof, setting.filled.letters, setting.filled.smallest)
        tree_bound = min(proven.tree.bound, checked) if np.isfinite(checked) else None
    bounds = {"averaged": proven.averaged.lower_bound, "tree": tree_bound}
    best = max(b for b in bounds.values() if b is not None)
    ended = "" if proven.tree is None else _how(proven, method, monitor)
    extra: PlainDict = {
        "complete_to": proven.found.complete_to,
        "cycles": proven.found.looked,
        "by_period": {str(p): cost for p, cost in sorted(proven.found.by_period.items())},
        "potential": proven.potential or None,
    }
    reached = (proven.cycle.cost - best) <= method.relative_gap * abs(proven.cycle.cost)
    status = Status.CERTIFIED if reached else Status.FEASIBLE
    if monitor.interrupted:
        status, ended = Status.INTERRUPTED, f"{Status.INTERRUPTED.text} "
    return assemble(
        problem, method.name, setting, proven.cycle, bounds, proof, status, ended, extra,
        shares_of(problem, proven.averaged.shares), monitor, began, 0 if proven.tree is None else proven.tree.count,
    )  # fmt: skip


def solve_drawn(problem: PeriodicProblem, method: Shares, monitor: Monitor) -> Solution:
    """One draw by the shares of the averaged optimum, repeated for ever, beside the averaged bound.

    Parameters
    ----------
    problem : PeriodicProblem
    method : its options
    monitor : Monitor

    Raises InfeasibleError where no shares keep the covariance bounded, SolveFailed where the draw does not.
    """
    began, setting = stopwatch.seconds(), setting_of(problem)
    averaged = averaged_of(problem, setting)
    shares = shares_of_phases(averaged.shares, setting.phases)
    cycle = cycle_of(setting.letters, drawn(shares, -(-method.steps // problem.phases), method.seed))
    if cycle is None:
        raise SolveFailed("the covariance along the draw has no limit\n  hint: another seed, or more steps")
    at_most = mean_at_most(setting.letters, shares)
    mean = f"at most {at_most:.7g}" if np.isfinite(at_most) else "more than any number that could be found"
    ended = f"Drawn for ever it costs {mean} in the mean; this is one draw of {plural(len(cycle.word), 'step')}. "
    bounds: dict[str, float | None] = {"averaged": averaged.lower_bound, "tree": None}
    reached = cycle.cost - averaged.lower_bound <= method.relative_gap * abs(cycle.cost)
    extra: PlainDict = {"mean_at_most": at_most if np.isfinite(at_most) else None, "seed": method.seed}
    return assemble(
        problem, method.name, setting, cycle, bounds, None, Status.CERTIFIED if reached else Status.FEASIBLE, ended,
        extra, shares_of(problem, averaged.shares), monitor, began, 0,
    )  # fmt: skip


def _how(proven: Proven, method: Periodic, monitor: Monitor) -> str:
    """Why the proof ended before its target; empty where it did not."""
    if proven.tree is None or monitor.interrupted:
        return ""
    if proven.cycle.cost - proven.tree.bound <= method.relative_gap * abs(proven.cycle.cost):
        return ""
    if monitor.timed_out:
        return "time_limit came before the target gap. "
    if proven.tree.count >= method.max_nodes:
        return "max_nodes came before the target gap. "
    return "The proof could not be split further. "


def shares_of(problem: PeriodicProblem, shares: np.ndarray) -> dict[str, float]:
    """{sensor: share of the time} of the averaged optimum.

    Parameters
    ----------
    problem : PeriodicProblem
    shares : (A,) of its choices
    """
    used = shares @ problem.weights_of(range(len(problem.choices)))
    return {s.name: float(x) for s, x in zip(problem.sensors, used, strict=True)}


def assemble(
    problem: PeriodicProblem, name: str, setting: Setting, cycle: Cycle, bounds: dict[str, float | None],
    proof: TreeProof | None, status: Status, ended: str, extra: PlainDict, shares: dict[str, float], monitor: Monitor,
    began: float, nodes: int,
) -> Solution:  # fmt: skip
    """The Solution of a cycle and its bounds, checked by the plain filter.

    Parameters
    ----------
    problem : PeriodicProblem
    name : of the method
    setting : of the problem
    cycle : in the units of `setting.letters`
    bounds : averaged and tree
    proof : the tree, or None
    status : how it ended, before the check
    ended : the same in words
    extra : further entries of result.json
    shares : of the averaged optimum, by sensor
    monitor : Monitor
    began : stopwatch.seconds() at the start
    nodes : words that the proof looked at
    """
    root, word = setting.root, cycle.word
    priors = symmetrise(root @ cycle.priors @ root.T)
    plain = plain_cycle(problem, word, priors[0])
    bound = max(b for b in bounds.values() if b is not None)
    certificate = Certificate(cycle.cost, bound)
    status, message = _checked(problem, cycle.cost, priors[0], plain, status)
    if status is not Status.DISAGREES:
        whole = "" if problem.sensing != "rate" else f", if changes are {problem.step:g} apart or a multiple of it"
        rules = "" if problem.limits is None else " The bound holds without the rules, too."
        message = f"{ended}No schedule costs less than {rounded_down(bound, 7)} a {problem.per} in the long run{whole}."
        message += rules
    letters = [problem.letters[a] for a in word]
    edges = problem.step * np.arange(len(word) + 1)
    weights = problem.weights_of([int(a) for a in word])
    schedule = problem.make_schedule(edges, weights)
    of = "grid" if problem.sensing == "rate" else "problem"
    continuous = None
    if problem.sensing == "rate":
        averaged = bounds["averaged"]
        least = -np.inf if averaged is None else averaged
        continuous = ContinuousNumbers(plain.cost, least, (plain.cost - least) / abs(plain.cost))
    numbers = AthansResult(
        name=problem.name,
        top=TopNumbers(certificate.cost, certificate.lower_bound, certificate.relative_gap, of),
        cost=certificate.cost,
        lower_bound=certificate.lower_bound,
        relative_gap=certificate.relative_gap,
        allowance=1e-11 * abs(bound),
        observation_cost=plain.observation,
        cost_weight=problem.cost_weight,
        running_cost=plain.running,
        prediction_error=0.0,
        predicted_mean_square_error=0.0,
        continuous=continuous,
        discretisation_error=None,
        relaxed_cost=float(bounds["averaged"] if bounds["averaged"] is not None else bound),
        relaxed_lower_bound=float(bounds["averaged"] if bounds["averaged"] is not None else bound),
        singular_fraction=None,
        intervals=len(word),
        readings=None if problem.sensing == "rate" else len(word),
        integration_steps=None,
        integration_error=None,
        added_edges=None,
        warnings=[],
        switches=int(np.sum(word != np.roll(word, 1))) if len(word) > 1 else 0,
        sweeps={},
        extra=extra,
        schedule=schedule.segments(),
        proven_optimal=certificate.relative_gap <= 1e-9,
        nodes=nodes,
        period=len(word),
        word=letters,
        bounds=bounds,
        leaves=0 if proof is None else len(proof.words),
        shares=shares,
    )
    after = _posteriors(setting, cycle, root)
    way = transient(setting.filled.letters, word, priors, symmetrise(problem.plant.covariance))
    extra["transient_steps"] = way.steps
    arrays = {
        "times": edges[:-1] if problem.sensing != "rate" else edges,
        "edges": edges,
        "weights": weights,
        "covariance": after if problem.sensing != "rate" else priors,
        "prior_covariance": priors,
        "transient_covariance": way.priors,
        "gain": _gains(problem, word, after if problem.sensing != "rate" else priors[:-1]),
    }
    if proof is not None:
        kept = proof.words.astype(np.int16), proof.points, proof.potential, proof.starts.astype(np.int16)
        arrays |= dict(zip(PROOF, kept, strict=True))
    return make_solution(
        problem=problem, method=name, status=status, message=message, iterations=nodes, numbers=numbers,
        monitor=monitor, began=began, arrays=arrays, schedule=schedule, certificate=certificate,
    )  # fmt: skip


def _posteriors(setting: Setting, cycle: Cycle, root: np.ndarray) -> np.ndarray:
    """(p, n, n) covariances after the readings of a cycle, in the units of the problem."""
    eye = np.eye(setting.letters.states)
    S = cycle.priors[:-1]
    after = np.linalg.solve(eye + S @ setting.letters.L[cycle.word], S)
    return symmetrise(root @ symmetrise(after) @ root.T)


def _gains(problem: PeriodicProblem, word: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """K = S C' Theta^-1 (p, n, m) of each step, the values of its sensors one below the other, padded with zeros."""
    used = [[s for s in problem.sensors if s.rows and s.name in problem.choices[a]] for a in word]
    gain = np.zeros((len(word), problem.states, max(sum(s.rows for s in step) for step in used)))
    for k, step in enumerate(used):
        first = 0
        for s in step:
            own = np.linalg.solve(s.noise.at(0.0), s.C.at(0.0)) @ covariance[k]
            gain[k, :, first : first + s.rows] = own.T
            first += s.rows
    return gain


def _checked(
    problem: PeriodicProblem, cost: float, start: np.ndarray, plain: PlainCycle, status: Status
) -> tuple[Status, str]:
    """`disagrees` and why, where the plain filter comes to another cost or does not come back to where it began."""
    scale = np.sqrt(np.outer(np.diag(start), np.diag(start)))
    apart = float(np.max(np.abs(plain.back - start) / np.maximum(scale, 1e-300)))
    if not abs(plain.cost - cost) <= AGREE * abs(cost) or not apart <= 100 * AGREE:
        return Status.DISAGREES, (
            f"the cycle is said to cost {cost:.12g} a {problem.per}, an independent covariance filter says "
            f"{plain.cost:.12g}, and comes back to within {apart:.1g}: do not trust either"
        )
    return status, ""
