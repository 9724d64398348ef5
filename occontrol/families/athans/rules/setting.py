"""A problem with rules made ready for the search: what is minimised, steps of integration, the recursion's columns.

With rules nothing may be extrapolated and no edge be added: cost and bound are those of one convex recursion, with the
fewest equal steps an interval (1, 2, 4, ..) that reach the accuracy for the policy that favours no sensor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.integration.local_error import step_errors
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.columns import with_warming
from occontrol.families.athans.rules.frame import Frame
from occontrol.families.athans.rules.statement import resolve
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.rules.rules import Rules
from occontrol.scheduling.rules.task import Goal, Task
from occontrol.scheduling.sweep import Sweep

MOST_PARTS = 64  # steps on an interval
MOST_STEPS = 100_000  # in all
PASSES, FASTEST = 6, 8  # how often their number is chosen anew, and by what factor it may grow at once
HALF = 0.5  # of the accuracy: what the errors of a uniform policy may add up to, others err more

GOALS = {"cost": Goal(1.0, 1.0), "error": Goal(0.0, 1.0), "observation": Goal(1.0, 0.0)}


def rules_of(problem: SchedulingProblem) -> Rules:
    """The rules of a problem as numbers.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    rules = resolve(problem.rules, problem.sensors, problem.select, float(problem.elapsed[-1]))
    return replace(rules, least=problem.least)


def frame_of(problem: SchedulingProblem) -> Frame:
    """What rules ask of a problem of continuous sensing; its observation costs are those at midpoints.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    edges = problem.edges
    rates = np.column_stack([s.cost.sample(problem.midpoints)[:, 0, 0] for s in problem.sensors])
    return Frame(
        rules_of(problem),
        edges,
        problem.upper,
        rates * problem.steps[:, None],
        lambda k: f"the interval from t = {edges[k]:.6g} to {edges[k + 1]:.6g}",
        f"t = {edges[-1]:.6g}",
    )


def prepared(problem: SchedulingProblem, relative_gap: float) -> SchedulingProblem:
    """The problem whose recursion the search works on.

    Parameters
    ----------
    problem : SchedulingProblem
    relative_gap : of the method, from which the accuracy follows
    """
    weight = {"cost": problem.cost_weight, "error": 0.0, "observation": 1.0}[problem.minimise]
    charged = weight if problem.minimise == "cost" else 0.0
    parts = problem.integration.substeps or _parts(problem, charged, relative_gap)
    integration = replace(problem.integration, substeps=parts, accuracy=None)
    found = replace(problem, cost_weight=weight, integration=integration)
    for name in ("added_edges", "warnings"):  # the edges are there already
        object.__setattr__(found, name, getattr(problem, name))
    return found


def _parts(problem: SchedulingProblem, cost_weight: float, relative_gap: float) -> int | tuple[int, ...]:
    """Steps for each interval that make what is integrated accurate; prices that do not count may not hide its error.

    The error of an interval falls with the square of its number of steps c, so c ~ error^(1/3) takes the fewest.
    """
    accuracy, v = problem.integration.target(relative_gap), feasible_set(problem).uniform()
    counts = np.ones(problem.intervals, dtype=np.int64)
    for _ in range(PASSES):
        integration = replace(problem.integration, substeps=tuple(counts.tolist()), accuracy=None)
        integrator = Integrator(replace(problem, cost_weight=cost_weight, integration=integration), relative_gap)
        on = integrator.extrapolated(integrator.fixed.mesh)
        J, _ = on.cost_and_gradient(v)
        if not (np.isfinite(J) and on.whole.keeps_all):
            break
        errors = on.whole.gathered(np.abs(4 / 3 * step_errors(on.whole, on.half, v)))
        allowed = accuracy * abs(J)
        if float(np.sum(errors)) <= allowed or not np.all(np.isfinite(errors)) or allowed == 0:
            break
        root = np.cbrt(errors * counts**2)
        wanted = root * np.sqrt(np.sum(root) / (HALF * allowed))
        allowed_counts = np.clip(wanted, counts, np.minimum(FASTEST * counts, MOST_PARTS))
        finer = 2 ** np.ceil(np.log2(allowed_counts)).astype(np.int64)
        if np.array_equal(finer, counts) or np.sum(finer) > MOST_STEPS:
            break
        counts = finer
    most = int(np.max(counts))
    return most if np.all(counts == most) else tuple(counts.tolist())


@dataclass(frozen=True, eq=False)
class Setting:
    """What a search under rules needs of a problem.

    Parameters
    ----------
    problem : from `prepared`, perhaps in balanced states
    integrator : of it
    task : for the search
    recursion : the task's, with a column for every sensor and one more for each that warms up
    """

    problem: SchedulingProblem
    integrator: Integrator
    task: Task
    recursion: Recursion


def setting_of(problem: SchedulingProblem, integrator: Integrator) -> Setting:
    """The setting of a prepared problem.

    Parameters
    ----------
    problem : from `prepared`
    integrator : of it
    """
    frame = frame_of(problem)
    rules = frame.rules
    plain = integrator.plain
    recursion = integrator.recursion if plain else integrator.fixed.shared
    if plain:
        middle, steps = problem.midpoints, problem.steps
    else:
        mesh = integrator.fixed.mesh
        steps = mesh.steps
        middle = float(problem.edges[0]) + mesh.starts + steps / 2
    rates = np.column_stack([s.cost.sample(middle)[:, 0, 0] for s in problem.sensors]) * steps[:, None]
    rates = recursion.by_decision(rates)
    recursion = with_warming(recursion, np.flatnonzero(rules.warm_up > 0))
    task = Task(rules, problem.edges, frame.oracle(), Sweep(recursion), rates, GOALS[problem.minimise])
    return Setting(problem, integrator, task, recursion)
