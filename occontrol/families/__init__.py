"""The families, in one constant table; each is imported only when it is used.

`families/<name>/family.py` holds `FAMILY`, an object of a subclass of `Family` (family.py says what it offers). A new
family is a folder with that module and one line here.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING

from occontrol.core.errors import UsageError, suggest

if TYPE_CHECKING:
    from occontrol.families.family import Family

# name: (what it does, the module with FAMILY)
FAMILIES: dict[str, tuple[str, str]] = {
    "athans": (
        "off-line schedules with a certificate (Athans 1971)",
        "occontrol.families.athans.family",
    ),
    "vlambda": (
        "on-line selection along the worst eigendirection (Oshman 1994)",
        "occontrol.families.vlambda.family",
    ),
    "hybrid": (
        "sensors for jumping-mode plants (Liu & Hwang)",
        "occontrol.families.hybrid.family",
    ),
    "precision": (
        "least sensor precision in ensemble and unscented filters (Das & Bhattacharya)",
        "occontrol.families.precision.family",
    ),
    "robust": (
        "switching against the worst admissible uncertainty (Savkin, Evans & Skafidas)",
        "occontrol.families.robust.family",
    ),
}


def names() -> list[str]:
    """The names of all families, in the order of the table."""
    return list(FAMILIES)


def title(name: str) -> str:
    """What the family called `name` does, in one line; nothing is imported for it."""
    return FAMILIES[name][0]


def template(name: str) -> Path:
    """The commented problem file to start from that the family called `name` ships."""
    return Path(__file__).parent / name / "template.yaml"


def shipped_schema(name: str | None = None) -> Path:
    """The JSON Schema that the family called `name` ships for editors; None is that of all families together.

    scripts/write_schemas.py writes them.
    """
    return Path(__file__).parent / (name or "") / "schema.json"


def find_family(name: str) -> Family:
    """The family called `name`, imported now; UsageError for an unknown name."""
    if name not in FAMILIES:
        raise UsageError(f"there is no family '{name}'\n  hint: {suggest(str(name), FAMILIES)}")
    return importlib.import_module(FAMILIES[name][1]).FAMILY
