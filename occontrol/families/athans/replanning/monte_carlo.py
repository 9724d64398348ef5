"""Policies side by side on simulated runs: their errors with confidence, divergence, consistency, and a verdict.

Runs are paired: every policy meets the same truths and noises, so differences need fewer runs than errors. Looks at
fixed numbers of runs may end it early: the difference in cost to `nominal` of every other policy is then further from
0 than z standard errors, or these are inside the margin, with z of a two-sided error of ERROR shared by all looks.
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
from occontrol.families.family import Work

POLICIES = ("nominal", "replanned", "greedy", "greedy-information", "round-robin", "best-single", "random")
BATCH = 50
FIRST_LOOK, LOOK = 100, 100  # runs
ERROR = 0.05  # two-sided, of all looks together
MARGIN = 0.01  # of the nominal cost: a smaller difference is none
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
    blind = problem.budget is not None or problem.rules is not None  # a rule that looks one reading ahead keeps neither
    left = {"greedy", "greedy-information", "round-robin", "best-single", "random"} if blind else set()
    if problem.rules is not None:
        left.add("replanned")
    return [name for name in POLICIES if name not in left]


def make_policy(
    name: str, problem: ReadingsProblem, chain: LinearChain | NonlinearChain, nominal: np.ndarray
) -> kinds.Policy:
    """The policy of a name.

    Parameters
    ----------
    name : of POLICIES
    problem : ReadingsProblem
    chain : of it
    nominal : (N, M) the plan

    Raises UsageError for another name.
    """
    if name == "nominal":
        return kinds.Scheduled(name, nominal)
    if name == "replanned":
        stated = getattr(getattr(problem.plant, "linearised", None), "replan", None)
        return kinds.Replanned(chain, nominal, stated or Replanning(every=5))
    if name in ("round-robin", "best-single"):
        return kinds.Scheduled(name, _baseline(name, problem))
    for kind in (kinds.Greedy, kinds.GreedyInformation, kinds.RandomChoice):
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
    if solution.schedule is None:
        raise SolveFailed("the solution has no schedule to fly")
    nominal = weights_on(problem, solution.schedule)
    truths, charges = Truths(chain, luck_of(chain, seeds)), Charges(chain)
    found, times = {}, {}
    for name in names:
        policy = make_policy(name, problem, chain, nominal)
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
            raise UsageError(f"policy '{name}' keeps no rules and budgets\n  hint: {', '.join(able)}")
    seeds = np.random.SeedSequence(seed).spawn(runs)
    parts: dict[str, list[Outcomes]] = {name: [] for name in chosen}
    times: dict[str, list[float]] = {name: [] for name in chosen}
    done, decided = 0, False
    looks = list(range(FIRST_LOOK, runs, LOOK)) if early else []
    for end in [*looks, runs]:
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
        if monitor.stop or (end < runs and _decided(whole, len(looks) + 1)):
            decided = not monitor.stop
            break
    table = {name: _numbers(whole[name], whole.get("nominal"), times[name]) for name in chosen}
    return Comparison(problem.name, done, seed, _verdict(table, done, runs, decided), decided, table)


def _quantile(looks: int) -> float:
    from scipy.special import ndtri

    return float(ndtri(1 - ERROR / (2 * looks)))


def _decided(found: dict[str, Outcomes], looks: int) -> bool:
    """Whether every difference to the nominal plan is known."""
    base = found.get("nominal")
    if base is None or len(found) < 2:
        return False
    z = _quantile(looks * (len(found) - 1))
    margin = MARGIN * float(np.mean(base.cost))
    for name, other in found.items():
        if name != "nominal":
            difference = other.cost - base.cost
            if not np.all(np.isfinite(difference)):
                return False
            mean, error = float(np.mean(difference)), _standard_error(difference)
            if not (abs(mean) > z * error or z * error < margin):
                return False
    return True


def _standard_error(values: np.ndarray) -> float:
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")


def _numbers(own: Outcomes, nominal: Outcomes | None, milliseconds: list[float]) -> PlainDict:
    finite = np.isfinite(own.error)
    error = own.error[finite]
    found: PlainDict = {
        "mean": float(np.mean(error)) if len(error) else None,
        "median": float(np.median(own.error)),
        "standard_error": _standard_error(error) if len(error) > 1 else None,
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
        found["difference_error"] = _standard_error(difference) if len(difference) > 1 else None
    return found


def _verdict(table: PlainDict, done: int, runs: int, decided: bool) -> str:
    """In words what the numbers say; replanning first."""
    said = []
    nominal = table.get("nominal")
    for name, row in table.items():
        if nominal is None or name == "nominal" or row.get("difference_error") is None:
            continue
        if not row["difference_error"]:
            said.append(f"{name}: the nominal plan itself" + (": replanning does not pay" * (name == "replanned")))
            continue
        z = row["difference"] / row["difference_error"]
        base = abs(nominal["cost"] or float("nan"))
        share, interval = row["difference"] / base, 1.96 * row["difference_error"] / base
        if abs(z) < 1.96:
            text = f"no difference to the nominal plan is seen ({share:+.2%} +- {interval:.2%})"
        else:
            text = f"{'less' if z < 0 else 'more'} cost than the nominal plan ({share:+.2%} +- {interval:.2%})"
        if name == "replanned":
            pays = z < -1.96 and row["diverged"] <= nominal["diverged"]
            text += ": replanning pays" if pays else ": replanning does not pay"
            if row["diverged"] > nominal["diverged"]:
                text += f", {row['diverged']:.1%} of its runs diverged, {nominal['diverged']:.1%} of the nominal plan's"
        said.append(f"{name}: {text}")
    ended = f"decided after {done} runs" if decided else f"{done} runs"
    return f"{ended}. " + ("; ".join(said) + "." if said else "")
