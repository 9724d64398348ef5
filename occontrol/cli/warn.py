"""What a problem file says that is allowed, and that its author hardly meant: warnings, or with --strict mistakes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from occontrol.cli.output import note
from occontrol.core.problem import BaseProblem


def warn_of(problem: BaseProblem, file: Path, strict: bool) -> None:
    """Print the warnings about a problem on standard error, with their places in its file.

    Parameters
    ----------
    problem : of any family
    file : that it was read from
    strict : whether they are mistakes

    Raises ProblemError when there are warnings and `strict` is set.
    """
    from occontrol.api import family_of, placed

    found = family_of(problem).warnings(problem)
    if not found:
        return
    error = placed(file, found)
    if strict:
        raise error
    for mistake in error.mistakes:
        note(str(replace(mistake, what=f"warning: {mistake.what}")))
