"""occontrol simulate: a true trajectory and the measurements that a schedule would bring."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.complete import complete_run
from occontrol.cli.output import note
from occontrol.cli.solve import ProblemFile, default_folder, run_method


def simulate(
    file: ProblemFile,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="CSV", help="Measurement file to write.", show_default=False)
    ],
    run: Annotated[
        Path | None,
        typer.Option(
            "--run",
            help="Run whose schedule is followed [default: runs/FILE's name, or solve].",
            autocompletion=complete_run,
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the random generator.")] = 0,
) -> int:
    """Simulate the plant and the scheduled sensors; the truth goes beside the measurements."""
    from occontrol.api import is_run_of, read_problem, read_run
    from occontrol.api import simulate as call_simulate
    from occontrol.cli.watch import watched
    from occontrol.core.calendar import calendar_of
    from occontrol.core.errors import FileAccessError, ProblemError
    from occontrol.core.state_labels import state_names
    from occontrol.files.atomic import refuse_same
    from occontrol.files.run_folder import RESULT, check_writable
    from occontrol.files.run_record import refuse_run_files
    from occontrol.files.tables import write_measurements, write_truth

    beside, folder = out.with_name(out.stem + ".truth.csv"), run or default_folder(file)
    refuse_same([out, beside], [file])
    refuse_run_files(folder, out)
    problem, solution = read_problem(file), None
    if not out.parent.is_dir():
        raise FileAccessError(f"cannot write {out}: there is no folder {out.parent}")
    check_writable(out.parent)
    if run is not None or (folder / RESULT).exists():
        of_run, solution = read_run(folder)
        if is_run_of(folder, of_run, problem):
            problem = of_run  # on whose edges the schedule stands
        else:
            if run is not None:
                raise ProblemError(f"{folder} is the run of another problem than {file}", "solve the file again")
            note(f"{folder} is the run of another version of {file}; solving again")
            solution = None
    if solution is None:
        with watched() as monitor:
            solution = run_method(problem, None, monitor)
        if monitor.interrupted:
            raise KeyboardInterrupt
    measurements, truth = call_simulate(problem, solution, seed)
    write_measurements(out, measurements, calendar_of(problem))
    write_truth(beside, truth, state_names(problem), calendar_of(problem))
    note(f"{len(measurements)} measurements in {out}, the truth in {beside}")
    return 0
