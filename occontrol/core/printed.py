"""Numbers as they are printed, where rounding to nearest would say something false.

A proven bound of 1.23456789 printed with six digits to nearest reads 1.23457, which nobody has proven: a policy of cost
1.234569 would lie below it. So what is printed of a bound is rounded towards minus infinity.
"""

from __future__ import annotations

import math
from decimal import ROUND_FLOOR, Context


def rounded_down(bound: float | None, digits: int) -> str:
    """A lower bound with so many significant digits: the largest such number that is not above it.

    Parameters
    ----------
    bound : the bound, in the unit of the cost, or None where there is none
    digits : significant digits, 1 to 15

    Returns
    -------
    Text as format "g" writes it, "-" for None; what is not finite is written as it is.
    """
    if bound is None:
        return "-"
    if not math.isfinite(bound) or bound == 0.0:
        return f"{bound:g}"
    floor = Context(prec=digits, rounding=ROUND_FLOOR).create_decimal(repr(float(bound)))
    return f"{float(floor):.{digits}g}"
