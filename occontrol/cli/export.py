"""occontrol export: a run in the format of another tool."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.output import note

RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.", show_default=False)]


def export(
    run: RunFolder,
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="csv, json, ...", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File or folder [default: inside the run folder].")
    ] = None,
) -> int:
    """Write schedule, gains, covariance and the rest of a run for another tool."""
    from occontrol.api import export_run
    from occontrol.files.spreadsheet import any_quoted

    written = export_run(run, to, out)
    for path in written:
        print(path)
    if any_quoted(written):
        note("names that a spreadsheet would compute are written with an apostrophe before them")
    return 0
