"""Which program wrote a file, and in which edition of the keys."""

from __future__ import annotations

from functools import lru_cache

from occontrol.core.errors import Mistake
from occontrol.core.kinds import PlainDict, PlainMapping

# of problem files, result.json, exports and study.json; rises where an older program would misread a newer file, not
# where keys are added: unknown ones are refused by name anyway
SCHEMA_VERSION = 1
KEY = "schema_version"


def newer(document: PlainMapping) -> Mistake | None:
    """What to say of a document of a later edition, of which nothing else can be judged; None for one that can be read.

    Parameters
    ----------
    document : that may say its `schema_version`; without it, it is of this edition
    """
    found = document.get(KEY)
    if not isinstance(found, int) or isinstance(found, bool) or found <= SCHEMA_VERSION:
        return None
    hint = "a newer occontrol wrote this: pip install --upgrade occontrol"
    return Mistake((KEY,), f"{KEY} is {found}, this version of occontrol reads up to {SCHEMA_VERSION}", hint)


def stamped(content: PlainMapping) -> PlainDict:
    """The content of a file, with the edition of its keys first.

    Parameters
    ----------
    content : by key
    """
    return {KEY: SCHEMA_VERSION, **content}


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Versions of this package and of the numerical libraries below it."""
    from importlib.metadata import PackageNotFoundError, version

    found = {}
    for name in ("occontrol", "numpy", "scipy", "casadi", "numba", "clarabel"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
