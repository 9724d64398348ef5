"""Policies side by side on simulated runs: their errors with confidence, divergence, consistency, and a verdict.

Runs are paired: every policy meets the same truths and noises as far as the simulation allows, so differences need
fewer runs than errors. Looks at fixed numbers of runs may end it early, by the test of `sequential.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.result import ResultData
from occontrol.scheduling.closed_loop.outcomes import Outcomes, numbers
from occontrol.scheduling.closed_loop.sequential import decided, looks_at, quantile, verdict

BATCH = 50
Seeds = Sequence[np.random.SeedSequence]
Flown = tuple[dict[str, Outcomes], dict[str, list[float]]]


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
    judged : what is compared: 'cost', or 'error' where nothing is paid
    """

    name: str
    runs: int
    seed: int
    verdict: str
    decided: bool
    policies: PlainDict
    judged: str = "cost"


def compare_runs(
    name: str,
    policies: Sequence[str],
    runs: int,
    seed: int,
    fly: Callable[[Sequence[Seeds]], Iterable[Flown]],
    monitor: Monitor,
    batch: int = BATCH,
    early: bool = True,
) -> Comparison:
    """Runs of policies side by side, batch after batch until the comparison is decided or all runs are made.

    Parameters
    ----------
    name : of the problem
    policies : their names; the nominal plan is called 'nominal'
    runs : at most so many of each
    seed : of all of them
    fly : outcomes and milliseconds by policy for every batch of seeds, in their order
    monitor : Monitor
    batch : runs at once; the numbers do not depend on it
    early : whether it may end before all runs are made
    """
    seeds = np.random.SeedSequence(seed).spawn(runs)
    parts: dict[str, list[Outcomes]] = {p: [] for p in policies}
    times: dict[str, list[float]] = {p: [] for p in policies}
    whole: dict[str, Outcomes] = {}
    done, ended = 0, False
    looks = looks_at(runs, early)
    z = quantile(len(looks), len(policies) - 1)
    for end in looks:
        for outcome, spent in fly([seeds[a : min(a + batch, end)] for a in range(done, end, batch)]):
            for p in policies:
                parts[p].append(outcome[p])
                times[p] += spent[p]
            if monitor.stop:
                break
        done = sum(len(part.error) for part in parts[policies[0]])
        whole = {p: Outcomes.joined(parts[p]) for p in policies}
        if monitor.stop or (end < runs and decided({p: part.cost for p, part in whole.items()}, z)):
            ended = not monitor.stop
            break
    judged = "cost" if any(np.any(part.price) for part in whole.values()) else "error"
    table = {p: numbers(whole[p], whole.get("nominal"), times[p]) for p in policies}
    return Comparison(name, done, seed, verdict(table, done, ended, z, judged), ended, table, judged)
