"""A scheduling problem in well-scaled states, and its solution back in the user's: the one door for units.

    x = d * y,   A -> D^-1 A D,  Xi, Sigma0 -> D^-1 . D^-1,  C, D -> . D,  R -> D R D        (D = diag d, powers of two)

One d for all time, from the pencil of numerics/balance.py with rate = T|A|, driven = T|Xi| + |Sigma0| and
observed = T (sum_j L_j + |R|) + W, each the largest over time. Nothing is rounded on the way in or out, so states
in other units by powers of two have the same cost, bound and schedule to the last bit.
"""

from __future__ import annotations

import copy
import dataclasses

import numpy as np

from occontrol.core.errors import Mistake
from occontrol.core.scaled_signal import scaled
from occontrol.core.solution import Solution
from occontrol.families.athans.discretise import prediction_weight, scaled_rows
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.balance import StateUnits, balancing

PROBED = 257  # times at which varying data is looked at
COVARIANCES = ("covariance", "filter_covariance")
COSTATES = ("costate",)
GAINS = ("gain", "continuous_gain")


@dataclasses.dataclass(frozen=True, eq=False)
class BalancedProblem(SchedulingProblem):
    """A problem in scaled states; its values were checked in the user's."""

    def _values(self, wrong: set) -> list[Mistake]:
        return []


def state_units(problem: SchedulingProblem) -> StateUnits:
    """The units in which the problem is balanced.

    Parameters
    ----------
    problem : SchedulingProblem with n states
    """
    plant, sensors = problem.plant, problem.sensors
    start, end = float(problem.edges[0]), float(problem.edges[-1])
    span, times = end - start, np.linspace(start, end, PROBED)

    def largest(signal) -> np.ndarray:
        return np.max(np.abs(signal.sample(times[:1] if signal.constant else times)), axis=0)

    rows = np.abs(scaled_rows(sensors, times)[0])
    observed = span * np.max(np.swapaxes(rows, 1, 2) @ rows, axis=0) + np.abs(prediction_weight(problem)[0])
    if problem.running is not None:
        observed = observed + span * largest(problem.running)
    driven = span * largest(plant.noise) + np.abs(plant.covariance)
    return StateUnits(balancing(span * largest(plant.A), driven, observed))


def balanced(problem: SchedulingProblem) -> tuple[SchedulingProblem, StateUnits]:
    """The problem in balanced states, and the units that lead there.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    units = state_units(problem)
    d, one = units.factors, np.ones
    old = problem.plant
    plant = copy.copy(old)  # not made anew: its checks compare entries of different units
    changed = {
        "A": scaled(old.A, 1 / d, d),
        "noise": scaled(old.noise, 1 / d, 1 / d),
        "covariance": units.covariance(old.covariance),
        "mean": units.vector(old.mean),
    }
    if old.B is not None:
        changed["B"] = scaled(old.B, 1 / d, one(old.B.shape[1]))
    for name, value in changed.items():
        object.__setattr__(plant, name, value)
    sensors = tuple(dataclasses.replace(s, C=scaled(s.C, one(s.rows), d)) for s in problem.sensors)
    fields = {f.name: getattr(problem, f.name) for f in dataclasses.fields(problem) if f.init}
    fields |= {
        "plant": plant,
        "sensors": dataclasses.replace(problem.sensors, sensors=sensors),
        "output": scaled(problem.output, one(problem.output.shape[0]), d),
        "running": None if problem.running is None else scaled(problem.running, d, d),
    }
    inner = BalancedProblem(**fields)
    for name in ("added_edges", "warnings"):  # the edges are there already, so it would not know which were added
        object.__setattr__(inner, name, getattr(problem, name))
    return inner, units


def restored(solution: Solution, problem: SchedulingProblem, units: StateUnits) -> Solution:
    """A solution of the balanced problem as one of the problem itself.

    Parameters
    ----------
    solution : of `balanced(problem)`
    problem : the user's
    units : those of `balanced`
    """
    back, arrays = units.inverse, dict(solution.arrays)
    added = [(t, why) for t, why in solution.problem.added_edges if t not in problem.edges]
    problem = problem.with_edges(added) if added else problem
    for names, undo in ((COVARIANCES, back.covariance), (COSTATES, back.weight), (GAINS, back.into)):
        arrays |= {name: undo(arrays[name]) for name in names if name in arrays}
    return dataclasses.replace(solution, problem=problem, arrays=arrays)
