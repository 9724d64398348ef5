"""From what readings tell of the state at the start to the objective of an experiment, on any clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import InfeasibleError
from occontrol.core.state_labels import state_names
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.criteria.statement import LARGEST, LOG_TRACE, LOGDET, SCHATTEN, CriterionChoice
from occontrol.scheduling.criteria import LargestEigenvalue, LogDeterminant, LogTrace, Schatten, independent_outputs
from occontrol.scheduling.criterion import Criterion, TraceCriterion
from occontrol.scheduling.information import InformationObjective
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.seen import Seen, Unseen, reduced

NAMED = 1e-6  # of the largest: what of a direction is told
UNSEEN = "no schedule sees the direction {direction} of the states at the start, and an output needs it"
TOO_FEW = "no schedule of these readings determines every state that the outputs need"


@dataclass(frozen=True, eq=False)
class Informed:
    """The objective of an experiment.

    Parameters
    ----------
    objective : the true one
    kept : (n, d) directions of the state at the start that it is in terms of
    note : what is to be said about it
    """

    objective: InformationObjective
    kept: np.ndarray
    note: str


def informed(
    problem: AthansProblem,
    seen: Seen,
    recursion: Recursion,
    upper: np.ndarray,
    stated: Callable[[np.ndarray], np.ndarray],
) -> Informed:
    """The objective of a problem without a prior.

    Parameters
    ----------
    problem : without a prior
    seen : what its readings, or its intervals, tell of all n states
    recursion : whose decisions and prices count
    upper : (N, M) positive where a sensor may be used
    stated : from a direction (n,) in the units of `seen` to one in the user's

    Raises InfeasibleError, with the direction, where no schedule sees what an output needs.
    """
    unknown, prices = problem.unknown, recursion.decision_cost
    whole = np.eye(problem.states)[:, unknown]
    try:
        kept, inner = reduced(seen.of(unknown), upper)
    except Unseen as unseen:
        direction = spelt(stated(whole @ unseen.direction), state_names(problem))
        hint = "hint: a sensor that sees it, another output, or an initial covariance"
        raise InfeasibleError(f"{UNSEEN.format(direction=direction)}\n  {hint}") from None
    note = ""
    if kept.shape[1] < len(kept):
        note = f"{len(kept) - kept.shape[1]} directions of the states that no reading sees are needed by no output."
    output, choice = inner.output, problem.criterion or CriterionChoice()
    criterion: Criterion = TraceCriterion(output.T @ output)
    if choice.name == LOGDET:
        every = InformationObjective(inner, criterion, prices, recursion).design.covariance(upper)
        independent = independent_outputs(output, every) if every is not None else output
        if len(independent) < len(output):
            count = len(independent)
            note += f" {len(output)} outputs have only {count} independent errors: the determinant is theirs."
        criterion = LogDeterminant(independent)
    elif choice.name == LARGEST:
        criterion = LargestEigenvalue(output)
    elif choice.name == LOG_TRACE:
        criterion = LogTrace(output)
    elif choice.name == SCHATTEN:
        criterion = Schatten(output, choice.power)
    objective = InformationObjective(inner, criterion, prices, recursion)
    if not np.isfinite(objective.cost(np.where(upper > 0, upper, 0.0))):
        raise InfeasibleError(TOO_FEW)
    return Informed(objective, whole @ kept, note.strip())


def spelt(direction: np.ndarray, names: Sequence[str]) -> str:
    """A direction (n,) in words: x1 - 0.5 x3.

    Parameters
    ----------
    direction : (n,)
    names : of the states
    """
    scaled = direction / direction[np.argmax(np.abs(direction))]
    parts = []
    for name, value in zip(names, scaled, strict=True):
        if abs(value) > NAMED:
            size = "" if abs(abs(value) - 1) < NAMED else f"{abs(value):.4g} "
            parts.append(f"{'-' if value < 0 else '+'} {size}{name}")
    text = " ".join(parts)
    return text[2:] if text.startswith("+") else f"-{text[2:]}"
