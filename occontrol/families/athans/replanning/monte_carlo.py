"""Policies of a problem of readings side by side on simulated runs; every policy meets the same truths and noises."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from occontrol.core.errors import SolveFailed, UsageError, suggest
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution
from occontrol.families.abilities import Work
from occontrol.families.athans.nonlinear.linearise import Replanning
from occontrol.families.athans.readings.filter import weights_on
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.replanning import policies as kinds
from occontrol.families.athans.replanning.chain import LinearChain, NonlinearChain, chain_of
from occontrol.families.athans.replanning.runs import Charges, Truths, luck_of, run
from occontrol.scheduling.closed_loop.comparison import BATCH, Comparison, Flown, Seeds, compare_runs

POLICIES = (
    "nominal",
    "replanned",
    "greedy",
    "greedy-information",
    "eigenspace",
    "round-robin",
    "best-single",
    "random",
)


def applicable(problem: ReadingsProblem) -> list[str]:
    """The policies that a problem has words for.

    Parameters
    ----------
    problem : ReadingsProblem
    """
    blind = problem.budget is not None or problem.ruled  # a rule that looks one reading ahead keeps neither
    left = set(POLICIES) - {"nominal", "replanned"} if blind else set()
    if problem.rules is not None and problem.rules.max_error is not None:
        left.add("replanned")
    return [name for name in POLICIES if name not in left]


def make_policy(
    name: str, problem: ReadingsProblem, chain: LinearChain | NonlinearChain, solution: Solution
) -> kinds.Policy:
    """The policy of a name.

    Parameters
    ----------
    name : of POLICIES
    problem : ReadingsProblem
    chain : of it
    solution : with the nominal plan

    Raises UsageError for another name, SolveFailed where the solution has no schedule.
    """
    if name in ("nominal", "replanned"):
        if solution.schedule is None:
            raise SolveFailed("the solution has no schedule to fly")
        nominal = weights_on(problem, solution.schedule)
        if name == "nominal":
            return kinds.Scheduled(name, nominal, solution.arrays.get("measuring"))
        stated = getattr(getattr(problem.plant, "linearised", None), "replan", None)
        shares = solution.arrays.get("relaxed_weights")
        shares = None if shares is None else np.asarray(shares)[problem.first_readings]
        return kinds.Replanned(chain, nominal, stated or Replanning(every=5), shares)
    if name in ("round-robin", "best-single"):
        return kinds.Scheduled(name, _baseline(name, problem))
    for kind in (kinds.Greedy, kinds.GreedyInformation, kinds.Eigenspace, kinds.RandomChoice):
        if kind.name == name:
            return kind(chain)
    raise UsageError(f"there is no policy '{name}'\n  hint: {suggest(name, POLICIES)}")


def _baseline(name: str, problem: ReadingsProblem) -> np.ndarray:
    """(N, M) of every reading, as the method of that name makes it."""
    from occontrol.families.athans.methods import METHODS
    from occontrol.families.athans.readings.fill import feasible_set, fill
    from occontrol.scheduling.sweep import Sweep

    weights = METHODS[name]().policy(Sweep(fill(problem).recursion), feasible_set(problem))
    owner = problem.clock.owner
    return weights if owner is None else weights[owner]


def simulated(problem: ReadingsProblem, solution: Solution, names: Sequence[str], seeds: Seeds) -> Flown:
    """Outcomes of a few runs of each policy, and the milliseconds of its decisions.

    Parameters
    ----------
    problem : ReadingsProblem
    solution : whose schedule is the nominal plan
    names : of the policies
    seeds : one a run

    Raises SolveFailed where the solution has no schedule.
    """
    chain = chain_of(problem)
    truths, charges = Truths(chain, luck_of(chain, seeds)), Charges(chain)
    found, times = {}, {}
    for name in names:
        policy = make_policy(name, problem, chain, solution)
        found[name] = run(chain, policy, truths, charges)
        times[name] = policy.milliseconds
    return found, times


def compare(
    problem: ReadingsProblem,
    solution: Solution,
    names: Sequence[str] | None,
    runs: int,
    seed: int,
    monitor: Monitor,
    work: Work | None = None,
    batch: int = BATCH,
    early: bool = True,
) -> Comparison:
    """Runs of policies side by side.

    Parameters
    ----------
    problem : ReadingsProblem
    solution : whose schedule is the nominal plan
    names : of the policies; None: all that apply
    runs : at most so many of each
    seed : of all of them
    monitor : Monitor
    work : does batches of seeds, for example in several processes; None: here, one after the other
    batch : runs at once; the numbers do not depend on it
    early : whether it may end before all runs are made

    Raises UsageError for continuous sensing, unknown policies and those that do not apply.
    """
    chain_of(problem)
    able = applicable(problem)
    chosen = list(able if names is None else names)
    for name in chosen:
        if name not in POLICIES:
            raise UsageError(f"there is no policy '{name}'\n  hint: {suggest(name, POLICIES)}")
        if name not in able:
            raise UsageError(f"policy '{name}' does not keep these rules and budgets\n  hint: {', '.join(able)}")

    def fly(pieces: Sequence[Seeds]) -> Iterable[Flown]:
        return work(chosen, pieces) if work else (simulated(problem, solution, chosen, piece) for piece in pieces)

    return compare_runs(problem.name, chosen, runs, seed, fly, monitor, batch, early)
