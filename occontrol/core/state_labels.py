"""What the states of a problem are called in every file and picture: the user's names and units, or x1, x2, ...

Units are labels only: nothing is ever converted.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from occontrol.core.errors import Mistake
from occontrol.core.expression import reserved

LONGEST = 40
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*", re.ASCII)
_COLUMNS = re.compile(r"(sd_.*|w[0-9]+(_now)?|nis|nees|utc|start|end|sensors?|time|x[0-9]+)", re.ASCII)


def default_names(count: int) -> list[str]:
    """x1, x2, ..."""
    return [f"x{i + 1}" for i in range(count)]


def state_names(owner: object) -> list[str]:
    """The names of the states of a problem or a plant, the user's or x1, x2, ..

    Parameters
    ----------
    owner : a problem of any family, a plant, or a number of states
    """
    if isinstance(owner, int):
        return default_names(owner)
    plant = getattr(owner, "plant", owner)
    # a jumping-mode plant has names, too, but of its modes: names of states come with units
    given = getattr(plant, "names", ()) if hasattr(plant, "units") else ()
    return list(given) or default_names(int(getattr(plant, "states", 0)))


def state_units(owner: object) -> list[str]:
    """The units of the states, "" where none is said.

    Parameters
    ----------
    owner : a problem of any family, a plant, or a number of states
    """
    units = getattr(getattr(owner, "plant", owner), "units", ())
    return list(units) or [""] * len(state_names(owner))


def state_labels(owner: object) -> list[str]:
    """Name and unit of every state as an axis is labelled: "vx [m/s]".

    Parameters
    ----------
    owner : a problem of any family, a plant, or a number of states
    """
    pairs = zip(state_names(owner), state_units(owner), strict=True)
    return [f"{name} [{unit}]" if unit else name for name, unit in pairs]


def wrong_labels(names: Sequence[str], units: Sequence[str], states: int) -> list[Mistake]:
    """Mistakes in the names and units of a plant with so many states; paths begin with "states" or "units".

    Parameters
    ----------
    names, units : as the user gives them, one per state, or empty
    states : n
    """
    found = []
    have = f"the plant has {states} state{'s' * (states != 1)}"
    for key, given in (("states", names), ("units", units)):
        if len(given) not in (0, states):
            entries = f"{len(given)} entr{'y' if len(given) == 1 else 'ies'}"
            found.append(Mistake((key,), f"{key} has {entries}, {have}", "one entry per state"))
    for i, name in enumerate(names):
        if mistake := wrong_name(name, i, names):
            found.append(Mistake(("states", i), *mistake))
    for i, unit in enumerate(units):
        if not isinstance(unit, str) or len(unit) > LONGEST or not unit.isprintable():
            hint = 'a label such as m/s; "" for none'
            found.append(Mistake(("units", i), f"the unit of state {i + 1} is {unit!r:.60}", hint))
    return found


def wrong_name(name: object, i: int, names: Sequence[str]) -> tuple[str, str] | None:
    """What is wrong with the name of state i, and a hint; None where it is good.

    Parameters
    ----------
    name : as given
    i : its position
    names : of all states
    """
    if not isinstance(name, str) or not _WORD.fullmatch(name) or len(name) > LONGEST:
        return f"the name of state {i + 1} is {name!r:.60}", "letters, digits and _, not beginning with a digit"
    if why := reserved(name):
        return f"the state name '{name}' is {why}", "choose another name"
    if _COLUMNS.fullmatch(name) and name != f"x{i + 1}":
        return f"the state name '{name}' is kept for a column of result files", "choose another name"
    if name in names[:i]:
        return f"the state name '{name}' stands twice", "names of states must differ"
    return None
