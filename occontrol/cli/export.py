"""occontrol export: a run in the format of another tool."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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

    for path in export_run(run, to, out):
        print(path)
    return 0
