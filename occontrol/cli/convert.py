"""occontrol convert: a problem of one family as a file of another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.complete import complete_family
from occontrol.cli.output import note
from occontrol.cli.solve import ProblemFile


def convert(
    file: ProblemFile,
    to: Annotated[
        str,
        typer.Option("--to", metavar="FAMILY", help="The family to convert to.", autocompletion=complete_family),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write [default: FILE's name with the family, .json].")
    ] = None,
    step: Annotated[float | None, typer.Option("--step", help="Time between readings, for a family in steps.")] = None,
    level: Annotated[float | None, typer.Option("--level", help="Energy of unknown inputs, for robust.")] = None,
    slots: Annotated[int | None, typer.Option("--slots", help="Slots of equal length, for robust.")] = None,
) -> int:
    """Write a problem as one of another family, for example an on-line selection as a plan."""
    from occontrol.api import converted, read_problem
    from occontrol.core.conversion import Asked
    from occontrol.core.errors import FileAccessError, UsageError
    from occontrol.core.versions import stamped
    from occontrol.files.atomic import refuse_same, write_text
    from occontrol.files.plain_json import to_json

    target = out or file.with_name(f"{file.stem}_{to}.json")
    if target.suffix.lower() != ".json":
        raise UsageError(f"{target} does not end in .json\n  hint: --out {target.with_suffix('.json')}")
    if out is None and target.exists():
        raise FileAccessError(f"{target} exists already\n  hint: --out FILE writes over it")
    refuse_same([target], [file])
    problem = read_problem(file)
    found, remarks = converted(problem, to, Asked(step, level, slots))
    write_text(target, to_json(stamped(found)) + "\n")
    for remark in remarks:
        note(remark)
    typer.echo(f"written {target}")
    return 0
