"""What every method of every family is: a frozen dataclass of its own options that checks and runs itself."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, ClassVar, Protocol, runtime_checkable

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.kinds import PlainDict


class Options(Protocol):
    """Options of something that has a name, such as a method."""

    name: ClassVar[str]


@runtime_checkable
class Method(Protocol):
    """A method as a value.

    `name` is what problem files and the command line call it. The options are the fields of the dataclass; values that
    make no sense for any problem are refused when the object is made (see `check_options`), those that do not fit a
    given problem by `check`.
    """

    name: ClassVar[str]

    def check(self, problem: Any) -> Sequence[Mistake]:
        """What is wrong with these options for `problem`, paths below `method`; empty when they fit."""
        return ()

    def run(self, problem: Any, *arguments: Any, **options: Any) -> Any:
        """Run on `problem`; what else goes in and what comes out is the family's business."""
        ...


def check_options(
    method: Options,
    positive: Sequence[str] = (),
    at_least: dict[str, float] | None = None,
    one_of: dict | None = None,
    whole: dict[str, int] | None = None,
) -> None:
    """Refuse options that no problem can make sense of; called in `__post_init__` of a method.

    Parameters
    ----------
    method : the dataclass
    positive : names of options that must be finite numbers above zero (None is 'left out' and passes)
    at_least : option name: smallest value (None passes)
    one_of : option name: the values that it may have
    whole : option name: smallest value, of options that must be whole numbers (None passes)

    Raises ProblemError naming every wrong option.
    """
    found: list[Mistake] = []

    def add(name: str, hint: str) -> None:
        found.append(Mistake((name,), f"{name} of method {method.name} is {getattr(method, name)!r}", hint))

    for name in positive:
        value = getattr(method, name)
        if value is not None and not (_is_number(value) and value > 0):
            add(name, "a number above 0")
    for name, low in (at_least or {}).items():
        value = getattr(method, name)
        if value is not None and not (_is_number(value) and value >= low):
            add(name, f"a number of at least {low:g}")
    for name, low in (whole or {}).items():
        value = getattr(method, name)
        if value is not None and not (isinstance(value, int) and _is_number(value) and value >= low):
            add(name, f"a whole number of at least {low}")
    for name, allowed in (one_of or {}).items():
        if getattr(method, name) not in allowed:
            add(name, "one of: " + ", ".join(str(a) for a in allowed))
    if found:
        raise ProblemError(found)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def options_in_common(own: Any, kind: type) -> PlainDict:
    """The options that `own` states beyond its defaults and that the method class `kind` has too.

    Parameters
    ----------
    own : a method object, or None
    kind : a method class
    """
    if own is None:
        return {}
    known = {f.name for f in dataclasses.fields(kind) if f.init}
    stated = {f.name: getattr(own, f.name) for f in dataclasses.fields(own) if getattr(own, f.name) != f.default}
    return {option: value for option, value in stated.items() if option in known}
