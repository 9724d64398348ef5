"""occontrol certify: cost, lower bound and gap of anybody's schedule."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from occontrol.cli.output import note, print_json, print_pairs
from occontrol.cli.solve import JsonFlag, write_with_figures
from occontrol.core.problem import BaseProblem

if TYPE_CHECKING:
    from occontrol.core.schedule import Schedule


def certify(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Problem file, or a run folder.", show_default=False)],
    schedule: Annotated[
        Path | None,
        typer.Argument(
            metavar="SCHEDULE", help="Schedule, csv or json; a run folder brings its own.", show_default=False
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Run folder to write, as solve does.")
    ] = None,
    json: JsonFlag = False,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figures of --out.")] = True,
) -> int:
    """Recompute cost, lower bound and gap of a schedule from the problem alone.

    With --out the run folder of the schedule is written: filter, export, simulate and show work on it.
    """
    from occontrol.cli.watch import announce

    announce(f"certifying {file if schedule is None else schedule}")
    from dataclasses import replace

    from occontrol.api import certify as call_certify
    from occontrol.api import is_run_of, read_problem, read_run, read_schedule, require
    from occontrol.core.errors import ProblemError, UsageError
    from occontrol.core.solution import Status
    from occontrol.families.family import Ability

    if out is not None:
        _refuse_inputs(out, file, schedule)
    claims, listed = None, True
    if file.is_dir():
        problem, recorded = read_run(file)
        family = require(problem, Ability.CERTIFY)
        given = recorded.schedule if schedule is None else read_schedule(schedule, problem)
        run = file if schedule is None else None
    else:
        if schedule is None:
            raise UsageError(
                "certify needs a schedule\n  hint: occontrol certify FILE SCHEDULE, or occontrol certify RUN"
            )
        problem = read_problem(file)
        # a family without bounds is a usage mistake, whatever the schedule is
        family = require(problem, Ability.CERTIFY)
        run = recorded = None
        if schedule.is_dir():
            solved, recorded = read_run(schedule)
            if is_run_of(schedule, solved, problem):
                # what a run says of its schedule is about its own problem only, on the edges that the solver used
                run, problem = schedule, solved
        given = read_schedule(schedule, problem)
    used = None if recorded is None else recorded.schedule
    if run is not None and recorded is not None and used is not None and given is not None:
        claims, listed = family.claims_of(problem, recorded), _is_listed(run, problem, used)
    if given is None:
        raise UsageError(f"the run of family {problem.family} holds no schedule that could be certified")
    try:
        solution = call_certify(problem, given, claims)
    except ProblemError as error:
        where = str(file if schedule is None else schedule)
        raise ProblemError([replace(m, place=m.place or where) for m in error.mistakes]) from None
    if not listed:
        what = "the schedule that result.json lists is not the one in arrays.npz"
        parts = [what, *([solution.message] if solution.status is Status.DISAGREES else [])]
        solution = replace(solution, status=Status.DISAGREES, message="; ".join(parts))
    content, written = solution.as_dict(), None
    if out is not None and solution.schedule is not None:
        placed = write_with_figures(out, problem, solution, figures)
        content, written = placed.content, placed.folder
        if placed.remark:
            note(f"{placed.remark}; " + (f"this one is in {written}" if written else "this one is not written"))
    if json:
        print_json(content)
    else:
        status = ("status", f"{solution.status}: {solution.message or solution.status.text}")
        where = [] if written is None else [("written", f"{written}/")]
        print_pairs([status, *family.summarise(problem, solution), *where])
    code = solution.status.exit_code
    if code and json:
        note(solution.message or solution.status.text)
    return code


def _refuse_inputs(out: Path, *inputs: Path | None) -> None:
    """UsageError when the run folder that is to be written is one that is read, or holds a file that is read."""
    from occontrol.core.errors import UsageError
    from occontrol.files.atomic import refuse_same
    from occontrol.files.run_folder import KNOWN

    for source in inputs:
        if source is not None and source.is_dir() and out.exists() and out.samefile(source):
            raise UsageError(f"{out} is an input, it would be lost\n  hint: name another output")
    refuse_same([out / name for name in KNOWN], inputs)


def _is_listed(run: Path, problem: BaseProblem, schedule: Schedule) -> bool:
    """Whether the schedule that result.json lists for the eye is that of the arrays."""
    import numpy as np

    from occontrol.api import read_schedule
    from occontrol.core.errors import ProblemError

    try:
        listed = read_schedule(run / "result.json", problem)
    except ProblemError:
        return False
    return bool(
        np.array_equal(listed.edges, schedule.edges) and np.allclose(listed.weights, schedule.weights, atol=1e-6)
    )
