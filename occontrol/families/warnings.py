"""What a problem says that is allowed and hardly meant; each family that has something to say has a module for it."""

from __future__ import annotations

import importlib
from typing import Any

from occontrol.core.errors import Mistake

# families whose `warnings` module offers warnings_of(problem)
_SPEAKING = ("athans", "precision")


def warnings_of(problem: Any) -> list[Mistake]:
    """Warnings with their paths in the problem document; an empty list where all is well.

    Parameters
    ----------
    problem : of any family
    """
    if problem.family not in _SPEAKING:
        return []
    return importlib.import_module(f"occontrol.families.{problem.family}.warnings").warnings_of(problem)
