"""A switching problem in well-scaled states, and its solution back in the user's: the one door for units.

    x = D y,   A -> D^-1 A D,   B -> D^-1 B,   K, C -> . D,   X0 -> D X0 D        (D = diag d, powers of two)

One d for all time, from the pencil of numerics/balance.py with rate = T|A|, driven = T|BB'| + |X0^-1| and
observed = T (|K'K| + sum_j |C_j'C_j|) + |X0|, each the largest over time. The size stays that of the user's ellipsoid
(`Size.scales`). Nothing is rounded on the way in or out, so states in other units by powers of two have the same
observability horizon, the same schedule and the same volume, to the last bit.
"""

from __future__ import annotations

import copy
import dataclasses

import numpy as np

from occontrol.core.checks import SAMPLES_BETWEEN
from occontrol.core.scaled_signal import scaled
from occontrol.core.solution import Solution
from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.result import SequenceResult, SharesResult, SwitchingResult, UnobservableResult
from occontrol.numerics.balance import StateUnits, balancing

SHAPES = ("shape", "ordinary", "fine_shape")
WEIGHTS = ("center_weight", "free_weight")


@dataclasses.dataclass(frozen=True, eq=False)
class BalancedProblem(Problem):
    """A problem in scaled states.

    Parameters
    ----------
    units : that lead from the user's states to these
    """

    units: StateUnits = dataclasses.field(kw_only=True)

    @property
    def measure(self) -> Size:
        """The size of the user's ellipsoid."""
        return Size(Size.of(self.size).terms, tuple(self.units.factors.tolist()))


def state_units(problem: Problem) -> StateUnits:
    """The units in which the problem is balanced.

    Parameters
    ----------
    problem : Problem with n states
    """
    plant = problem.plant
    start, end = float(problem.edges[0]), float(problem.edges[-1])
    span, times = end - start, np.linspace(start, end, SAMPLES_BETWEEN)

    def values(signal) -> np.ndarray:
        return signal.sample(times[:1] if signal.constant else times)

    def squares(M: np.ndarray) -> np.ndarray:
        return np.max(np.abs(np.swapaxes(M, 1, 2) @ M), axis=0)

    # inverted in units in which its diagonal is of size one, so that what is rounded does not depend on the user's
    d = np.exp2(np.rint(np.log2(np.diagonal(plant.weight)) / 2))
    initial = np.linalg.inv(plant.weight / np.outer(d, d)) / np.outer(d, d)
    rate = span * np.max(np.abs(values(plant.A)), axis=0)
    driven = span * squares(np.swapaxes(values(plant.B), 1, 2)) + np.abs(initial)
    seen = squares(values(plant.K)) + np.sum([squares(values(s.C)) for s in problem.sensors], axis=0)
    return StateUnits(balancing(rate, driven, span * seen + np.abs(plant.weight)))


def balanced(problem: Problem) -> BalancedProblem:
    """The problem in balanced states; one that is balanced already comes back as it is.

    Parameters
    ----------
    problem : Problem
    """
    if isinstance(problem, BalancedProblem):
        return problem
    units = state_units(problem)
    d, one, old = units.factors, np.ones, problem.plant
    plant = copy.copy(old)  # not made anew: its values were checked in the user's states
    changed = {
        "A": scaled(old.A, 1 / d, d),
        "B": scaled(old.B, 1 / d, one(old.B.shape[1])),
        "K": scaled(old.K, one(old.K.shape[0]), d),
        "weight": units.weight(old.weight),
        "center": units.vector(old.center),
    }
    for name, value in changed.items():
        object.__setattr__(plant, name, value)
    sensors = tuple(dataclasses.replace(s, C=scaled(s.C, one(s.rows), d)) for s in problem.sensors)
    fields = {f.name: getattr(problem, f.name) for f in dataclasses.fields(problem) if f.init}
    fields |= {"plant": plant, "sensors": dataclasses.replace(problem.sensors, sensors=sensors), "units": units}
    return BalancedProblem(**fields)


def restored(solution: Solution, problem: Problem) -> Solution:
    """A solution of the balanced problem as one of the problem itself.

    Parameters
    ----------
    solution : of `balanced(problem)`
    problem : the user's
    """
    back, arrays = solution.problem.units.inverse, dict(solution.arrays)
    for names, undo in ((SHAPES, back.covariance), (WEIGHTS, back.weight)):
        arrays |= {name: undo(arrays[name]) for name in names if name in arrays}
    numbers = solution.numbers
    if isinstance(numbers, SwitchingResult):
        numbers = in_units(numbers, back)
    return dataclasses.replace(solution, problem=problem, arrays=arrays, numbers=numbers)


def in_units(numbers: SwitchingResult, units: StateUnits) -> SwitchingResult:
    """The numbers with their matrices in other units.

    Parameters
    ----------
    numbers : of a solve
    units : that lead from its states to others
    """

    def weight(rows: list[list[float]] | None) -> list[list[float]] | None:
        return None if rows is None else units.weight(np.array(rows)).tolist()

    if isinstance(numbers, UnobservableResult):
        return dataclasses.replace(numbers, X_initial=weight(numbers.X_initial))
    if not isinstance(numbers, SequenceResult | SharesResult):
        return numbers
    X, Y = weight(numbers.X_initial), weight(numbers.Y_initial)
    if isinstance(numbers, SharesResult) or numbers.independent is None:
        return dataclasses.replace(numbers, X_initial=X, Y_initial=Y)
    judged = dataclasses.replace(numbers.independent, Y_initial=weight(numbers.independent.Y_initial))
    return dataclasses.replace(numbers, X_initial=X, Y_initial=Y, independent=judged)
