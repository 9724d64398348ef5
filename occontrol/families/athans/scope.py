"""What is worked out from one plant, a prior, an end and a sum of traces refuses every other problem here."""

from __future__ import annotations

from occontrol.core.errors import UsageError
from occontrol.families.athans.base import AthansProblem


def require_traces(problem: AthansProblem, what: str) -> None:
    """Raise UsageError unless the cost of a problem is a sum of traces along the covariance of one plant.

    Parameters
    ----------
    problem : of the family
    what : the plural that is worked out, for the sentence, such as "sensitivities"
    """
    why = ""
    if problem.of_targets:
        why = "of many targets"
    elif problem.infinite:
        why = "of a horizon without end"
    elif not problem.prior:
        why = "without a prior"
    elif problem.measured and problem.criterion is not None:
        why = f"with criterion {problem.criterion.name}"
    if why:
        raise UsageError(f"there are no {what} {why}\n  hint: a study varies what matters: occontrol sweep")
