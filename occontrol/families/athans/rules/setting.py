"""A problem with rules made ready for the search: what is minimised, steps of integration, the recursion's columns.

With rules nothing may be extrapolated and no edge be added: cost and bound are those of one convex recursion, with the
fewest equal steps an interval (1, 2, 4, ..) that reach the accuracy for the policy that favours no sensor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.statement import resolve
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.rules.builder import TooManyStates
from occontrol.scheduling.rules.oracle import Oracle
from occontrol.scheduling.rules.rules import Rules
from occontrol.scheduling.rules.task import Goal, Task
from occontrol.scheduling.sweep import Sweep

MOST_PARTS = 64  # steps on an interval
MOST_STEPS = 100_000  # in all

GOALS = {"cost": Goal(1.0, 1.0), "error": Goal(0.0, 1.0), "observation": Goal(1.0, 0.0)}


def rules_of(problem: SchedulingProblem) -> Rules:
    """The rules of a problem as numbers.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    rules = resolve(problem.rules, problem.sensors, problem.select, float(problem.elapsed[-1]))
    return replace(rules, least=problem.least)


def oracle_of(problem: SchedulingProblem, rules: Rules | None = None) -> Oracle:
    """The oracle of a problem's rules, or of others in their place.

    Parameters
    ----------
    problem : SchedulingProblem
    rules : Rules, or None for the problem's own

    Raises UsageError where the rules need more states than it can hold.
    """
    try:
        return Oracle(rules or rules_of(problem), problem.edges, problem.upper)
    except TooManyStates:
        what = "these rules on this many sensors and intervals need more states than can be searched"
        raise UsageError(f"{what}\n  hint: fewer intervals, or fewer sensors with times of their own") from None
    except ValueError as error:
        raise UsageError(f"{error}, rules cannot be searched\n  hint: fewer sensors, or a smaller select") from None


def prepared(problem: SchedulingProblem, relative_gap: float) -> SchedulingProblem:
    """The problem whose recursion the search works on.

    Parameters
    ----------
    problem : SchedulingProblem
    relative_gap : of the method, from which the accuracy follows
    """
    weight = {"cost": problem.cost_weight, "error": 0.0, "observation": 1.0}[problem.minimise]
    parts = problem.integration.substeps or _parts(problem, relative_gap)
    integration = replace(problem.integration, substeps=parts, accuracy=None)
    found = replace(problem, cost_weight=weight, integration=integration)
    for name in ("added_edges", "warnings"):  # the edges are there already
        object.__setattr__(found, name, getattr(problem, name))
    return found


def _parts(problem: SchedulingProblem, relative_gap: float) -> int:
    accuracy, v = problem.integration.target(relative_gap), feasible_set(problem).uniform()

    def cost(parts: int) -> float:
        integration = replace(problem.integration, substeps=parts, accuracy=None)
        return Integrator(replace(problem, integration=integration), relative_gap).fixed.cost(v)

    parts, here = 1, cost(1)
    while parts < MOST_PARTS and 2 * parts * problem.intervals <= MOST_STEPS:
        finer = cost(2 * parts)
        if 4 / 3 * abs(here - finer) <= accuracy * abs(finer):
            break
        parts, here = 2 * parts, finer
    return parts


@dataclass(frozen=True, eq=False)
class Setting:
    """What a search under rules needs of a problem.

    Parameters
    ----------
    problem : from `prepared`, perhaps in balanced states
    integrator : of it
    task : for the search
    recursion : the task's, with a column for every sensor and one more for each that warms up
    rates : (N, M) observation cost of a sensor on an interval, not weighted
    """

    problem: SchedulingProblem
    integrator: Integrator
    task: Task
    recursion: Recursion
    rates: np.ndarray


def setting_of(problem: SchedulingProblem, integrator: Integrator) -> Setting:
    """The setting of a prepared problem.

    Parameters
    ----------
    problem : from `prepared`
    integrator : of it
    """
    rules = rules_of(problem)
    oracle = oracle_of(problem, rules)
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
    task = Task(rules, problem.edges, oracle, Sweep(recursion), rates, GOALS[problem.minimise])
    return Setting(problem, integrator, task, recursion, rates)


def with_warming(recursion: Recursion, warmers: np.ndarray) -> Recursion:
    """The recursion with further columns for sensors that are on and measure nothing yet.

    Parameters
    ----------
    recursion : Recursion with M sensors
    warmers : (W,) of which sensors
    """
    if not len(warmers):
        return recursion
    return replace(
        recursion,
        offsets=np.concatenate([recursion.offsets, np.repeat(recursion.offsets[-1:], len(warmers))]),
        cost=np.ascontiguousarray(np.concatenate([recursion.cost, recursion.cost[:, warmers]], axis=1)),
        available=np.concatenate([recursion.available, recursion.available[:, warmers]], axis=1),
    )


def user_weights(on: np.ndarray, rules: Rules) -> np.ndarray:
    """(N, M) weights as they stand in a schedule, for what is on (N, M); above select 1 idle fills the rest."""
    weights = on.astype(float)
    if rules.select > 1 and np.any(rules.idle):
        weights[:, int(np.flatnonzero(rules.idle)[0])] = rules.select - np.sum(on, axis=1)
    return weights


def on_of(weights: np.ndarray, rules: Rules) -> np.ndarray:
    """(N, M) what is on in integral weights (N, M); 'idle' counts where select is 1."""
    on = weights > 0.5
    if rules.select > 1:
        on[:, rules.idle] = False
    return on
