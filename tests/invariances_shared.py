"""How the invariances of all families but athans are judged: None where one holds, or what is wrong in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from occontrol.core.errors import OccontrolError
from occontrol.core.solution import Solution

Found = dict[str, str | None]


def powers(rng: np.random.Generator, n: int) -> np.ndarray:
    """(n,) powers of two whose ratios reach 1e12."""
    return 2.0 ** rng.integers(-20, 21, n)


def near(what: str, a: float, b: float, share: float) -> str | None:
    """None if two numbers agree to a share of theirs."""
    return None if abs(a - b) <= share * max(abs(a), abs(b)) else f"{what} {a!r} and {b!r}"


def same(a: Solution, b: Solution, share: float, factor: float = 1.0) -> str | None:
    """Costs, and bounds where there are some, of `b` are `factor` times those of `a`, to a share."""
    for key in ("cost", "lower_bound"):
        x, y = a.result.get(key), b.result.get(key)
        if (x is None) != (y is None):
            return f"{key} {x!r} and {y!r}"
        if x is not None and (wrong := near(key, float(x), float(y) / factor, share)):
            return wrong
    return None


def bounded(a: Solution, b: Solution, share: float = 1e-9, cuts: bool = False) -> str | None:
    """No bound of either lies above a cost of the other, but for rounding; of `b` only where it has finer slots."""
    for x, y in ((b, a),) if cuts else ((a, b), (b, a)):
        bound = x.result.get("lower_bound")
        if isinstance(bound, float) and bound > y.result["cost"] * (1 + share):
            return f"the bound {bound!r} is above the cost {y.result['cost']!r}"
    return None


def tried(found: Found, name: str, judge: Callable[[], str | None]) -> None:
    """Enter what a judge says; a refusal is a fault as well."""
    try:
        found[name] = judge()
    except OccontrolError as error:
        found[name] = f"refused: {str(error).splitlines()[0]}"
