"""occontrol montecarlo: the loop closed on simulated truth, policies side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.output import number, percent, print_json, print_pairs, print_table
from occontrol.cli.solve import JsonFlag, ProblemFile, run_method
from occontrol.core.kinds import PlainDict


def montecarlo(
    file: ProblemFile,
    policies: Annotated[str | None, typer.Option("--policies", metavar="A,B", help="Policies [default: all].")] = None,
    runs: Annotated[int, typer.Option("--runs", min=2, max=1_000_000, help="Runs of each, at most.")] = 200,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same runs.")] = 1,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, max=1024, help="Processes.")] = 1,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder [default: runs/FILE's name-montecarlo].")
    ] = None,
    json: JsonFlag = False,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figure.")] = True,
) -> int:
    """Plan, then fly plan, new plans and simple rules on simulated runs, and say which pays."""
    from occontrol.cli.watch import announce, exit_code, watched

    announce(f"simulating {file}")
    from occontrol.api import read_problem, require
    from occontrol.core.errors import UsageError
    from occontrol.core.versions import stamped
    from occontrol.families.family import Ability
    from occontrol.files.atomic import refuse_same, write_text
    from occontrol.files.page.records import write_records_page
    from occontrol.files.plain_json import to_json
    from occontrol.files.run_folder import check_writable
    from occontrol.studies.batches import workers

    folder = out or Path("runs") / f"{file.stem}-montecarlo"
    refuse_same([folder / f"montecarlo.{end}" for end in ("json", "png", "html")], [file])
    names = None if policies is None else [name.strip() for name in policies.split(",") if name.strip()]
    if names == []:
        raise UsageError("--policies names no policy\n  hint: for example --policies nominal,replanned")
    problem = read_problem(file)
    family = require(problem, Ability.CLOSED_LOOP)
    check_writable(folder)
    with watched() as monitor:
        solution = run_method(problem, None, monitor)
        monitor.stage = "simulation"
        with workers(solution.problem, solution, jobs) as work:
            found = family.monte_carlo(solution.problem, solution, names, runs, seed, monitor, work)
    content = stamped(found.as_dict())
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "montecarlo.json", to_json(content))
    if figures:
        from occontrol.files.figures.policies import draw

        rows = [{"policy": name, **row} for name, row in content["policies"].items()]
        write_records_page(
            folder / "montecarlo.html", str(problem.name), "policies in closed loop", rows,
            {"montecarlo": draw(found)}, sentences=[content["verdict"]],
        )  # fmt: skip
    if json:
        print_json(content)
    else:
        _print(content)
        print(f"written  {folder}/")
    return exit_code(monitor, 0)


def _print(content: PlainDict) -> None:
    headers = ("policy", "mean error", "+-", "median", "to nominal", "+-", "diverged", "NEES", "NIS", "lost", "ms")
    rows = []
    for name, row in content["policies"].items():
        cells = [number(row["mean"], 5), number(row["standard_error"], 2), number(row["median"], 5)]
        cells += [number(row.get("difference"), 3), number(row.get("difference_error"), 2), percent(row["diverged"])]
        cells += [number(row[key], 3) for key in ("nees", "nis", "lost", "milliseconds")]
        rows.append((name, *cells))
    print_table(headers, rows, right=range(1, len(headers)))
    print_pairs([("verdict", content["verdict"].replace("; ", ";\n").replace(". ", ".\n", 1))])
