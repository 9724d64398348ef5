"""Plain JSON out of numbers, arrays and enums, and results back: no NaN, no infinity, no surprises."""

from __future__ import annotations

import enum
import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.kinds import Plain


def plain(value: object) -> Plain:
    """The same value made of dict, list, str, int, float, bool and None.

    Parameters
    ----------
    value : nested mappings, sequences, arrays, numpy scalars, enums, paths; NaN and infinities become None

    Raises TypeError for anything else, which is a fault of the program and not of the user.
    """
    if value is None or isinstance(value, bool | np.bool_):
        return None if value is None else bool(value)
    if isinstance(value, enum.Enum):
        return plain(value.value)
    if isinstance(value, str | Path):
        return str(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(entry) for entry in value]
    raise TypeError(f"cannot write a {type(value).__name__} as JSON")


def to_json(value: object, ascii_only: bool = False) -> str:
    """JSON text that reads back to the identical numbers.

    Parameters
    ----------
    value : anything that `plain` takes
    ascii_only : write other letters as escapes, for a stream that lacks them
    """
    return json.dumps(plain(value), indent=2, allow_nan=False, ensure_ascii=ascii_only) + "\n"


def load_json(path: Path) -> Plain:
    """The content of a JSON file that this program wrote.

    Parameters
    ----------
    path : the file

    Raises ProblemError naming the file and the place when it is not JSON, is binary, or holds NaN or infinities.
    """
    return parse_json(path.read_bytes(), path)


def parse_json(content: bytes, place: Path) -> Plain:
    """The value of JSON text; NaN and infinities are not JSON numbers, whole numbers of many digits become floats.

    Parameters
    ----------
    content : UTF-8
    place : what to call it in a message

    Raises ProblemError naming the place.
    """

    def refuse(text: str) -> None:
        raise ProblemError(Mistake((), f"holds {text[:40]}, which is not a JSON number", place=str(place)))

    def whole(text: str) -> int | float:
        return int(text) if len(text) <= 19 else float(text)

    try:
        return json.loads(content.decode("utf-8"), parse_constant=refuse, parse_int=whole)
    except json.JSONDecodeError as error:
        where = f"{place}:{error.lineno}:{error.colno}"
        raise ProblemError(Mistake((), f"not a complete JSON file: {error.msg}", place=where)) from None
    except UnicodeDecodeError:
        hint = "a JSON file in UTF-8 is expected"
        raise ProblemError(Mistake((), "not a text file", hint, place=str(place))) from None
    except RecursionError:
        raise ProblemError(Mistake((), "nested too deeply", place=str(place))) from None
