"""Vectors of formulas: checking and compiling them for plants and measurements alike."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.expression import parse_expression
from occontrol.core.jumps import require_still
from occontrol.core.kinds import Casadi


def unknown_model(kind: str, name: str, known: Sequence[str]) -> Mistake:
    """The mistake of naming a model that does not exist, with the nearest that does."""
    close = difflib.get_close_matches(str(name), list(known), n=1)
    hint = f"did you mean '{close[0]}'?" if close else "known models: " + ", ".join(known)
    return Mistake(("model",), f"unknown {kind} model '{name}'", hint)


def check_formulas(entries: Sequence[float | str], names: tuple[str, ...], key: str) -> list[Mistake]:
    """Check a list of numbers and formulas of `names` that stands under `key`.

    What compares states, or steps with them, jumps at times that nobody knows beforehand; what compares t jumps between
    the steps of whoever integrates along a path. Both are refused; k in discrete time may be compared.
    """
    mistakes = []
    for i, entry in enumerate(entries):
        if isinstance(entry, str):
            try:
                require_still(parse_expression(entry, names))
            except ProblemError as error:
                mistakes += [m.under(key, i) for m in error.mistakes]
        elif isinstance(entry, bool) or not isinstance(entry, int | float) or not np.isfinite(entry):
            mistakes.append(Mistake((key, i), f"entry {i + 1} of {key} is not a number or a formula"))
    return mistakes


def stack_formulas(entries: Sequence[float | str], names: tuple[str, ...], symbols: dict[str, Casadi]) -> Casadi:
    """The CasADi column of checked formulas."""
    import casadi

    rows = [parse_expression(e, names).casadi(symbols) if isinstance(e, str) else casadi.SX(float(e)) for e in entries]
    return casadi.vertcat(*rows)


class Compiled:
    """Functions are rebuilt after pickling: what is kept is the description."""

    def __getstate__(self) -> dict:
        return {key: value for key, value in self.__dict__.items() if not key.startswith("_function")}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
