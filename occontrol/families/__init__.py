"""Five siblings, one table.

A family module offers
    METHODS           {name: frozen dataclass of options}; the first is the default
    Problem           the frozen dataclass of its problems (with `name`, and `method`: a METHODS value)
    solve(problem, method=None, monitor=None) -> Solution
    summarise(problem, solution) -> [(label, text)]      the lines that the command line prints
    describe(problem) -> [(label, text)]                 what `check` prints
    COMPARE           the method names that `compare` runs when none are given
and, where the family can, `simulate`, `run_filter`, `certify`, `tradeoff`.
"""

from __future__ import annotations

import importlib
from types import ModuleType

FAMILIES = {
    "athans": "off-line schedules in continuous time with a certificate (Athans 1971)",
    "vlambda": "on-line selection along the worst eigendirection (Oshman 1994)",
    "hybrid": "sensors for jumping-mode plants (Liu & Hwang)",
    "precision": "least sensor precision in ensemble and unscented filters (Das & Bhattacharya)",
    "robust": "switching against the worst admissible uncertainty (Savkin, Evans & Skafidas)",
}


def family_module(name: str) -> ModuleType:
    """The module of a family, imported only when it is used; KeyError for an unknown name."""
    if name not in FAMILIES:
        raise KeyError(name)
    return importlib.import_module(f"occontrol.families.{name}.family")
