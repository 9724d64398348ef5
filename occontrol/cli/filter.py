"""occontrol filter: the matched filter and predictor over a measurement file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.export import RunFolder
from occontrol.cli.output import note


def filter_measurements(
    run: RunFolder,
    measurements: Annotated[Path, typer.Argument(metavar="MEASUREMENTS", help="Measurement file.", show_default=False)],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="CSV", help="File to write.", show_default=False)],
) -> int:
    """Estimate the state, and predict the output, from a file of measurements."""
    from occontrol.files.data_files import read_measurements
    from occontrol.files.run_folder import read_run
    from occontrol.files.tables import write_estimate
    from occontrol.library import run_filter

    problem, solution = read_run(run)
    estimate = run_filter(problem, solution, read_measurements(measurements, problem))
    write_estimate(out, estimate)
    for remark in estimate.notes:
        note(remark)
    note(f"{len(estimate.times)} estimates in {out}")
    return 0
