"""Many runs of a policy in closed loop: truth, readings, filter, choices; each run has its own luck.

A run's luck comes from its own seed (SeedSequence.spawn), and every product is one run's own, so that a run has the
same numbers whatever the batch. All policies meet the same truths and the same noises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.families.athans.readings.fill import fill
from occontrol.families.athans.readings.ruled import WEIGHTS
from occontrol.families.athans.replanning.chain import LinearChain, NonlinearChain, product
from occontrol.families.athans.replanning.filter import normalised, predicted, squared, updated
from occontrol.families.athans.replanning.policies import Policy, watches
from occontrol.families.athans.replanning.ruled import changes_price
from occontrol.numerics.linalg import square_root
from occontrol.scheduling.closed_loop.outcomes import Outcomes

GONE = 1e150  # an estimate beyond it has left the numbers: its run goes on without readings


@dataclass(frozen=True, eq=False)
class Luck:
    """What chance brings to B runs of N readings.

    Parameters
    ----------
    start : (B, n) of the first truth
    spans : (B, N+1, n) of the plant
    readings : (B, N, m) of all sensors, one beside the other
    choices : (B, N, M) between 0 and 1
    """

    start: np.ndarray
    spans: np.ndarray
    readings: np.ndarray
    choices: np.ndarray


def luck_of(chain: LinearChain | NonlinearChain, seeds: Sequence[np.random.SeedSequence]) -> Luck:
    """The luck of as many runs as there are seeds.

    Parameters
    ----------
    chain : of the problem
    seeds : one a run
    """
    n, N, rows = chain.problem.states, chain.problem.readings, chain.rows
    parts = []
    for seed in seeds:
        draw = np.random.default_rng(seed)
        parts.append(
            (
                draw.standard_normal(n),
                draw.standard_normal((N + 1, n)),
                draw.standard_normal((N, sum(rows))),
                draw.random((N, len(rows))),
            )
        )
    start, spans, readings, choices = (np.array(part) for part in zip(*parts, strict=True))
    return Luck(start, spans, readings, choices)


class Charges:
    """What the objective charges a squared error along the way: R before and after each reading, and a constant."""

    def __init__(self, chain: LinearChain | NonlinearChain):
        filled = fill(chain.problem)
        r, back = filled.recursion, filled.units.inverse
        self.constant = filled.constant
        self.matrices = back.weight(r.running) if len(r.running) else None
        self.which, self.shares = r.running_set, r.charges

    def at(self, i: int, error: np.ndarray, after: bool) -> np.ndarray:
        """(B,) charge of `error` (B, n) at reading i, before it or after it."""
        share = self.shares[i, int(after)]
        if self.matrices is None or share == 0:
            return np.zeros(len(error))
        return share * squared(error, self.matrices[self.which[i]])


class Truths:
    """What really happens in B runs, whoever chooses the sensors: states, and the readings that there would be.

    Parameters
    ----------
    chain : of the problem
    luck : of the runs
    """

    def __init__(self, chain: LinearChain | NonlinearChain, luck: Luck):
        self.chain, self.luck = chain, luck
        B, plant, N = len(luck.start), chain.problem.plant, chain.problem.readings
        root = square_root((plant.covariance + plant.covariance.T) / 2, floor=0.0)
        mean = np.tile(np.asarray(plant.mean, dtype=float), (B, 1))
        truth = mean + product(np.broadcast_to(root, (B, *root.shape)), luck.start)
        self.states = np.empty((N + 1, *truth.shape))
        for i in range(N + 1):
            end, _, Q = chain.span(i, truth)
            truth = self.states[i] = end + product(square_root(np.ascontiguousarray(Q), floor=0.0), luck.spans[:, i])
        self.output = chain.output(truth)
        self._offsets = np.cumsum([0, *chain.rows])
        self._known: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}

    def reading(self, i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
        """What sensor j reports at reading i of every run, (B, m), and whether it sees the state, (B,)."""
        if (i, j) not in self._known:
            real = self.chain.seen(i, j, self.states[i])
            noise = self.luck.readings[:, i, self._offsets[j] : self._offsets[j + 1]]
            z = real.value + product(square_root(real.noise, floor=0.0), noise)
            self._known[i, j] = z, real.visible & np.all(np.isfinite(z), axis=1)
        return self._known[i, j]


def run(chain: LinearChain | NonlinearChain, policy: Policy, truths: Truths, charges: Charges) -> Outcomes:
    """Runs of one policy, one for each piece of luck.

    Parameters
    ----------
    chain : of the problem
    policy : what chooses
    truths : of the runs
    charges : of the problem
    """
    problem, B = chain.problem, len(truths.output)
    N, measuring = problem.readings, np.array(chain.rows) > 0
    mean = np.tile(np.asarray(problem.plant.mean, dtype=float), (B, 1))
    covariance = np.tile((problem.plant.covariance + problem.plant.covariance.T) / 2, (B, 1, 1))
    prices = np.column_stack([s.cost.sample(problem.clock.times)[:, 0, 0] for s in problem.sensors])
    prices *= WEIGHTS.get(problem.minimise, problem.cost_weight)
    used_at = np.zeros((B, N, len(chain.rows)), dtype=bool)
    watch = watches(B)
    error, price, nees = np.zeros(B), np.zeros(B), np.zeros(B)
    nis, values, lost, taken = np.zeros(B), np.zeros(B), np.zeros(B), np.zeros(B)
    gone = np.zeros(B, dtype=bool)
    policy.begin(B, truths.luck.choices)
    for i in range(N):
        truth = truths.states[i]
        mean, F, Q = chain.span(i, mean)
        covariance = predicted(covariance, F, Q)
        gone |= _beyond(mean, covariance)
        mean, covariance = _kept(gone, mean, covariance)
        error += charges.at(i, truth - mean, after=False)
        chosen = policy.choose(i, mean, covariance, np.array([w.diverging for w in watch]))
        paid = used_at[:, i] = policy.paid(i)
        for j in np.flatnonzero(np.any(paid, axis=0)).tolist():
            price[paid[:, j]] += prices[i, j]
        own, count = np.zeros(B), np.zeros(B)
        for j in np.flatnonzero(np.any(chosen, axis=0) & measuring).tolist():
            used = np.flatnonzero(chosen[:, j])
            z, there = (part[used] for part in truths.reading(i, j))
            there = there & ~gone[used]
            lost[used[~there]] += 1
            used, z = used[there], z[there]
            if len(used):
                seen = chain.seen(i, j, mean[used])
                mean[used], covariance[used], found = updated(mean[used], covariance[used], seen, z, chain.angles(j))
                own[used] += found
                count[used] += chain.rows[j]
                taken[used] += 1
        for b in np.flatnonzero(count).tolist():
            watch[b].add(float(own[b]), int(count[b]))
        nis, values = nis + own, values + count
        gone |= _beyond(mean, covariance)
        mean, covariance = _kept(gone, mean, covariance)
        error += charges.at(i, truth - mean, after=True)
        nees += np.where(gone, np.inf, normalised(truth - mean, covariance))
    price += changes_price(problem, used_at)
    mean, _, _ = chain.span(N, mean)
    miss = truths.output - chain.output(mean)
    error += np.sum(miss * miss, axis=1) + charges.constant
    error = np.where(gone | ~np.isfinite(error), np.inf, error)
    with np.errstate(invalid="ignore", divide="ignore"):
        per_value = np.where(values > 0, nis / np.maximum(values, 1), np.nan)
    return Outcomes(error, price, nees / max(N, 1), per_value, lost, taken, policy.plans, policy.late)


def _beyond(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(B,) whose estimate has left the numbers."""
    with np.errstate(invalid="ignore"):
        small = np.all(np.abs(mean) < GONE, axis=1) & np.all(np.abs(covariance) < GONE, axis=(1, 2))
    return ~small


def _kept(gone: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers in place of what has left them, so that the others go on."""
    if not np.any(gone):
        return mean, covariance
    n = mean.shape[1]
    mean, covariance = mean.copy(), covariance.copy()
    mean[gone], covariance[gone] = 0.0, np.eye(n)
    return mean, covariance
