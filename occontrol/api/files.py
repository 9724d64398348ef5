"""The calls that read and write files of any family: what the toolkit in files needs to know of it is found here."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from occontrol.api.problems import family_of
from occontrol.core.errors import Mistake, ProblemError, UsageError
from occontrol.core.kinds import PlainDict
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.core.versions import stamped
from occontrol.families import find_family, names

if TYPE_CHECKING:
    from occontrol.core.measurement import Measurement
    from occontrol.core.schedule import Schedule


def read_problem(path: str | Path) -> BaseProblem:
    """The problem in a file, for example a SchedulingProblem.

    Parameters
    ----------
    path : a .yaml, .yml or .json file; tables in .npz files are looked for beside and below it

    Raises ProblemError with every mistake as file:line:column, FileAccessError when the file cannot be read.
    """
    from occontrol.files.problem_file import load_document

    loaded = load_document(path, names(), lambda name: find_family(name).schema())
    family = find_family(loaded.family)

    def check(problem: BaseProblem) -> list[Mistake]:
        return [] if problem.method is None else family.mistakes(problem, problem.method)

    return loaded.build(check)


def placed(path: str | Path, mistakes: Sequence[Mistake]) -> ProblemError:
    """Mistakes with paths in the problem document, as a ProblemError that names their lines in its file.

    Parameters
    ----------
    path : the problem file
    mistakes : of the problem that was read from it
    """
    from occontrol.files.problem_file import load_document

    return load_document(path, names(), lambda name: find_family(name).schema()).text.placed(list(mistakes))


def document(problem: BaseProblem) -> PlainDict:
    """The problem as a JSON-able dict with all tables embedded; reading it back gives the identical problem."""
    return stamped(family_of(problem).schema().document(problem))


def json_schema(family: str | None = None) -> PlainDict:
    """The JSON Schema of the problem files of a family, with its methods and their options; None is any family."""
    from occontrol.files.problem_file import documents_of
    from occontrol.files.schema.json_schema import json_schema as schema_of
    from occontrol.files.schema.json_schema import union_schema

    if family is None:
        return union_schema({name: json_schema(name) for name in names()})
    found = find_family(family)
    methods = {**found.methods, **found.further_methods}
    return schema_of(family, documents_of(found.schema()), methods)


def write_run(
    folder: str | Path, problem: BaseProblem, solution: Solution, extras: Callable[[Path, dict], None] | None = None
) -> PlainDict:
    """Write a run folder and return the content of its result.json.

    Parameters
    ----------
    folder : the run folder, created if missing; an earlier result in it is replaced only when the new one is complete
    problem : the problem that was solved
    solution : Solution
    extras : called with the folder under construction and the content of result.json, to add pictures and the like

    An interrupted result that is worse than the one in the folder goes to DIR/interrupted instead.
    Raises FileAccessError when the folder cannot be written, or is in use by another process.
    """
    from occontrol.files import run_folder

    return run_folder.write_run(folder, document(problem), solution, extras)


def read_run(folder: str | Path) -> tuple[BaseProblem, Solution]:
    """The problem and the Solution of the run folder `folder`, identical to what was written.

    Raises ProblemError naming the file that is missing, damaged, or does not belong to the others; FileAccessError when
    there is no such folder or it cannot be read.
    """
    from occontrol.files import run_folder

    problem, solution = run_folder.read_run(folder, read_problem)
    try:
        numbers = find_family(problem.family).result_type.from_dict(solution.result)
    except (TypeError, ValueError, AttributeError) as error:
        place = str(Path(folder) / run_folder.RESULT)
        raise ProblemError(Mistake((), f"the result does not fit the problem: {error}", place=place)) from None
    return problem, dataclasses.replace(solution, numbers=numbers)


def is_run_of(folder: str | Path, solved: BaseProblem, problem: BaseProblem) -> bool:
    """Whether a run folder holds a result of `problem`; how it is named and solved does not matter.

    Parameters
    ----------
    folder : the run folder
    solved : its problem, from `read_run`, to which the solver may have added edges
    problem : the problem as it is posed
    """
    from occontrol.files.run_choice import recorded_result, same_problem

    digest = (recorded_result(Path(folder)) or {}).get("digest")
    return solved.family == problem.family and same_problem(document(problem), document(solved), digest)


def read_schedule(path: str | Path, problem: BaseProblem) -> Schedule:
    """A schedule that anyone wrote, on the grid of `problem` refined where the schedule switches.

    Parameters
    ----------
    path : CSV with the columns start, end, sensors (names joined by ';') and, where sensors share their time, weights;
        JSON, a list of {start, end, sensors[, weights]} or a dict that has it under 'schedule'; or a run folder
    problem : a problem whose sensors are chosen on a grid of times or epochs; for many targets the columns are start,
        end, resource, target

    Raises ProblemError with every mistake as file:line, FileAccessError when the file cannot be read.
    """
    from occontrol.files import looks, schedule_file

    if looks.is_of_looks(problem):
        return looks.read_looks(path, problem, read_run)  # type: ignore[arg-type]
    return schedule_file.read_schedule(path, problem, read_run)


def read_measurements(path: str | Path, problem: BaseProblem | None = None) -> list[Measurement]:
    """The samples of a measurement file, in the order of time.

    Parameters
    ----------
    path : CSV with the columns t, sensor, z1, z2, ..; empty fields at the end of a line where a sensor has fewer values
    problem : when given, names and numbers of values are compared with its sensors, and t may be a date where its
        horizon has a date

    An empty or NaN value is a missing one: it is NaN in `values`.
    Raises ProblemError with every mistake as file:line, FileAccessError when the file cannot be read.
    """
    from occontrol.files import measurement_file

    return measurement_file.read_measurements(path, problem)


def export_run(run: str | Path, to: str, out: str | Path | None = None, **options: Any) -> list[Path]:
    """Write a run for another tool; the run folder alone is enough.

    Parameters
    ----------
    run : the run folder
    to : csv, json, npz, mat, c or matlab; flight or fmu for code that runs the schedule and its filter
    out : file or folder to write, instead of the format's own place inside the run folder
    options : of flight code and FMUs, by name: precision ("double" or "single"), gains_only, no_plan, prefix; of FMUs
        also fmi (2 or 3) and build

    Returns the files written. Raises UsageError for an unknown format, for options that the format does not take and
    for families without a filter for a target, ProblemError for a damaged run folder, FileAccessError when the files
    cannot be written.
    """
    from occontrol.files.export import TARGETS, check_format, write_export

    check_format(to)
    if to in TARGETS:
        from occontrol.api.target import export_target

        return export_target(run, to, out, **options)
    if options:
        words = ", ".join(options)
        raise UsageError(f"--to {to} has no {words}\n  hint: that is for --to {' or '.join(TARGETS)}")
    problem, solution = read_run(run)
    tables = family_of(problem).filter_tables(problem, solution)
    return write_export(problem, solution, tables, to, Path(run), out)
