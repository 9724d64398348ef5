"""What the command line prints about a robust problem and its solution."""

from __future__ import annotations

import numpy as np

from occontrol.core.measurement import Estimate
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.core.trajectory import Trajectory
from occontrol.families.robust.balanced import balanced
from occontrol.families.robust.escape import free_weights, gain_that_fits
from occontrol.families.robust.observability import observability, share_of_weight, uniformly_observable
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.result import SequenceResult, SharesResult, UnobservableResult, numbers_of


def summarise(problem: Problem, solution: Solution) -> list[tuple[str, str]]:
    """The lines after a solve.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    """
    r = numbers_of(solution)
    lines = [("method", f"{solution.method}, {solution.seconds:.2f} s")]
    if isinstance(r, UnobservableResult):
        reach, time = r.observability_horizon, r.escape_time
        lines.append(("horizon", "unknown" if reach is None else f"observable before t = {reach:.12g}"))
        lines.append(("K", f"observable when multiplied by less than {r.gain_factor:.6g}"))
        if r.followed:
            lines.append(("schedule", "P lives to the end" if time is None else f"P escapes at t = {time:.12g}"))
    elif isinstance(r, SequenceResult | SharesResult):
        lines += [
            (problem.measure.text, f"{r.cost:.10g}   (level {r.level:.10g})"),
            ("lower bound", f"{rounded_down(r.lower_bound, 10)}   gap {100 * max(r.relative_gap, 0.0):.3g} %"),
        ]
        if isinstance(r, SequenceResult):
            lines += _about_sequence(problem, r)
        lines.append(("horizon", _reach(r.observability_horizon, r.observability_followed_to)))
    return lines


def _about_sequence(problem: Problem, r: SequenceResult) -> list[tuple[str, str]]:
    lines = []
    if r.nodes is not None:
        lines.append(("nodes", f"{r.nodes} of {len(problem.sensors)}^{problem.slots} sequences"))
    if r.one_step_cost is not None:
        above = 100 * (r.one_step_cost / r.cost - 1)
        lines.append(("one step", f"{r.one_step_cost:.10g}, {above:.3g} % above"))
    if r.worst_cost is not None:
        lines.append(("worst", f"{r.worst_cost:.10g}"))
    if r.sequence:
        lines.append(("sequence", " ".join(r.sequence[:40]) + (" .." if len(r.sequence) > 40 else "")))
    return lines


def _reach(reach: float | None, followed: float | None) -> str:
    if reach is not None:
        return f"observable before t = {reach:.10g}"
    return "observable for ever" if followed is None else f"observable up to t = {followed:.6g} at least"


def describe(problem: Problem) -> list[tuple[str, str]]:
    """What `check` prints: sizes, observability, an estimate of work.

    Parameters
    ----------
    problem : Problem
    """
    n, N, M = problem.states, problem.slots, len(problem.sensors)
    lines = [
        ("size", f"{n} states, {M} sensors, {N} slots on [{problem.edges[0]:g}, {problem.edges[-1]:g}]"),
        ("sensors", ", ".join(f"{s.name} ({s.rows})" for s in problem.sensors)),
        ("small at the end", problem.measure.text),
    ]
    if problem.measure.homogeneous(n):
        lines.append(("measurements", "cannot change the best schedule: the size is homogeneous in the level"))
    else:
        lines.append(("measurements", "may change the best schedule on-line: the size is not homogeneous in the level"))
    inner = balanced(problem)
    reach, followed = observability(inner)
    free = free_weights(inner.plant_flow, inner.edges)
    if uniformly_observable(inner) and free is not None:
        share = share_of_weight(inner.plant.weight, free[0])
        words = f"uniform, X at the start reaches {share:.4g} of the weight; {_reach(reach, followed)}"
        lines.append(("observability", words))
    else:
        factor = gain_that_fits(inner.plant_flow, inner.plant.weight, inner.edges)
        lines.append(("observability", f"NOT uniform on this horizon: it ends before t = {reach:.12g}"))
        lines.append(("K", f"would have to be multiplied by less than {factor:.6g}"))
    lines.append(("work", f"{M}^{N} = {float(M) ** N if N * np.log10(M) < 300 else np.inf:.3g} sequences; "
                          f"the search looks at a few times {N * M} nodes in the good case"))  # fmt: skip
    return lines


def truth_remark(estimate: Estimate, truth: Trajectory, source: object) -> str:
    """Whether the set of possible states held the truth at every time.

    Parameters
    ----------
    estimate : Estimate of the set-membership estimator
    truth : Trajectory at the estimate's times
    source : the file that it came from
    """
    away = truth.values - estimate.mean
    share = np.array([x @ np.linalg.pinv(S) @ x for x, S in zip(away, estimate.covariance, strict=True)])
    inside = int(np.sum(share <= 1 + 1e-9))
    return (
        f"{inside} of {len(share)} true states in {source} lie inside the set; the closest call uses "
        f"{100 * float(np.sqrt(np.max(share))):.4g} % of the way to its edge"
    )
