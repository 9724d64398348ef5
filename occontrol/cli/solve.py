"""occontrol solve: a problem file in, a run folder with a certified schedule out."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from occontrol.cli.complete import complete_method
from occontrol.cli.output import note, print_json, print_pairs
from occontrol.core.kinds import PlainDict
from occontrol.core.problem import BaseProblem

if TYPE_CHECKING:
    from occontrol.cli.watch import Watched
    from occontrol.core.solution import Solution
    from occontrol.files.run_folder import Placed

ProblemFile = Annotated[Path, typer.Argument(metavar="FILE", help="Problem file.", show_default=False)]
JsonFlag = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on standard output.")
]

StrictFlag = Annotated[bool, typer.Option("--strict", help="Warnings are mistakes (exit 3).")]


def solve(
    file: ProblemFile,
    method: Annotated[
        str | None,
        typer.Option("--method", "-m", help="Method, instead of the file's.", autocompletion=complete_method),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Run folder [default: runs/FILE's name].")] = None,
    json: JsonFlag = False,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figures.")] = True,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the interrupted result of the folder.")] = False,
    strict: StrictFlag = False,
    log: Annotated[Path | None, typer.Option("--log", metavar="FILE", help="Progress as JSON lines.")] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", min=1, max=1024, help="Processes for many targets and for rules.")
    ] = 1,
    cluster: Annotated[str | None, typer.Option("--cluster", help="For the same: dask, or tls://HOST:PORT.")] = None,
) -> int:
    """Find a schedule, prove a bound, write both to a run folder with figures.

    Ctrl-C once keeps the best so far, twice aborts. What is interrupted never replaces a better result.
    """
    from occontrol.cli.watch import announce

    announce(f"solving {file}")
    from occontrol.api import choose_method, family_of, read_problem
    from occontrol.cli.warn import warn_of
    from occontrol.cli.watch import exit_code, watched
    from occontrol.core.errors import FileAccessError, InfeasibleError, SolveFailed
    from occontrol.core.solution import Status
    from occontrol.files.atomic import refuse_same
    from occontrol.files.run_folder import KNOWN, locked

    folder = default_folder(file) if out is None else out
    refuse_same([folder / name for name in KNOWN], [file])
    if log is not None:
        refuse_same([log], [file, *(folder / name for name in KNOWN)])
    with watched(log) as monitor, ExitStack() as held:
        problem = read_problem(file)
        warn_of(problem, file, strict)
        held.enter_context(locked(folder))
        if jobs > 1 or cluster is not None:
            from occontrol.studies.engines.places import places

            monitor.spread = held.enter_context(places(jobs, cluster))
        if resume:
            monitor.resume = _earlier(folder, problem)
        try:
            solution = run_method(problem, method, monitor)
        except (InfeasibleError, SolveFailed) as error:
            if json:
                name = choose_method(problem, method).name
                print_json(
                    {"family": problem.family, "status": _status_of(error), "message": str(error), "method": name}
                )
            raise
        usable = solution.status not in (Status.INFEASIBLE, Status.FAILED)
        if resume and not monitor.resumed:
            why = family_of(problem).begins_anew
            note(
                f"family {problem.family} begins anew: {why}"
                if why
                else "nothing to go on from was found, or this method begins anew: it was solved from the beginning"
            )
        content: PlainDict = solution.as_dict()
        trouble: FileAccessError | None = None
        written: Path | None = None
        if usable:
            # whoever interrupts wants to go on, the numbers are what must not be lost
            drawn = figures and not monitor.interrupted
            try:
                placed = write_with_figures(folder, problem, solution, drawn)
                content, written = placed.content, placed.folder
                if figures and not drawn:
                    note("interrupted: no figures were drawn")
                if placed.remark:
                    note(f"{placed.remark}; " + (f"this one is in {written}" if written else "this one is not written"))
            except FileAccessError as error:
                trouble = error  # the numbers are still worth printing
        if json:
            print_json(content)
        else:
            _print_summary(solution.problem, solution, written)
        if trouble is not None:
            raise trouble
        code = exit_code(monitor, solution.status.exit_code)
    if code and (json or not usable):
        note(solution.message or solution.status.text)
    return code


def default_folder(file: Path) -> Path:
    """Where the run of a problem file goes when nobody says.

    Parameters
    ----------
    file : the problem file
    """
    return Path("runs") / file.stem


def run_method(problem: BaseProblem, name: str | None, monitor: Watched) -> Solution:
    """Solve `problem` with the method called `name`, or its own, under the eyes of `monitor`.

    Parameters
    ----------
    problem : of any family
    name : method name, or None
    monitor : Watched
    """
    from occontrol.api import choose_method
    from occontrol.api import solve as call_solve

    method = choose_method(problem, name)
    monitor.target, limit = getattr(method, "relative_gap", None), getattr(method, "time_limit", None)
    monitor.absolute = bool(getattr(problem, "logarithmic", False))
    monitor.deadline = None if limit is None else monitor.seconds + limit
    return call_solve(problem, method, monitor)


def _earlier(folder: Path, problem: BaseProblem) -> Solution | None:
    """What a resumed solve goes on from: DIR/interrupted, else DIR, if it is a result of the same problem."""
    from occontrol.api import is_run_of, read_run
    from occontrol.core.errors import OccontrolError

    for candidate in (folder / "interrupted", folder):
        try:
            of_run, solution = read_run(candidate)
        except OccontrolError:
            continue
        if is_run_of(candidate, of_run, problem):
            return solution
    return None


def write_with_figures(folder: Path, problem: BaseProblem, solution: Solution, figures: bool = True) -> Placed:
    """Write the run folder with pictures and report; return where it went.

    Parameters
    ----------
    folder : the run folder
    problem : the problem as it was posed; the solution's own is written, to which edges may have been added
    solution : Solution
    figures : whether to draw

    A picture that cannot be drawn is announced; it never costs the user the result.
    """
    from occontrol.api import document, write_report
    from occontrol.files.run_folder import place_run

    def draw(stage: Path, content: dict) -> None:
        try:
            write_report(stage, solution.problem, solution, content)
        except (ValueError, ArithmeticError, LookupError, TypeError, AttributeError, RuntimeError) as error:
            note(f"the figures could not be drawn: {type(error).__name__}: {error}")

    return place_run(folder, document(solution.problem), solution, draw if figures else None, document(problem))


def _status_of(error: Exception) -> str:
    from occontrol.core.errors import InfeasibleError

    return "infeasible" if isinstance(error, InfeasibleError) else "failed"


def _print_summary(problem: BaseProblem, solution: Solution, folder: Path | None) -> None:
    from occontrol.api import family_of

    pairs = [("status", f"{solution.status}: {solution.message or solution.status.text}")]
    pairs += family_of(problem).summarise(problem, solution)
    if folder is not None:
        pairs.append(("written", f"{folder}/"))
    print_pairs(pairs)
