"""The pages of runs: what the toolkit in files needs to know of a family is found here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from occontrol.api.files import document, read_run
from occontrol.api.problems import compare_figure, family_of, figures_of
from occontrol.core.kinds import PlainMapping
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.core.trajectory import Trajectory

if TYPE_CHECKING:
    from occontrol.core.measurement import Estimate


def write_report(
    folder: Path,
    problem: BaseProblem,
    solution: Solution,
    content: PlainMapping,
    static: bool = False,
    origin: PlainMapping | None = None,
) -> None:
    """Every figure of a solution as a picture below `folder`, and report.html.

    Parameters
    ----------
    folder : where to write
    problem, solution : what the page is about
    content : of result.json
    static : pictures in the place of panels
    origin : of provenance.json; that of this process if left out
    """
    from occontrol.files.page.document import write_page
    from occontrol.files.page.pictures import pictures_of
    from occontrol.files.page.run_page import RunParts, run_page
    from occontrol.files.provenance import provenance
    from occontrol.files.run_record import FIGURES, REPORT

    schedule, family = solution.schedule, family_of(problem)
    parts = RunParts(
        name=str(problem.name),
        content=content,
        document=document(problem),
        rows=family.summarise(problem, solution),
        schedule=content.get("schedule") if schedule is None else schedule.segments(),
        groups=family.groups(problem, solution),
        tables=family.tables(problem, solution),
        pictures=pictures_of(figures_of(problem, solution), folder / FIGURES),
        origin=provenance() if origin is None else origin,
    )
    write_page(folder / REPORT, run_page(parts), static)


def rewrite_report(folder: str | Path, static: bool = False) -> Path:
    """Draw the pictures and the page of a run again; its numbers stay as they are.

    Parameters
    ----------
    folder : the run folder; everything in it is switched at once
    static : pictures in the place of panels

    Returns the path of the page. Raises ProblemError for a damaged run folder, FileAccessError when it cannot be read
    or written.
    """
    from occontrol.files.run_rewrite import rewritten
    from occontrol.files.run_show import shown_run

    problem, solution = read_run(folder)
    content, origin = shown_run(folder)

    def draw(stage: Path, result: Mapping) -> None:
        write_report(stage, problem, solution, result, static, origin or {})

    return rewritten(folder, content, draw)


def write_comparison(folder: Path, problem: BaseProblem, solutions: Mapping[str, Solution], rows: list) -> list[Path]:
    """compare.png, where the family has such a picture, and compare.html.

    Parameters
    ----------
    folder : where to write, which must exist
    problem : what was solved
    solutions : Solution by method name
    rows : one record of numbers for each of them

    Returns the files written. Raises FileAccessError.
    """
    from occontrol.files.page.records import write_records_page
    from occontrol.files.page.usual import STEP, TIME, compared_groups

    family = family_of(problem)
    figure = compare_figure(problem, solutions)
    whole = isinstance(getattr(problem, "steps", None), int)
    groups = compared_groups(solutions, family.compared_curve, STEP if whole else TIME)
    said = [f"{name}: {s.status}. {s.message or s.status.text}" for name, s in solutions.items()]
    figures = {} if figure is None else {"compare": figure}
    title, path = str(problem.name), folder / "compare.html"
    return write_records_page(path, title, "methods compared", rows, figures, sentences=said, groups=groups)


def write_estimate_page(
    path: Path,
    problem: BaseProblem,
    solution: Solution,
    estimate: Estimate,
    truth: Trajectory | None = None,
    notes: Sequence[str] = (),
) -> list[Path]:
    """The pictures of a filter run as STEM.NAME.png, and the page that holds them; the files written.

    Parameters
    ----------
    path : of the page
    problem, solution : that the run belongs to
    estimate : of the filter
    truth : true states at the same times, where they are known
    notes : sentences to stand on the page

    Raises FileAccessError.
    """
    from occontrol.files.page.content import Page
    from occontrol.files.page.document import write_page
    from occontrol.files.page.estimate import estimate_facts, estimate_groups
    from occontrol.files.page.pictures import pictures_of

    family = family_of(problem)
    figures = family.estimate_figures(problem, solution, estimate, truth)
    page = Page(
        title=str(problem.name),
        kind=f"filter run, {len(estimate.times)} estimates",
        facts=estimate_facts(estimate, notes),
        groups=estimate_groups(problem, solution, estimate, truth, *family.estimate_band),
        pictures=pictures_of(figures, path.parent, prefix=f"{path.stem}."),
    )
    return [*(path.with_name(f"{path.stem}.{name}.png") for name in figures), write_page(path, page)]
