"""What chooses the sensors of many runs at once: a schedule, a rule for the next reading, chance, or new plans."""

from __future__ import annotations

import time
from typing import ClassVar, Protocol

import numpy as np

from occontrol.core.errors import InfeasibleError, ProblemError
from occontrol.families.athans.nonlinear.linearise import Replanning
from occontrol.families.athans.replanning.chain import LinearChain, NonlinearChain
from occontrol.families.athans.replanning.online import Watch
from occontrol.families.athans.replanning.planner import Planner, usable

Chain = LinearChain | NonlinearChain
SAME = 1e-9  # relative: eigenvalues that count as one
TIED = 1e-10  # relative: what sensors bring that counts as the same


class Policy(Protocol):
    """Chooses the sensors of every run.

    `milliseconds` of the processor are those of its decisions, for one run; `plans` and `late` (B,) count the new plans
    of the batch's runs, and those that the deadline has cut off.
    """

    milliseconds: list[float]
    plans: np.ndarray
    late: np.ndarray

    def begin(self, runs: int, luck: np.ndarray) -> None:
        """A batch of `runs` begins; `luck` (B, N, M) are numbers between 0 and 1 that belong to the runs."""
        ...

    def choose(self, i: int, mean: np.ndarray, covariance: np.ndarray, lost: np.ndarray) -> np.ndarray:
        """(B, M) which sensors are read at reading i, from `mean` (B, n) and `covariance` (B, n, n) before it.

        `lost` (B,) says whose filter has probably lost the track.
        """
        ...

    def paid(self, i: int) -> np.ndarray:
        """(B, M) which sensors are paid for at reading i: more than are read where some warm up."""
        ...


class Scheduled:
    """The same schedule for all runs.

    Parameters
    ----------
    name : of the policy
    weights : (N, M) whole numbers, what is on
    measuring : (N, M) what is read; None: all that is on
    """

    def __init__(self, name: str, weights: np.ndarray, measuring: np.ndarray | None = None):
        self.name, self.on, self.milliseconds = name, weights > 0.5, []
        self.read = self.on if measuring is None else measuring > 0.5

    def begin(self, runs: int, luck: np.ndarray) -> None:
        """A batch begins; chance, `luck` (B, N, M), has no part in it."""
        self.runs = runs
        self.plans = self.late = np.zeros(runs)

    def choose(self, i: int, mean: np.ndarray, covariance: np.ndarray, lost: np.ndarray) -> np.ndarray:
        """(B, M) what the schedule says; `mean` (B, n), `covariance` (B, n, n), `lost` (B,) do not matter."""
        return np.broadcast_to(self.read[i], (self.runs, self.read.shape[1]))

    def paid(self, i: int) -> np.ndarray:
        """(B, M) what is on at reading i."""
        return np.broadcast_to(self.on[i], (self.runs, self.on.shape[1]))


class Choosing:
    """The base of rules that choose anew at every decision and keep their choice until the next.

    Parameters
    ----------
    chain : of the problem
    """

    name: ClassVar[str] = ""

    def __init__(self, chain: Chain):
        self.chain, self.milliseconds = chain, []
        problem = chain.problem
        owner = problem.clock.owner
        self.owner = np.arange(problem.readings) if owner is None else owner
        self.measuring = np.array(chain.rows) > 0

    def begin(self, runs: int, luck: np.ndarray) -> None:
        """A batch begins with its `luck` (B, N, M)."""
        self.luck = luck
        self.plans = self.late = np.zeros(runs)
        self.kept = np.zeros((runs, len(self.chain.rows)), dtype=bool)

    def choose(self, i: int, mean: np.ndarray, covariance: np.ndarray, lost: np.ndarray) -> np.ndarray:
        """(B, M) the sensors of largest value; `mean` (B, n), `covariance` (B, n, n), `lost` (B,)."""
        if i and self.owner[i] == self.owner[i - 1]:
            return self.kept
        began = time.process_time()
        B, problem = len(mean), self.chain.problem
        self.kept = np.zeros((B, len(self.chain.rows)), dtype=bool)
        open_ = self._open(i, mean)
        for _ in range(problem.places):
            worth = np.where(open_ & ~self.kept, self.worth(i, mean, covariance), -np.inf)
            best = np.argmax(worth, axis=1)
            there = np.isfinite(worth[np.arange(B), best])
            self.kept[np.flatnonzero(there), best[there]] = True
        self.milliseconds.append(1e3 * (time.process_time() - began) / B)
        return self.kept

    def paid(self, i: int) -> np.ndarray:
        """(B, M) what was chosen for reading i."""
        return self.kept

    def worth(self, i: int, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(B, M) what a reading of each sensor is worth; `mean` (B, n), `covariance` (B, n, n)."""
        raise NotImplementedError

    def _open(self, i: int, mean: np.ndarray) -> np.ndarray:
        """(B, M) which sensors could be read as far as the estimate knows; `mean` (B, n)."""
        found = np.tile(self.measuring, (len(mean), 1))
        time_of = self.chain.problem.clock.times[i]
        sensors = getattr(self.chain, "sensors", ())
        for j, stated in enumerate(self.chain.problem.sensors):
            if not self.measuring[j]:
                continue
            if isinstance(self.chain, LinearChain):
                found[:, j] = stated.readable(time_of)
                continue
            windows = sensors[j].windows
            found[:, j] = self.chain.seen(i, j, mean).visible
            if windows is not None and not any(a <= time_of <= b for a, b in windows):
                found[:, j] = False
        return found


class Greedy(Choosing):
    """The largest decrease of the trace that counts: of the running weight, or of the output where there is none."""

    name: ClassVar[str] = "greedy"

    def worth(self, i: int, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(B, M) tr(R P H' S^-1 H P); `mean` (B, n), `covariance` (B, n, n)."""
        weight = self._weight(i)
        found = np.zeros((len(mean), len(self.chain.rows)))
        for j in np.flatnonzero(self.measuring):
            seen = self.chain.seen(i, int(j), mean)
            cross = covariance @ np.swapaxes(seen.slope, 1, 2)
            gained = np.linalg.solve(seen.slope @ cross + seen.noise, np.swapaxes(cross, 1, 2))
            found[:, j] = np.einsum("xy,byz,bzx->b", weight, cross, gained)
        return found

    def _weight(self, i: int) -> np.ndarray:
        problem = self.chain.problem
        if problem.running is not None and np.any(problem.running.at(problem.clock.times[i])):
            return np.array(problem.running.at(problem.clock.times[i]))
        D = problem.output.at(problem.output_at)
        return D.T @ D


class GreedyInformation(Choosing):
    """The largest information of one reading about the state."""

    name: ClassVar[str] = "greedy-information"

    def worth(self, i: int, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(B, M) ln det S - ln det R; `mean` (B, n), `covariance` (B, n, n)."""
        found = np.zeros((len(mean), len(self.chain.rows)))
        for j in np.flatnonzero(self.measuring):
            seen = self.chain.seen(i, int(j), mean)
            S = seen.slope @ covariance @ np.swapaxes(seen.slope, 1, 2) + seen.noise
            found[:, j] = np.linalg.slogdet(S)[1] - np.linalg.slogdet(seen.noise)[1]
        return found


class Eigenspace(Choosing):
    """The largest information along the worst direction of the estimate. Oshman (1994), equations (15)-(20)."""

    name: ClassVar[str] = "eigenspace"

    def worth(self, i: int, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(B, M) tr(E H' R^-1 H), E the projector onto the eigenspace of the largest eigenvalue of the covariance.

        `mean` (B, n), `covariance` (B, n, n). Eigenvalues within 1e-9 of the largest one belong to it.
        """
        values, vectors = np.linalg.eigh(covariance)
        worst = (values >= (1 - SAME) * values[:, -1:])[:, None, :] * vectors
        found = np.zeros((len(mean), len(self.chain.rows)))
        for j in np.flatnonzero(self.measuring):
            seen = self.chain.seen(i, int(j), mean)
            along = seen.slope @ worst
            found[:, j] = np.sum(along * np.linalg.solve(seen.noise, along), axis=(1, 2))
        best = np.max(found, axis=1, keepdims=True)
        return np.where(found >= (1 - TIED) * best, best, found)  # ties go to the first sensor


class RandomChoice(Choosing):
    """Chance: every sensor that could be read is as likely."""

    name: ClassVar[str] = "random"

    def worth(self, i: int, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(B, M) the luck of the runs; `mean` (B, n) and `covariance` (B, n, n) do not matter."""
        return self.luck[:, i]


class Replanned:
    """New plans on the way, each run its own.

    Parameters
    ----------
    chain : of the problem
    weights : (N, M) the plan to begin with
    options : Replanning
    shares : (E, M) of its relaxation, where new plans start; None: those of the plan
    """

    name: ClassVar[str] = "replanned"

    def __init__(self, chain: Chain, weights: np.ndarray, options: Replanning, shares: np.ndarray | None = None):
        self.chain, self.first, self.options, self.shares_at_first = chain, weights, options, shares
        self.planner = Planner(chain, options.gap, options.horizon, options.deadline)
        self.measuring = self.planner.measuring(weights)
        self.milliseconds: list[float] = []

    def begin(self, runs: int, luck: np.ndarray) -> None:
        """A batch begins; chance, `luck` (B, N, M), has no part in it."""
        self.weights, self.reads = (np.tile(part, (runs, 1, 1)) for part in (self.first, self.measuring))
        self.shares = [self.shares_at_first] * runs
        self.plans, self.late = np.zeros(runs), np.zeros(runs)

    def choose(self, i: int, mean: np.ndarray, covariance: np.ndarray, lost: np.ndarray) -> np.ndarray:
        """(B, M) what the latest plan of every run says, after new plans where they are due.

        `mean` (B, n), `covariance` (B, n, n); a run whose filter is `lost` (B,) keeps its plan.
        """
        if i and i % self.options.every == 0 and self.planner.begins(i):
            for b in range(len(mean)):
                if not lost[b] and usable(mean[b], covariance[b]):
                    self._plan(b, i, mean[b], covariance[b])
        return self.reads[:, i] > 0.5

    def paid(self, i: int) -> np.ndarray:
        """(B, M) what is on at reading i."""
        return self.weights[:, i] > 0.5

    def _plan(self, b: int, i: int, mean: np.ndarray, covariance: np.ndarray) -> None:
        began = time.process_time()
        try:
            made = self.planner.plan(i, mean, covariance, self.weights[b], self.shares[b])
        except (
            ProblemError,
            InfeasibleError,
        ):  # from a wrong estimate: the old plan goes on
            return
        self.milliseconds.append(1e3 * (time.process_time() - began))
        self.plans[b] += 1
        self.late[b] += made.late
        self.shares[b] = made.relaxed
        if not made.late:
            self.weights[b, i:], self.reads[b, i:] = made.weights, made.measuring


def watches(runs: int) -> list[Watch]:
    """One watch over the innovations of every run."""
    return [Watch() for _ in range(runs)]
