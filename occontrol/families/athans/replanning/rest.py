"""The rest of a horizon as a Recursion, from an estimate on; a nonlinear plant is followed from the estimate itself."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from occontrol.families.athans.nonlinear.nominal import spans_of
from occontrol.families.athans.nonlinear.path import evaluate
from occontrol.families.athans.readings.fill import fill, in_units
from occontrol.families.athans.replanning.chain import LinearChain, NonlinearChain
from occontrol.numerics.flow import Spans, charges
from occontrol.numerics.linalg import whiten
from occontrol.scheduling.recursion import Recursion


class Rests:
    """Recursions of what is left of a problem of readings.

    Parameters
    ----------
    chain : of the problem
    cost_weight : of the readings' prices; None: the problem's own
    """

    def __init__(self, chain: LinearChain | NonlinearChain, cost_weight: float | None = None):
        problem = chain.problem
        self.chain, self.problem = chain, problem
        self.full = fill(problem if cost_weight is None else replace(problem, cost_weight=cost_weight))
        owner = problem.clock.owner
        self.owner = np.arange(problem.readings) if owner is None else owner

    def from_estimate(
        self, k: int, last: int, mean: np.ndarray, covariance: np.ndarray
    ) -> tuple[Recursion, np.ndarray]:
        """The recursion of readings k .. last - 1, its first predict the identity, and what is open (E', M).

        Parameters
        ----------
        k, last : a decision begins at both, or `last` is the end
        mean, covariance : (n,) and (n, n) before reading k

        Raises ProblemError where the path from the estimate leaves the numbers.
        """
        full, units = self.full.recursion, self.full.units
        n, first, end = full.states, int(self.owner[k]), int(self.owner[last - 1]) + 1
        owner = self.owner[k:last] - first
        parts = {
            "steps": full.steps[k:last],
            "cost": full.cost[k:last],
            "charge": None if full.charge is None else full.charge[k:last],
            "owner": owner,
        }
        if isinstance(self.chain, LinearChain):
            transition = np.concatenate([np.eye(n)[None], full.transition])
            noise = np.concatenate([np.zeros((1, n, n)), full.noise])
            predict = np.concatenate([[0], full.predict[k + 1 : last + 1] + 1])
            W = full.terminal
            for i in range(len(full.predict) - 1, last, -1):  # nothing is planned on the way to the end
                F = full.transition[full.predict[i]]
                W = F.T @ W @ F
            recursion = Recursion(
                initial=units.covariance(covariance), transition=transition, noise=noise, predict=predict,
                rows=full.rows, row_set=full.row_set[k:last], offsets=full.offsets, running=full.running,
                running_set=full.running_set[k:last], terminal=W, available=self.problem.upper[first:end], **parts,
            )  # fmt: skip
            return recursion, self.problem.upper[first:end]
        return self._relinearised(k, last, mean, covariance, parts)

    def _relinearised(
        self, k: int, last: int, mean: np.ndarray, covariance: np.ndarray, parts: dict
    ) -> tuple[Recursion, np.ndarray]:
        """The same of a nonlinear plant along its path from `mean`."""
        chain, problem = cast(NonlinearChain, self.chain), self.problem
        stages, n = chain.stages, len(mean)
        spans = self._spans(mean, k)
        states = np.vstack([mean[None], spans.ends[: last - k - 1]])
        times = stages.times[k:last]
        rows, upper = self._rows(states, times, k, last)
        end_map = np.eye(n)
        for F in spans.transition[last - k :][::-1]:
            end_map = end_map @ F
        count = last - k
        D = problem.output.at(problem.output_at)
        posterior = problem.discrete and problem.at == "posterior" and last == problem.readings
        final = np.eye(n)[None] if posterior else spans.transition[count - 1 : count]
        last_noise = np.zeros((1, n, n)) if posterior else spans.noise[count - 1 : count]
        weighed = D if posterior else D @ end_map
        running, running_set = self._running(spans, times, count)
        recursion = Recursion(
            initial=(covariance + covariance.T) / 2,
            transition=np.concatenate([np.eye(n)[None], spans.transition[: count - 1], final]),
            noise=np.concatenate([np.zeros((1, n, n)), spans.noise[: count - 1], last_noise]),
            predict=np.arange(count + 1),
            rows=rows,
            row_set=np.arange(count),
            offsets=self.full.recursion.offsets,
            running=running,
            running_set=running_set,
            terminal=weighed.T @ weighed,
            available=upper,
            **parts,
        )
        return in_units(recursion, self.full.units), upper

    def _spans(self, mean: np.ndarray, k: int) -> Spans:
        """The spans after reading k, along the path from `mean` (n,) there."""
        stages = cast(NonlinearChain, self.chain).stages
        plant = stages.origin.plant
        if self.problem.discrete:
            since = np.arange(k, len(stages.times) + 1, dtype=float)
            return spans_of(plant, 0.0, since, 1, mean)
        nominal = stages.origin.nominal
        since = nominal.since[k + 1 :]
        return spans_of(plant, nominal.origin, since, stages.substeps, mean)

    def _rows(self, states: np.ndarray, times: np.ndarray, k: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Whitened rows (count, r, n) of all sensors along the path, and what is open (E', M)."""
        sensors = cast(NonlinearChain, self.chain).sensors
        blocks, open_ = [], np.ones((len(times), len(self.problem.sensors)))
        for j, sensor in enumerate(sensors):
            if sensor is None:
                blocks.append(np.zeros((len(times), 0, states.shape[1])))
                continue
            C, theta = evaluate(sensor.slope(), states, times), evaluate(sensor.covariance(), states, times)
            good = np.all(np.isfinite(C), axis=(1, 2)) & np.all(np.isfinite(theta), axis=(1, 2))
            seen = sensor.seen()
            if seen is not None:
                good &= evaluate(seen, states, times)[:, 0, 0] > 0
            if sensor.windows is not None:
                good &= np.any([(a <= times) & (times <= b) for a, b in sensor.windows], axis=0)
            C, theta = np.where(good[:, None, None], C, 0.0), np.where(good[:, None, None], theta, np.eye(sensor.rows))
            blocks.append(whiten(theta, C)[0])
            open_[:, j] = good
        least, most = self.problem.select
        for j, stated in enumerate(self.problem.sensors):
            if stated.is_idle:
                others = np.sum(np.delete(open_, j, axis=1), axis=1)
                open_[:, j] = np.maximum(most - least, most - others)
        owner = self.owner[k:last]
        return (
            np.ascontiguousarray(np.concatenate(blocks, axis=1)),
            np.minimum.reduceat(open_, np.flatnonzero(np.diff(owner, prepend=-1)), axis=0),
        )

    def _running(self, spans: Spans, times: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        problem, n = self.problem, spans.transition.shape[1]
        if problem.running is None:
            return np.zeros((0, n, n)), np.zeros(count, dtype=np.int64)
        if problem.running_at != "integral":
            R = np.array(problem.running.sample(times))
        else:
            nodes = spans.times
            inner = np.clip(nodes, nodes[:, :1], nodes[:, :1] + (nodes[:, -1:] - nodes[:, :1]) * (1 - 1e-9))
            weight = np.array(problem.running.sample(inner.ravel())).reshape(*nodes.shape, n, n)
            R = charges(spans, (weight + np.swapaxes(weight, 2, 3)) / 2)[0][:count]
        return (R + np.swapaxes(R, 1, 2)) / 2, np.arange(count)


def behind(rest: Recursion, past: int, owner: np.ndarray, available: np.ndarray) -> Recursion:
    """The same recursion behind `past` readings that are over: they move nothing, show nothing and cost nothing.

    Parameters
    ----------
    rest : whose first predict is the identity
    past : readings before it
    owner : (K,) the decision of every reading, those that are over included
    available : (E, M) of all decisions
    """
    n, M = rest.states, rest.sensors
    still = np.zeros(past, dtype=np.int64)
    running, running_set = rest.running, np.concatenate([still, rest.running_set])
    if len(running):
        running_set[:past] = len(running)
        running = np.concatenate([running, np.zeros((1, n, n))])
    return replace(
        rest,
        predict=np.concatenate([still, rest.predict]),
        rows=np.concatenate([rest.rows, np.zeros((1, *rest.rows.shape[1:]))]),
        row_set=np.concatenate([still + len(rest.rows), rest.row_set]),
        steps=np.concatenate([np.ones(past), rest.steps]),
        cost=np.concatenate([np.zeros((past, M)), rest.cost]),
        running=running,
        running_set=running_set,
        available=available,
        owner=owner,
        charge=np.concatenate([np.zeros((past, 2)), rest.charges]),
    )
