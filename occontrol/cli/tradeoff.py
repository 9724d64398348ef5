"""occontrol tradeoff: the certified front of observation cost against prediction error."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.output import print_json
from occontrol.cli.solve import JsonFlag, ProblemFile


def tradeoff(
    file: ProblemFile,
    weights: Annotated[
        str, typer.Option("--weights", metavar="FROM:TO:COUNT", help="Cost weights, geometrically spaced.")
    ] = "1e-3:1e1:15",
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder [default: runs/FILE's name-tradeoff].")
    ] = None,
    json: JsonFlag = False,
) -> int:
    """Solve over a range of cost weights alpha: what a better prediction costs."""
    from occontrol.cli.watch import exit_code, watched
    from occontrol.core.errors import UsageError
    from occontrol.families import family_module
    from occontrol.files.problem_file import read_problem

    values = spaced(weights)
    problem = read_problem(file)
    module = family_module(problem.family)
    if not hasattr(module, "tradeoff"):
        raise UsageError(f"family {problem.family} has no trade-off between observation cost and prediction error")
    with watched() as monitor:
        front = module.tradeoff(problem, values, monitor)
    if json:
        print_json(front)
    return exit_code(monitor, 0)


def spaced(text: str) -> list[float]:
    """The values of FROM:TO:COUNT, geometrically spaced.

    Parameters
    ----------
    text : for example "1e-3:1e1:15"

    Raises UsageError when it is anything else.
    """
    import math

    from occontrol.core.errors import UsageError

    try:
        first, last, count = text.split(":")
        start, end, steps = float(first), float(last), int(count)
        if not (0 < start <= end < math.inf and 1 <= steps <= 10_000):
            raise ValueError
    except ValueError:
        raise UsageError(
            f"'{text}' is not FROM:TO:COUNT\n  hint: for example 1e-3:1e1:15, with 0 < FROM <= TO"
        ) from None
    if steps == 1:
        return [start]
    return [start * (end / start) ** (i / (steps - 1)) for i in range(steps)]
