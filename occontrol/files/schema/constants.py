"""Constants of a problem file: numbers with names, put into every formula in their place.

    constants: {q: 0.3, drag: "2*q"}        # a formula may use the others, in any order

What is built from a file knows no constants: a formula that uses some is rewritten with their values, digit for digit,
and one in which nothing else varies becomes a number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from occontrol.core.errors import Collector, ProblemError
from occontrol.core.expression import parse_expression, reserved, value_of
from occontrol.core.kinds import Plain
from occontrol.files.schema.words import shown

MOST = 1000
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*", re.ASCII)
_VARIABLE = re.compile(r"[xp][0-9]+", re.ASCII)


class Constants:
    """The constants of one problem file.

    Parameters
    ----------
    given : what stands under `constants`; None for nothing
    found : where mistakes are noted
    taken : names of states, which no constant may have
    """

    def __init__(self, given: Plain, found: Collector, taken: Sequence[str] = ()):
        self.values: dict[str, float] = {}
        if given is None:
            return
        if not isinstance(given, dict) or len(given) > MOST:
            what = f"has more than {MOST}" if isinstance(given, dict) else f"is {shown(given)}, it must be a mapping"
            found.add(("constants",), f"constants {what}", "{q: 0.3, drag: 2*q}")
            return
        self.found, self._open = found, dict(given)
        for name in given:
            if hint := _unusable(name, taken):
                found.add(("constants", name), f"the constant '{name}' cannot have this name", hint, True)
                del self._open[name]
        while self._open:
            self._settle(next(iter(self._open)), ())

    def _settle(self, name: str, behind: tuple[str, ...]) -> None:
        """Work out one constant and those that it uses; one with a mistake stands as 1, so that the rest is read."""
        value, path = self._open.pop(name), ("constants", name)
        self.values[name] = 1.0
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            self.found.add(path, f"the constant '{name}' is {shown(value)}, it must be a number or a formula")
            return
        if isinstance(value, str):
            try:
                used = parse_expression(value, (*self.values, *self._open)).used
            except ProblemError as error:
                for m in error.mistakes:
                    self.found.add(path, f"the constant '{name}': {m.what}", m.hint)
                return
            for other in sorted(used):
                if other in (name, *behind):
                    what = f"the constant '{name}' uses '{other}'"
                    self.found.add(path, f"{what} itself" if other == name else f"{what}, which needs '{name}'")
                    return
                if other in self._open:
                    self._settle(other, (name, *behind))
            value = value_of(value, {n: self.values[n] for n in used})
        if not math.isfinite(value):
            self.found.add(path, f"the constant '{name}' is {shown(float(value))}, it must be finite")
            return
        self.values[name] = float(value)

    def put_into(self, text: str, variables: Sequence[str]) -> float | str:
        """The formula with the values of the constants in it; a number where nothing else varies.

        Parameters
        ----------
        text : a formula
        variables : what it may use beside the constants

        Raises ProblemError where `text` is not a formula of these.
        """
        own = tuple(variables)
        names = tuple(name for name in self.values if name not in own)
        used = parse_expression(text, (*own, *names)).used.intersection(names) if names else frozenset()
        if not used:
            parse_expression(text, own)
            return text
        values = {name: self.values[name] for name in used}
        if not parse_expression(text, (*own, *names)).used - used:
            return value_of(text, values)
        replaced = _names(values).sub(lambda found: f"({values[found[0]]!r})", text)
        parse_expression(replaced, own)
        return replaced


def _names(values: Mapping[str, float]) -> re.Pattern[str]:
    """Any of the names as a whole word; the e of 1e5 is none."""
    listed = "|".join(sorted(map(re.escape, values), key=len, reverse=True)) or "(?!)"
    return re.compile(rf"(?<![A-Za-z0-9_.])(?:{listed})(?![A-Za-z0-9_])")


def _unusable(name: str, taken: Sequence[str]) -> str:
    """Why a constant cannot have this name; empty where it can."""
    if not _WORD.fullmatch(name):
        return "letters, digits and _, not beginning with a digit"
    if why := reserved(name):
        return f"'{name}' is {why}"
    if name in taken:
        return f"'{name}' is a state of the plant"
    return f"'{name}' is a variable of formulas: x1, p1, .." if _VARIABLE.fullmatch(name) else ""
