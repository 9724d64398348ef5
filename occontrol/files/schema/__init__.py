"""One module for each family: `Document` (pydantic), `build(document, context)` and its inverse `document(problem)`."""

from __future__ import annotations

import importlib
from types import ModuleType

from occontrol.families import FAMILIES

SCHEMAS = {family: f"occontrol.families.{family}.schema" for family in FAMILIES}


def schema_for(family: str) -> ModuleType:
    """The schema module of a family, imported only when it is used; KeyError for an unknown name."""
    return importlib.import_module(SCHEMAS[family])
