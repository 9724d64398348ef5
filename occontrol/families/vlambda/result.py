"""What a selection is worth: the dataclass of its numbers, the Solution around it, and the way back to a chooser."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.core.monitor import Monitor
from occontrol.core.result import ResultData
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Certificate, Solution, make_solution
from occontrol.families.vlambda.baselines import SequenceChooser
from occontrol.families.vlambda.outcome import Outcome, cost_of
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.selection import Selection
from occontrol.families.vlambda.sensor_choice import Choice

_OPTIONAL = {"optional": True}


@dataclass(frozen=True)
class EpochEntry(ResultData):
    """One choice, as it stands in the schedule of result.json.

    Parameters
    ----------
    epoch, k : number of the epoch and its first step, from 0
    sensors : names of the chosen sensors, in the problem's order
    scores : (M,) of every sensor; what they mean is the chooser's, the larger the better
    location : coordinates of the chosen movable sensors, one after the other; None without such sensors
    locations : the same by name
    """

    epoch: int
    k: int
    sensors: list[str]
    scores: list[float]
    location: list[float] | None = None
    locations: dict[str, list[float]] | None = field(default=None, metadata=_OPTIONAL)

    @classmethod
    def of(cls, problem: Problem, epoch: int, choice: Choice) -> EpochEntry:
        """The entry of the `choice` that was made in an `epoch` of a `problem`."""
        names = problem.sensors.names
        # `location` is in the order of `sensors`; `locations` says whose they are
        moved = [j for j in choice.sensors if j in choice.locations]
        return cls(
            epoch=epoch,
            k=int(problem.starts[epoch]),
            sensors=[names[j] for j in choice.sensors],
            scores=[float(x) for x in choice.scores],
            location=[float(x) for j in moved for x in choice.locations[j]] if choice.locations else None,
            locations={names[j]: [float(x) for x in p] for j, p in choice.locations.items()} or None,
        )


@dataclass(frozen=True)
class SelectionResult(ResultData):
    """The numbers of a selection.

    Parameters
    ----------
    cost : the problem's criterion of P(k|k), summed over k
    criterion : its name
    schedule : one EpochEntry per choice
    sum_trace, sum_largest_eigenvalue : of P(k|k), over k
    peak_largest_eigenvalue : over k >= 1, or of k = 0 where that is the only step
    standard_deviations : (n,) of x(K-1) given everything, in the user's units
    switches : how often the choice changes
    notes : announcements of the filter
    lower_bound : no sequence of choices costs less; None where nothing is proven
    nodes : epochs that the search walked
    log10_sequences : decimal logarithm of the number of sequences
    candidates : what may be chosen in an epoch
    bound_holds_for : what the bound is restricted to, such as a grid of locations
    relative_gap : (cost - lower_bound)/|cost|
    """

    cost: float
    criterion: str
    schedule: list[EpochEntry]
    sum_trace: float
    sum_largest_eigenvalue: float
    peak_largest_eigenvalue: float
    standard_deviations: list[float]
    switches: int
    notes: list[str]
    lower_bound: float | None = field(default=None, metadata=_OPTIONAL)
    nodes: int | None = field(default=None, metadata=_OPTIONAL)
    log10_sequences: float | None = field(default=None, metadata=_OPTIONAL)
    candidates: int | None = field(default=None, metadata=_OPTIONAL)
    bound_holds_for: str | None = field(default=None, metadata=_OPTIONAL)
    relative_gap: float | None = field(default=None, metadata=_OPTIONAL)

    def as_dict(self) -> PlainDict:
        """The family's part of result.json."""
        return {**super().as_dict(), "schedule": [entry.as_dict() for entry in self.schedule]}

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The result that `content`, the family's part of a result.json, describes."""
        entries = [EpochEntry.from_dict(entry) for entry in content.get("schedule") or ()]
        return super().from_dict({**content, "schedule": entries})


def assemble(problem: Problem, outcome: Outcome, *, method: str, began: float, monitor: Monitor) -> Solution:
    """The Solution of what a method handed over.

    Parameters
    ----------
    problem : Problem
    outcome : Outcome
    method : its name
    began : stopwatch.seconds() at the start
    monitor : that watched it
    """
    selection, proof, scales = outcome.selection, outcome.proof, problem.scales
    cost, largest = cost_of(problem, selection), selection.eigenvalues[:, 0]
    deviations = np.sqrt(np.einsum("kii->ki", selection.covariance)) * scales
    weights = np.zeros((problem.epochs, len(problem.sensors)))
    for e, choice in enumerate(selection.choices):
        weights[e, list(choice.sensors)] = 1.0
    schedule = Schedule(problem.starts.astype(float), weights, tuple(problem.sensors.names))
    certificate = None if proof is None else Certificate(cost, proof.lower_bound)
    numbers = SelectionResult(
        cost=cost,
        criterion=problem.criterion,
        schedule=[EpochEntry.of(problem, e, choice) for e, choice in enumerate(selection.choices)],
        sum_trace=float(np.sum(selection.traces)),
        sum_largest_eigenvalue=float(np.sum(largest)),
        peak_largest_eigenvalue=float(np.max(largest[1:] if len(largest) > 1 else largest)),
        standard_deviations=deviations[-1].tolist(),
        switches=schedule.switches,
        notes=list(selection.notes),
        relative_gap=None if certificate is None else certificate.relative_gap,
        **({} if proof is None else vars(proof)),
    )
    arrays = {
        "times": np.arange(problem.steps, dtype=float),
        "edges": schedule.edges,
        "weights": weights,
        "standard_deviations": deviations,
        "largest_eigenvalue": largest,
        "eigenvalues": selection.eigenvalues,
        "eigenvectors": selection.eigenvectors,
        "predicted_eigenvalues": selection.predicted_eigenvalues,
        "covariance": selection.covariance * np.outer(scales, scales),
        "scores": np.array([c.scores for c in selection.choices]),
        "selected": _selected(selection, problem.select),
    }
    return make_solution(
        problem=problem,
        method=method,
        status=outcome.status,
        message=outcome.message,
        numbers=numbers,
        monitor=monitor,
        began=began,
        iterations=problem.epochs,
        arrays=arrays,
        schedule=schedule,
        # a bound over a grid of locations is no certificate for free ones
        certificate=None if proof is None or proof.bound_holds_for else certificate,
    )


def numbers_of(solution: Solution) -> SelectionResult:
    """The numbers of a Solution of this family, also of one that was read from a run folder."""
    known = solution.numbers
    return known if isinstance(known, SelectionResult) else SelectionResult.from_dict(solution.result)


def _selected(selection: Selection, select: int) -> np.ndarray:
    """(E,) index of the sensor in the problem's order, from 0; (E, select) when several are used at a time."""
    indices = np.array([c.sensors for c in selection.choices], dtype=np.int64)
    return indices[:, 0] if select == 1 else indices


def recorded(problem: Problem, solution: Solution) -> SequenceChooser:
    """The chooser that repeats a solution's choices, locations included."""
    groups, places = [], []
    for entry in numbers_of(solution).schedule:
        groups.append(tuple(sorted(problem.sensors.index(name) for name in entry.sensors)))
        where = entry.locations or {}
        places.append({problem.sensors.index(name): np.array(p, dtype=float) for name, p in where.items()})
    return SequenceChooser(tuple(groups), tuple(places))
