"""occontrol certify: cost, lower bound and gap of anybody's schedule."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.output import note, print_json, print_pairs
from occontrol.cli.solve import JsonFlag


def certify(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Problem file, or a run folder.", show_default=False)],
    schedule: Annotated[
        Path | None,
        typer.Argument(
            metavar="SCHEDULE", help="Schedule, csv or json; a run folder brings its own.", show_default=False
        ),
    ] = None,
    json: JsonFlag = False,
) -> int:
    """Recompute cost, lower bound and gap of a schedule from the problem alone."""
    from occontrol.core.errors import UsageError
    from occontrol.families import family_module
    from occontrol.files.data_files import read_schedule
    from occontrol.files.problem_file import read_problem
    from occontrol.files.run_folder import read_run
    from occontrol.library import certify as library_certify

    claims = None
    if file.is_dir():
        problem, recorded = read_run(file)
        given = recorded.schedule if schedule is None else read_schedule(schedule, problem)
        if schedule is None and recorded.certificate is not None and problem.family == "athans":
            from occontrol.solvers.certificate import Claims

            claims = Claims(recorded.certificate.cost, recorded.certificate.lower_bound)
        elif schedule is None and hasattr(family_module(problem.family), "claims_of"):
            claims = family_module(problem.family).claims_of(problem, recorded)
    else:
        if schedule is None:
            raise UsageError(
                "certify needs a schedule\n  hint: occontrol certify FILE SCHEDULE, or occontrol certify RUN"
            )
        problem = read_problem(file)
        given = read_schedule(schedule, problem)
    if given is None:
        raise UsageError(f"the run of family {problem.family} holds no schedule that could be certified")
    solution = library_certify(problem, given, claims)
    if json:
        print_json(solution.as_dict())
    else:
        status = ("status", f"{solution.status}: {solution.message or solution.status.text}")
        print_pairs([status, *family_module(problem.family).summarise(problem, solution)])
    code = solution.status.exit_code
    if code and json:
        note(solution.message or solution.status.text)
    return code
