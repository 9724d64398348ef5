"""What a search may choose in an epoch: every group of sensors, movable ones on a grid of locations.

A search needs a finite set of candidates, so its answer is exact over the grid, not over all locations.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import InfeasibleError, SolveFailed
from occontrol.families.vlambda.epoch_kernel import LARGEST_EIGENVALUE, TRACE, expand
from occontrol.families.vlambda.placement import grid_of
from occontrol.families.vlambda.sampled_plant import SampledPlant
from occontrol.families.vlambda.sensor_choice import MOST_SUBSETS, Choice, Epoch, best_of, subsets
from occontrol.families.vlambda.sequence_search import SequenceProblem, search

if TYPE_CHECKING:
    from occontrol.families.vlambda.problem import Problem

MOST_NUMBERS = 40_000_000  # entries of all candidates' rows, 320 MB


@dataclass(frozen=True, eq=False)
class Candidate:
    """A group of sensors and where its movable ones are."""

    sensors: tuple[int, ...]
    locations: Mapping[int, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """All candidates of a plant, and the searches over them.

    Parameters
    ----------
    plant : SampledPlant
    starts : (E+1,) first step of every epoch, then K
    select : sensors in a group
    kind : TRACE or LARGEST_EIGENVALUE
    grid : locations along each coordinate of a movable sensor

    Raises InfeasibleError when a movable sensor has no allowed grid point, SolveFailed for too many candidates.
    """

    plant: SampledPlant
    starts: np.ndarray
    select: int
    kind: int
    grid: int = 9

    @cached_property
    def places(self) -> list[list[np.ndarray | None]]:
        """The locations of every sensor that may be chosen in any epoch; [None] for one that cannot move.

        Raises InfeasibleError where no grid point of a sensor is allowed.
        """
        options: list[list[np.ndarray | None]] = []
        for sensor in self.plant.sensors:
            region = sensor.sensor.location
            if region is None:
                options.append([None])
                continue
            points = grid_of(region, self.grid)
            good = np.all([region.allowed(k, points) for k in self.starts[:-1]], axis=0)
            if not np.any(good):
                raise InfeasibleError(
                    f"no grid point of sensor '{sensor.sensor.name}' is allowed in every epoch\n"
                    "  hint: a larger grid, or a method that places sensors freely (eigenspace, trace)"
                )
            options.append(list(points[good]))
        return options

    @cached_property
    def candidates(self) -> list[Candidate]:
        """Groups in lexicographic order, locations of a group in the order of the grid.

        Raises SolveFailed where there are too many to search.
        """
        groups = subsets(len(self.plant.sensors), self.select)
        count = np.inf if groups is None else sum(np.prod([len(self.places[j]) for j in g]) for g in groups)
        if groups is None or count > MOST_SUBSETS:
            many = "too many" if groups is None else int(count)
            raise SolveFailed(
                f"there are {many} groups of sensors to search, the limit is {MOST_SUBSETS}\n"
                "  hint: eigenspace and trace need no search; or fewer sensors, or a coarser grid of locations"
            )
        return [
            Candidate(group, {j: p for j, p in zip(group, where, strict=True) if p is not None})
            for group in groups
            for where in itertools.product(*(self.places[j] for j in group))
        ]

    def _rows(self, sensor: int, location: np.ndarray | None) -> np.ndarray:
        return self.plant.sensors[sensor].whitened(0, self.plant.steps, location)

    @cached_property
    def problem(self) -> SequenceProblem:
        """The whole horizon as a search problem.

        Raises SolveFailed where the candidates are too many numbers to hold.
        """
        plant, n = self.plant, self.plant.states
        heights = [sum(plant.sensors[j].sensor.rows for j in c.sensors) for c in self.candidates]
        size = len(heights) * plant.steps * max(heights) * n
        if size > MOST_NUMBERS:
            raise SolveFailed(
                f"the candidates of the search hold {size} numbers, the limit is {MOST_NUMBERS}\n"
                "  hint: fewer sensors or steps"
            )
        known = {(j, i): self._rows(j, p) for j, places in enumerate(self.places) for i, p in enumerate(places)}
        rows = np.zeros((len(heights), plant.steps, max(heights), n))
        for c, candidate in enumerate(self.candidates):
            stacked = [self._of(known, j, candidate.locations.get(j)) for j in candidate.sensors]
            rows[c, :, : heights[c]] = np.concatenate(stacked, axis=1)
        values, vectors = np.linalg.eigh(plant.covariance)
        root = np.ascontiguousarray(vectors * np.sqrt(np.clip(values, 0.0, None)))
        together = np.ascontiguousarray(np.concatenate(list(known.values()), axis=1))
        return SequenceProblem(root, plant.transition, plant.noise_root, self.starts, rows, together, self.kind)

    def _of(self, known: dict[tuple[int, int], np.ndarray], j: int, location: np.ndarray | None) -> np.ndarray:
        index = 0 if location is None else next(i for i, p in enumerate(self.places[j]) if p is location)
        return known[j, index]

    def index_of(self, sensors: tuple[int, ...]) -> int:
        """The first candidate that uses exactly these sensors."""
        return next(c for c, candidate in enumerate(self.candidates) if candidate.sensors == tuple(sorted(sensors)))

    def tail(self, first: int, last: int, root: np.ndarray) -> SequenceProblem:
        """Epochs first .. last-1 from a given covariance root (n, n), steps counted from 0 again."""
        whole = self.problem
        begin, end = int(self.starts[first]), int(self.starts[last])
        return SequenceProblem(
            np.ascontiguousarray(root),
            whole.transition[begin:end],
            whole.noise_root[begin:end],
            self.starts[first : last + 1] - begin,
            whole.rows[:, begin:end],
            whole.together[begin:end],
            self.kind,
        )


def candidate_set(problem: Problem, grid: int) -> CandidateSet:
    """The candidates of a `problem`, locations on a `grid` of so many along each coordinate."""
    kind = TRACE if problem.criterion == "trace" else LARGEST_EIGENVALUE
    return CandidateSet(problem.sampled, problem.starts, problem.select, kind, grid)


@dataclass(frozen=True, eq=False)
class LookaheadChooser:
    """The first choice of the best sequence over the next `depth` epochs.

    Scores are minus the least cost of those epochs when the sensor is used now.

    Parameters
    ----------
    candidates : CandidateSet
    depth : how many epochs to look ahead, this one included; fewer remain at the end of the horizon
    """

    candidates: CandidateSet
    depth: int = 2

    def choose(self, epoch: Epoch) -> Choice:
        """Search the next epochs from the eigenfactors that were given.

        Parameters
        ----------
        epoch : Epoch
        """
        first, last = epoch.index, min(epoch.index + self.depth, len(self.candidates.starts) - 1)
        near = self.candidates.tail(first, last, epoch.factors.root)
        s = near.slice(0)
        after, costs = expand(
            near.root[None], near.transition[s], near.noise_root[s], np.ascontiguousarray(near.rows[:, s]), near.kind
        )
        totals = costs[0]
        if last > first + 1:
            totals = totals + np.array([search(self.candidates.tail(first + 1, last, root)).cost for root in after[0]])
        chosen = self.candidates.candidates[best_of(-totals, 1)[0]]
        scores = np.full(len(epoch.plant.sensors), -np.inf)
        for candidate, total in zip(self.candidates.candidates, totals, strict=True):
            for j in candidate.sensors:
                scores[j] = max(scores[j], -total)
        return Choice(chosen.sensors, scores, dict(chosen.locations))
