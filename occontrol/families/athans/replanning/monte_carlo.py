"""Policies side by side on simulated runs: their errors with confidence, divergence, consistency, and a verdict.

Runs are paired: every policy meets the same truths and noises, so differences need fewer runs than errors. Looks at
fixed numbers of runs may end it early, by the test of `sequential.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import SolveFailed, UsageError, suggest
from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.result import ResultData
from occontrol.core.solution import Solution
from occontrol.families.athans.nonlinear.linearise import Replanning
from occontrol.families.athans.readings.filter import weights_on
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.replanning import policies as kinds
from occontrol.families.athans.replanning.chain import LinearChain, NonlinearChain, chain_of
from occontrol.families.athans.replanning.runs import Charges, Outcomes, Truths, luck_of, run
from occontrol.families.athans.replanning.sequential import decided, looks_at, quantile, standard_error, verdict
from occontrol.families.family import Work

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
BATCH = 50
DIVERGED = 10.0  # mean NEES per state


@dataclass(frozen=True)
class Comparison(ResultData):
    """What a Monte Carlo comparison came to.

    Parameters
    ----------
    name : of the problem
    runs : that were made of each policy
    seed : of all of them
    verdict : in words
    decided : whether it ended before all runs were made
    policies : {name: {mean, median, standard_error, diverged, nees, nis, cost, lost, readings, late, milliseconds,
        difference, difference_error}}; `late` is the share of new plans that came after the deadline
    """

    name: str
    runs: int
    seed: int
    verdict: str
    decided: bool
    policies: PlainDict


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


def simulated(
    problem: ReadingsProblem, solution: Solution, names: Sequence[str], seeds: Sequence[np.random.SeedSequence]
) -> tuple[dict[str, Outcomes], dict[str, list[float]]]:
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
    seeds = np.random.SeedSequence(seed).spawn(runs)
    parts: dict[str, list[Outcomes]] = {name: [] for name in chosen}
    times: dict[str, list[float]] = {name: [] for name in chosen}
    done, ended = 0, False
    looks = looks_at(runs, early)
    z = quantile(len(looks), len(chosen) - 1)
    for end in looks:
        pieces = [seeds[a : min(a + batch, end)] for a in range(done, end, batch)]
        made = work(chosen, pieces) if work else (simulated(problem, solution, chosen, piece) for piece in pieces)
        for outcome, spent in made:
            for name in chosen:
                parts[name].append(outcome[name])
                times[name] += spent[name]
            if monitor.stop:
                break
        done = sum(len(part.error) for part in parts[chosen[0]])
        whole = {name: Outcomes.joined(parts[name]) for name in chosen}
        if monitor.stop or (end < runs and decided({name: part.cost for name, part in whole.items()}, z)):
            ended = not monitor.stop
            break
    table = {name: _numbers(whole[name], whole.get("nominal"), times[name]) for name in chosen}
    return Comparison(problem.name, done, seed, verdict(table, done, ended, z), ended, table)


def _numbers(own: Outcomes, nominal: Outcomes | None, milliseconds: list[float]) -> PlainDict:
    finite = np.isfinite(own.error)
    error = own.error[finite]
    found: PlainDict = {
        "mean": float(np.mean(error)) if len(error) else None,
        "median": float(np.median(own.error)),
        "standard_error": standard_error(error) if len(error) > 1 else None,
        "diverged": float(np.mean(~finite | (own.nees > DIVERGED))),
        "nees": float(np.mean(own.nees[np.isfinite(own.nees)])) if np.any(np.isfinite(own.nees)) else None,
        "nis": float(np.nanmean(own.nis)) if np.any(np.isfinite(own.nis)) else None,
        "cost": float(np.mean(own.cost[finite])) if len(error) else None,
        "lost": float(np.mean(own.lost)),
        "readings": float(np.mean(own.readings)),
        "late": float(np.sum(own.late) / np.sum(own.plans)) if np.any(own.plans) else None,
        "milliseconds": float(np.median(milliseconds)) if milliseconds else 0.0,
    }
    if nominal is not None and nominal is not own:
        both = finite & np.isfinite(nominal.error)
        difference = own.cost[both] - nominal.cost[both]
        found["difference"] = float(np.mean(difference)) if len(difference) else None
        found["difference_error"] = standard_error(difference) if len(difference) > 1 else None
    return found
