"""Problems from documents that are no files."""

from __future__ import annotations

from pathlib import Path

from occontrol.core.kinds import PlainMapping
from occontrol.core.problem import BaseProblem
from occontrol.families import find_family


def problem_of(document: PlainMapping) -> BaseProblem:
    """The problem that a document describes; tables must be embedded in it.

    Parameters
    ----------
    document : as `document(problem)` gives it

    Raises ProblemError with every mistake.
    """
    from occontrol.files.positions import Place, Text
    from occontrol.files.problem_file import LoadedDocument

    family = str(document["family"])
    text = Text("problem", dict(document), lambda: Place(1, 1))
    return LoadedDocument(Path("problem.json"), text, family, find_family(family).schema()).build_unplaced()
