"""What one more unit of a budget is worth, in a line for each."""

from __future__ import annotations

from occontrol.families.athans.result import AthansResult

NO_PRICE = 1e-9  # of the cost: what is not worth a line


def prices(result: AthansResult) -> list[tuple[str, str]]:
    """(label, text) of every budget that has a price.

    Parameters
    ----------
    result : AthansResult of a search under rules
    """
    found = {rule: price for rule, price in (result.multipliers or {}).items() if price > NO_PRICE * abs(result.cost)}
    return [(f"one more {rule}", f"saves about {price:.4g}") for rule, price in found.items()]
