"""The best cycle of a problem without an end, and the proof for all schedules beside it.

First the averaged bound, then cycles, then the tree: its potential is the one under which a small tree proves most, of
the averaged optimum and of the best cycle. It grows until its bound reaches the target, or a limit comes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import InfeasibleError, SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.families.athans.periodic.fill import Filled, fill, parts_of
from occontrol.families.athans.periodic.limits import cycle_rules
from occontrol.families.athans.periodic.method import Periodic
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.scheduling.periodic.averaged import Averaged, averaged_flow, averaged_steps
from occontrol.scheduling.periodic.cycles import CycleRules, Found, search
from occontrol.scheduling.periodic.letters import Letters
from occontrol.scheduling.periodic.phases import Phases
from occontrol.scheduling.periodic.potential import Cycle, potentials
from occontrol.scheduling.periodic.tree import ProofTree

TRIAL = 100  # words of a tree that judges a potential, for each letter
SLICE = 1.6  # growth of the tree from one report to the next
SEARCH_SHARE = 0.3  # of the time limit that the search for cycles may take
FINE = 0.05  # of the target gap: precision of a word's programme


@dataclass(frozen=True, eq=False)
class Setting:
    """A problem in two units: the user's, and those in which the smallest covariance is the identity.

    Parameters
    ----------
    filled : in the user's units
    letters : in the others
    root : (n, n) x = root z
    rules : what a cycle has to keep
    phases : which choices there are at which step
    """

    filled: Filled
    letters: Letters
    root: np.ndarray
    rules: CycleRules
    phases: Phases


@dataclass(frozen=True, eq=False)
class Proven:
    """What was found and proven.

    Parameters
    ----------
    averaged : the averaged bound, in continuous time for continuous sensing
    found : the search for cycles
    cycle : the best, in units in which the smallest covariance is the identity
    tree : the proof, or None where there was no time for any
    potential : in words, the one that was taken
    """

    averaged: Averaged
    found: Found
    cycle: Cycle
    tree: ProofTree | None
    potential: str


def setting_of(problem: PeriodicProblem) -> Setting:
    """The letters of a problem in both units.

    Parameters
    ----------
    problem : PeriodicProblem
    """
    filled = fill(problem)
    root = np.linalg.cholesky(filled.smallest)
    sensors = [s.name for s in problem.sensors]
    uses = np.array([[name in choice for name in sensors] for choice in problem.choices], dtype=np.int64)
    rules = cycle_rules(problem.limits, uses, sensors, problem.step)
    return Setting(filled, filled.letters.in_units(root), root, rules, Phases(problem.opened))


def averaged_of(problem: PeriodicProblem, setting: Setting) -> Averaged:
    """The averaged optimum; InfeasibleError where no shares keep the covariance bounded.

    Parameters
    ----------
    problem : PeriodicProblem
    setting : of the problem
    """
    if problem.sensing != "rate":
        return averaged_steps(setting.letters, setting.phases)
    parts, root = parts_of(problem), setting.root
    inverse = np.linalg.inv(root)
    A = inverse @ problem.flowing.A.at(0.0) @ root
    noise = inverse @ problem.flowing.noise.at(0.0) @ inverse.T
    gains, running = root.T @ parts.gains @ root, root.T @ parts.running @ root
    return averaged_flow(A, noise, gains, running, parts.prices, setting.phases)


def prove(problem: PeriodicProblem, setting: Setting, method: Periodic, monitor: Monitor) -> Proven:
    """Search and prove.

    Parameters
    ----------
    problem : PeriodicProblem
    setting : of the problem
    method : its options
    monitor : Monitor

    Raises InfeasibleError where no schedule keeps the covariance bounded, SolveFailed where no cycle was found.
    """
    monitor.stage = "averaged bound"
    averaged = averaged_of(problem, setting)
    monitor.stage = "cycles"
    limit = None if method.time_limit is None else SEARCH_SHARE * method.time_limit
    longest = max(method.max_period, setting.phases.count)
    child = monitor.child(limit, silent=True)
    found = search(setting.letters, longest, setting.rules, child, phases=setting.phases)
    if found.best is None:
        raise SolveFailed(_no_cycle(longest, problem.limits is not None))
    monitor.report(found.looked, found.best.cost, averaged.lower_bound)
    monitor.stage = "proof"
    tree, name = grow_proof(setting, averaged, found.best, method, monitor)
    return Proven(averaged, found, found.best, tree, name)


def grow_proof(
    setting: Setting, averaged: Averaged, cycle: Cycle, method: Periodic, monitor: Monitor
) -> tuple[ProofTree | None, str]:
    """The tree under the best potential, grown as far as limits allow, and what the potential is called.

    Parameters
    ----------
    setting : of the problem
    averaged, cycle : in units in which the smallest covariance is the identity
    method : its limits
    monitor : Monitor
    """
    letters, phases = setting.letters, setting.phases
    target = cycle.cost - method.relative_gap * abs(cycle.cost)
    if averaged.lower_bound >= target:
        return None, ""
    trees: dict[str, ProofTree] = {}
    candidates = {**potentials(letters, cycle, phases.count), "averaged optimum": averaged.potential}
    for name, Z in candidates.items():
        if not np.all(np.isfinite(Z)) or (trees and monitor.stop):
            continue
        trees[name] = ProofTree(letters, Z, cycle.cost, FINE * method.relative_gap, phases)
        trees[name].grow(target, min(TRIAL * letters.count * phases.count, method.max_nodes), monitor)
    if not trees:
        return None, ""
    name = max(trees, key=lambda key: trees[key].bound)
    tree = trees[name]
    while True:
        bound = max(tree.bound, averaged.lower_bound)
        monitor.report(tree.count, cycle.cost, bound)
        before = tree.count
        if tree.bound >= target or tree.count >= method.max_nodes or monitor.stop:
            return tree, name
        tree.grow(target, min(int(SLICE * tree.count), method.max_nodes), monitor)
        if tree.count == before:
            return tree, name


def require_bounded(problem: PeriodicProblem) -> None:
    """Raise InfeasibleError where no schedule keeps the covariance bounded for ever.

    Parameters
    ----------
    problem : PeriodicProblem
    """
    averaged_of(problem, setting_of(problem))


def unbounded(names: list[str]) -> InfeasibleError:
    """The mistake of a cycle whose covariance has no limit, for the `names` of its letters."""
    what = f"the covariance of the cycle {' '.join(names)} has no limit"
    return InfeasibleError(f"{what}: it does not see all that grows")


def _no_cycle(period: int, ruled: bool) -> str:
    rules = " and the rules" if ruled else ""
    what = f"no cycle of up to {period} step{'s' * (period != 1)} keeps the covariance bounded{rules}"
    return f"{what}\n  hint: method: {{name: periodic, max_period: ..}} longer"
