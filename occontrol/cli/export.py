"""occontrol export: a run in the format of another tool, or as code for a target."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.complete import complete_format, complete_run
from occontrol.cli.output import note, print_pairs

RunFolder = Annotated[
    Path, typer.Argument(metavar="RUN", help="Run folder.", show_default=False, autocompletion=complete_run)
]
DISAGREES = 7


def export(
    run: RunFolder,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="csv, json, npz, mat, c, nc, matlab, flight or fmu.",
            show_default=False,
            autocompletion=complete_format,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File or folder [default: inside the run folder].")
    ] = None,
    precision: Annotated[
        str | None, typer.Option("--precision", metavar="P", help="double [default] or single (flight).")
    ] = None,
    gains_only: Annotated[bool, typer.Option("--gains-only", help="Gains without covariances (flight).")] = False,
    no_plan: Annotated[bool, typer.Option("--no-plan", help="Covariances without planned gains (flight).")] = False,
    prefix: Annotated[
        str | None, typer.Option("--prefix", metavar="P", help="Of all names in C [default: oc_RUN] (flight).")
    ] = None,
    fmi: Annotated[int | None, typer.Option("--fmi", metavar="2|3", help="Edition of FMI [default: 3] (fmu).")] = None,
    build: Annotated[bool, typer.Option("--build", help="Put a binary of this computer into it (fmu).")] = False,
    verify: Annotated[
        bool, typer.Option("--verify", help="Write nothing: compile what was written, compare it (flight).")
    ] = False,
) -> int:
    """Write schedule, gains, covariance and the rest of a run for another tool, or its filter as code for a target."""
    from occontrol.api import export_run
    from occontrol.files.spreadsheet import any_quoted

    named = {"precision": precision, "gains_only": gains_only, "no_plan": no_plan, "prefix": prefix}
    options = {name: value for name, value in (named | {"fmi": fmi, "build": build}).items() if value}
    if verify:
        return _verified(run, to, out, options)
    written = export_run(run, to, out, **options)
    for path in written:
        print(path)
    if any_quoted(written):
        note("names that a spreadsheet would compute are written with an apostrophe before them")
    return 0


def _verified(run: Path, to: str, out: Path | None, options: dict) -> int:
    from occontrol.api.target import verify_target
    from occontrol.files.export import check_format

    check_format(to)
    found = verify_target(run, to, out, **options)
    print_pairs(found.lines)
    return DISAGREES if found.differs else 0
