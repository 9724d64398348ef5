"""What a problem file says that is allowed, and that its author hardly meant: warnings, or with --strict mistakes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from occontrol.cli.output import note


def warn_of(problem: Any, file: Path, strict: bool) -> None:
    """Print the warnings about a problem on standard error, with their places in its file.

    Parameters
    ----------
    problem : of any family
    file : that it was read from
    strict : whether they are mistakes

    Raises ProblemError when there are warnings and `strict` is set.
    """
    from occontrol.families.warnings import warnings_of
    from occontrol.files.problem_file import load_document

    found = warnings_of(problem)
    if not found:
        return
    placed = load_document(file).text.placed(found)
    if strict:
        raise placed
    for mistake in placed.mistakes:
        note(str(replace(mistake, what=f"warning: {mistake.what}")))
