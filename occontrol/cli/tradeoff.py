"""occontrol tradeoff: the certified front of observation cost against prediction error."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.output import note_linearised, number, percent, print_json, print_table
from occontrol.cli.solve import JsonFlag, ProblemFile, default_folder
from occontrol.core.printed import rounded_down


def tradeoff(
    file: ProblemFile,
    weights: Annotated[
        str, typer.Option("--weights", metavar="FROM:TO:COUNT", help="Cost weights, geometrically spaced.")
    ] = "1e-3:1e1:15",
    budget: Annotated[
        str | None,
        typer.Option(
            "--budget", metavar="FROM:TO:COUNT", help="Caps on the observation cost, in the place of weights."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder [default: runs/FILE's name-tradeoff].")
    ] = None,
    json: JsonFlag = False,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figures.")] = True,
) -> int:
    """Solve over a range of cost weights alpha, or of budgets: what a better prediction costs."""
    from occontrol.cli.watch import announce

    announce(f"tracing the front of {file}")
    from occontrol.api import family_of, read_problem
    from occontrol.api import tradeoff as trace
    from occontrol.cli.watch import exit_code, watched
    from occontrol.core.versions import stamped
    from occontrol.files.atomic import refuse_same
    from occontrol.files.run_folder import check_writable
    from occontrol.files.run_record import RESULT, refuse_run_files

    values = spaced(weights if budget is None else budget)
    folder = default_folder(file).with_name(file.stem + "-tradeoff") if out is None else out
    refuse_same([folder / "tradeoff.json", folder / "front.csv"], [file])
    if (folder / RESULT).exists():
        refuse_run_files(folder, folder / "arrays.npz")
    problem = read_problem(file)
    check_writable(folder)
    with watched() as monitor:
        front = trace(problem, values, monitor) if budget is None else trace(problem, (), monitor, budgets=values)
    content = stamped(front.as_dict())
    family_of(problem).write_tradeoff(folder, front, figures)
    if json:
        print_json(content)
    else:
        if budget is None:
            _print(content)
        else:
            _print_budgets(content)
        note_linearised([content])
        print(f"written  {folder}/")
    return exit_code(monitor, front.status.exit_code)


def _print(content: dict) -> None:
    headers = ("alpha", "observation cost", "error", "cost", "lower bound", "gap", "switches")
    rows = [
        (
            number(p["cost_weight"], 4),
            number(p["observation_cost"], 6),
            number(p["error"], 6),
            number(p["cost"]),
            rounded_down(p["lower_bound"], 8),
            percent(p["relative_gap"]),
            str(p["switches"]),
        )
        for p in content["points"]
    ]
    print_table(headers, rows, right=range(len(headers)))


def _print_budgets(content: dict) -> None:
    headers = ("budget", "observation cost", "error", "lower bound", "gap", "price", "switches")
    rows = [
        (
            number(p["budget"], 6),
            number(p["observation_cost"], 6),
            number(p["error"]),
            rounded_down(p["lower_bound"], 8),
            percent(p["relative_gap"]),
            number(p["price"], 4),
            str(p["switches"]),
        )
        for p in content["points"]
    ]
    print_table(headers, rows, right=range(len(headers)))
    for refused in content["refused"]:
        print(f"budget {refused['budget']:.6g}: {refused['why']}")


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
