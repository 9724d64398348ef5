"""occontrol filter: the matched filter and predictor over a measurement file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from occontrol.cli.export import RunFolder
from occontrol.cli.output import note
from occontrol.core.errors import Mistake, ProblemError, UsageError
from occontrol.core.problem import BaseProblem

if TYPE_CHECKING:
    from occontrol.core.measurement import Estimate
    from occontrol.core.solution import Solution
    from occontrol.core.trajectory import Trajectory


def filter_measurements(
    run: RunFolder,
    measurements: Annotated[
        Path, typer.Argument(metavar="MEASUREMENTS", help="Measurement file; - for JSON lines.", show_default=False)
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="CSV", help="File to write.", show_default=False)
    ] = None,
    model: Annotated[
        str | None,
        typer.Option("--model", help="split [default], exact (coarse grids); of nonlinear plants ekf, iterated, ukf."),
    ] = None,
    gate: Annotated[
        float | None,
        typer.Option("--gate", metavar="P", help="Leave out samples farther off than that, such as 0.9999 (athans)."),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option("--tolerance", metavar="T", help="How far times may lie from the schedule's, in its unit."),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option("--truth", metavar="CSV", help="True states [default: MEASUREMENTS' name.truth.csv, if there]."),
    ] = None,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw pictures beside the CSV.")] = True,
) -> int:
    """Estimate the state, and predict the output, from a file of measurements; the run folder is all it needs.

    With - a line {"t": .., "readings": {"NAME": [..]}} on standard input gives a line of answer on standard output.
    """
    from occontrol.api import family_of, read_measurements, read_run, run_filter
    from occontrol.core.calendar import calendar_of
    from occontrol.core.irregular import expected_times, moved
    from occontrol.core.state_labels import state_names
    from occontrol.files.atomic import refuse_same
    from occontrol.files.run_record import refuse_run_files
    from occontrol.files.tables import write_estimate
    from occontrol.files.truth_file import read_truth
    from occontrol.numerics.consistency import judge_run

    options = {name: value for name, value in (("model", model), ("gate", gate)) if value is not None}
    if str(measurements) == "-":
        if out is not None or truth is not None:
            raise UsageError("with - the answers go to standard output\n  hint: no --out, no --truth")
        return _stream(run, options)
    if out is None:
        raise UsageError("a file is needed for the estimates\n  hint: --out estimate.csv")
    beside = measurements.with_name(measurements.stem + ".truth.csv")
    source = truth or (beside if beside.exists() else None)
    page = out.with_name(f"{out.stem}.html")
    refuse_same([out, page], [measurements, source])
    for target in (out, page):
        refuse_run_files(run, target)
    problem, solution = read_run(run)
    samples, shifted = read_measurements(measurements, problem), ""
    try:
        if tolerance is not None:
            samples, shifted = moved(samples, expected_times(problem), tolerance)
        estimate = run_filter(problem, solution, samples, **options)
    except ProblemError as error:
        raise ProblemError([_in_file(m, measurements) for m in error.mistakes]) from None
    known = None if source is None else read_truth(source, estimate.times, estimate.mean.shape[1])
    nees = None if known is None else judge_run(estimate, known).nees[0]
    write_estimate(out, estimate, state_names(problem), nees, calendar_of(problem))
    said = [shifted] * bool(shifted) + list(estimate.notes)
    if known is not None:
        said.append(family_of(problem).truth_remark(estimate, known, source))
    for remark in said:
        note(remark)
    written = _draw(problem, solution, estimate, known, page, said) if figures else []
    note(f"{len(estimate.times)} estimates in {out}" + (f", pictures in {', '.join(written)}" if written else ""))
    return 0


def _stream(run: Path, options: dict) -> int:
    """Answer lines until there are no more; 3 if one of them was refused."""
    import json
    import sys

    from occontrol.api import read_run
    from occontrol.api.stream import filter_stream

    problem, solution = read_run(run)
    refused = False
    for answer in filter_stream(problem, solution, sys.stdin, **options):
        refused |= "error" in answer
        print(json.dumps(answer, allow_nan=False), flush=True)
    return ProblemError.exit_code if refused else 0


def _in_file(mistake: Mistake, file: Path) -> Mistake:
    """A mistake of the filter, with the file's name before its line."""
    if mistake.place.startswith("line "):
        return replace(mistake, place=f"{file}:{mistake.place[5:]}")
    return replace(mistake, place=mistake.place or str(file))


def _draw(
    problem: BaseProblem,
    solution: Solution,
    estimate: Estimate,
    truth: Trajectory | None,
    page: Path,
    said: Sequence[str],
) -> list[str]:
    from occontrol.api import write_estimate_page

    try:
        written = write_estimate_page(page, problem, solution, estimate, truth, said)
    except (ValueError, ArithmeticError, LookupError, TypeError, AttributeError, RuntimeError) as error:
        note(f"the pictures could not be drawn: {type(error).__name__}: {error}")
        return []
    return [path.name for path in written]
