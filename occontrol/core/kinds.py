"""The kinds of values that many signatures share, each under one name: plain data, matrices as users give them.

A dataclass that is given a matrix in any form and keeps it in one declares it by a `Kept`: what the constructor takes
comes first, what the attribute then is comes second. At run time these are plain annotations that nobody evaluates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar, overload

if TYPE_CHECKING:
    import casadi
    import numpy as np

    from occontrol.core.signal import Signal

Given = TypeVar("Given")
Held = TypeVar("Held")


class Kept(Generic[Given, Held]):
    """A dataclass field that takes a `Given` and, once the object is made, is a `Held`."""

    if TYPE_CHECKING:

        @overload
        def __get__(self, owner: None, kind: type) -> Kept[Given, Held]: ...
        @overload
        def __get__(self, owner: object, kind: type) -> Held: ...
        def __get__(self, owner: object, kind: type) -> Kept[Given, Held] | Held: ...
        def __set__(self, owner: object, value: Given) -> None: ...


def unless_given(value: object) -> Any:
    """What a `Kept` is given where nothing is: the default of the field."""
    return value


Plain: TypeAlias = Any
"""What JSON and YAML hold: a word, a number, a boolean, None, or lists and mappings of these; read key by key."""

PlainDict: TypeAlias = dict[str, Plain]
"""A mapping of plain data under construction, such as a problem document."""

PlainMapping: TypeAlias = Mapping[str, Plain]
"""A mapping of plain data that is only read, such as the content of result.json."""

MatrixLike: TypeAlias = "float | str | Sequence[Sequence[float | str]] | Sequence[np.ndarray] | np.ndarray | Signal"
"""What `as_signal` takes for a matrix that may depend on time: a number, a formula, rows of these, or a Signal."""

VectorLike: TypeAlias = "float | Sequence[float] | np.ndarray"
"""Numbers: one, a list, or an array."""

OptionalVectorLike: TypeAlias = "VectorLike | Sequence[float | None] | None"
"""Numbers of which some, or all, may be left out."""

SignalField: TypeAlias = "Kept[MatrixLike, Signal]"
OptionalSignalField: TypeAlias = "Kept[MatrixLike | None, Signal | None]"
ArrayField: TypeAlias = "Kept[MatrixLike | None, np.ndarray]"
VectorField: TypeAlias = "Kept[OptionalVectorLike, np.ndarray]"

Casadi: TypeAlias = "casadi.SX"
"""A symbol, an expression or a matrix of CasADi, whose classes share their operators."""

CasadiFunction: TypeAlias = "casadi.Function"
"""A compiled function of CasADi."""

CasadiSparsity: TypeAlias = "casadi.Sparsity"
"""Where a matrix of CasADi has entries."""
