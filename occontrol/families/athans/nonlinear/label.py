"""What is said of a solution of a linearised problem: whose certificate it is, and whether the plan may be trusted."""

from __future__ import annotations

import dataclasses
from typing import cast

import numpy as np

from occontrol.core.errors import Mistake
from occontrol.core.solution import Solution
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.nonlinear.index import Nonlinearity, in_turn, index_of, nonlinearity
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.families.athans.result import AthansResult

DOUBTFUL = 1.0
OF_LINEARISED = (
    "Cost and bound are of the problem linearised along its nominal path; they bound nothing of the plant itself."
)
CURE = "ask for readings earlier: objective.running, or a limit on the error"


def labelled(problem: AthansProblem, solution: Solution) -> Solution:
    """A solution that says that its certificate is of the linearised problem, with the index of its plan.

    Parameters
    ----------
    problem : of any kind; a linear one's solution is left alone
    solution : of it
    """
    origin = linearisation_of(problem)
    if origin is None or not isinstance(solution.numbers, AthansResult):
        return solution
    if problem.prior:
        index = index_of(cast(AthansProblem, solution.problem or problem), solution)
    else:
        index = Nonlinearity.without_prior()
    message = " ".join(part for part in (solution.message, OF_LINEARISED) if part)
    warnings = list(solution.numbers.warnings)
    if problem.prior and not index.worst <= DOUBTFUL:
        remark = f"the plan leaves the range of its linearisation (nonlinearity: {index.text}; above 1 is doubtful)"
        warnings.append(f"{remark}: a filter along it may diverge; {CURE}")
        message += f" {remark[0].upper()}{remark[1:]}: a filter along it may diverge. Hint: {CURE}."
    values = index.as_dict() if problem.prior else None
    numbers = dataclasses.replace(
        solution.numbers, certificate_of="linearised", nonlinearity=values, warnings=warnings
    )
    arrays = dict(solution.arrays)
    if "times" in arrays:  # (K, n), what the plan was linearised along
        arrays["nominal"] = origin.nominal.path.at(np.asarray(arrays["times"]))
    return dataclasses.replace(solution, message=message, numbers=numbers, arrays=arrays)


def describe_linearised(problem: AthansProblem) -> list[tuple[str, str]]:
    """What `check` adds for a nonlinear plant; nothing for a linear one.

    Parameters
    ----------
    problem : of any kind
    """
    origin = linearisation_of(problem)
    if origin is None:
        return []
    plant, nominal = origin.plant, origin.nominal
    path = "the one that the file states" if plant.nominal is not None else "from the initial mean"
    fixed = f" (parameters: {', '.join(plant.parameters)})" if plant.parameters else ""
    lines = [("states", ", ".join(plant.names) + fixed)]
    if plant.discrete:
        lines.append(("nominal path", f"{path}, by the map itself"))
    else:
        chosen = "stated" if origin.integrator.substeps is not None else "chosen by accuracy"
        change = f"doubling them changes path and maps by {nominal.change:.2g} of themselves"
        lines.append(("nominal path", f"{path}, {nominal.substeps} substeps of a span, {chosen}; {change}"))
    index = nonlinearity(problem, in_turn(problem)) if problem.prior else Nonlinearity.without_prior()
    lines.append(("nonlinearity", f"with every sensor in turn: {index.text}; above 1 the linearisation is doubtful"))
    lines.append(("certificate", "of the problem linearised along the nominal path"))
    return lines


def summarise_linearised(solution: Solution) -> list[tuple[str, str]]:
    """What is printed after a solve for a nonlinear plant; nothing for a linear one.

    Parameters
    ----------
    solution : of any kind
    """
    numbers = solution.numbers
    if not isinstance(numbers, AthansResult) or numbers.certificate_of != "linearised":
        return []
    index = numbers.nonlinearity
    if index is None:
        return [("certificate of", "the problem linearised along its nominal path")]
    doubt = "" if max(index.values(), default=0.0) <= DOUBTFUL else "   above 1: the plan may mislead a filter"
    values = ", ".join(f"{name} {value:.3g}" for name, value in index.items())
    return [("certificate of", "the problem linearised along its nominal path"), ("nonlinearity", f"{values}{doubt}")]


def doubts(problem: AthansProblem) -> list[Mistake]:
    """The warning that even with every sensor in turn the linearisation is doubtful.

    Parameters
    ----------
    problem : of any kind
    """
    if linearisation_of(problem) is None or not problem.prior:
        return []
    index = nonlinearity(problem, in_turn(problem))
    if index.worst <= DOUBTFUL:
        return []
    what = f"the linearisation is doubtful: with every sensor in turn its nonlinearity is {index.text} (above 1)"
    return [Mistake(("plant", "initial"), what, "a better initial estimate, or more readings at the start")]
