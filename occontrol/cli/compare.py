"""occontrol compare: several methods on one problem, one table, one figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from occontrol.cli.output import note, note_linearised, number, percent, print_json, print_table, with_error
from occontrol.cli.solve import JsonFlag, ProblemFile, run_method
from occontrol.core.kinds import PlainDict
from occontrol.core.printed import rounded_down
from occontrol.core.problem import BaseProblem

if TYPE_CHECKING:
    from occontrol.core.solution import Solution

ERROR = "_standard_error"
GROUPS = ("top", "continuous")  # numbers that belong together

SAME = 1e-9  # by so much rounding may put a cost below a bound, relative


def compare(
    file: ProblemFile,
    methods: Annotated[
        str | None, typer.Option("--methods", metavar="A,B,C", help="Methods [default: the family's choice].")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder [default: runs/FILE's name-compare].")] = None,
    json: JsonFlag = False,
    families: Annotated[bool, typer.Option("--families", help="One plant in several families instead.")] = False,
    step: Annotated[float | None, typer.Option("--step", help="With --families: time between readings.")] = None,
    level: Annotated[float | None, typer.Option("--level", help="With --families: energy of unknown inputs.")] = None,
    slots: Annotated[int | None, typer.Option("--slots", help="With --families: slots of family robust.")] = None,
) -> int:
    """Solve one problem with several methods and set them side by side."""
    from occontrol.cli.watch import announce

    if families:
        from occontrol.cli.compare_families import compare_families

        return compare_families(file, out, json, step, level, slots)

    announce(f"comparing methods on {file}")
    from occontrol.api import choose_method, family_of, read_problem
    from occontrol.cli.watch import exit_code, watched
    from occontrol.core.errors import SolveFailed, UsageError
    from occontrol.files.atomic import refuse_same
    from occontrol.files.run_folder import check_writable

    folder = out or Path("runs") / f"{file.stem}-compare"
    refuse_same([folder / name for name in ("compare.json", "compare.png", "compare.html")], [file])
    problem = read_problem(file)
    family = family_of(problem)
    check_writable(folder)
    usual = family.compare_names(problem)
    names = usual if methods is None else [m.strip() for m in methods.split(",") if m.strip()]
    if not names:
        example = ",".join(usual[:3])
        raise UsageError(f"--methods names no method\n  hint: for example --methods {example}")
    for name in names:
        choose_method(problem, name)  # an unknown name is found before any work
    solutions: dict[str, Solution] = {}
    failed: dict[str, str] = {}
    with watched() as monitor:
        for name in names:
            monitor.stage = name
            try:
                solutions[name] = run_method(problem, name, monitor)
            except SolveFailed as error:
                failed[name] = str(error)
            if monitor.interrupted:
                break
        rows = comparison(solutions)
        if json:
            print_json({"problem": problem.name, "family": problem.family, "methods": rows, "failed": failed})
        else:
            _print(rows, family.columns)
            note_linearised(s.result for s in solutions.values())
        for name, text in failed.items():
            note(f"{name}: {text}")
        if solutions:
            _write(folder, problem, solutions, rows, quiet=json)
        if not any(s.status.exit_code in (0, 5) for s in solutions.values()):
            for text in dict.fromkeys(s.message or s.status.text for s in solutions.values()):
                note(text)
    return exit_code(monitor, _outcome(solutions))


def _outcome(solutions: dict[str, Solution]) -> int:
    """0 as soon as one method has something usable; otherwise why the first one has not."""
    codes = [s.status.exit_code for s in solutions.values()]
    if any(code in (0, 5) for code in codes):
        return 0
    return codes[0] if codes else 6


def comparison(solutions: dict[str, Solution]) -> list[PlainDict]:
    """One record per method; every cost is measured against the best bound that any of them proved.

    Parameters
    ----------
    solutions : Solution by method name
    """
    tops = {name: getattr(s.numbers, "top", None) or s.certificate for name, s in solutions.items()}
    best = max((top.lower_bound for top in tops.values() if top is not None), default=None)
    rows = []
    for name, solution in solutions.items():
        numbers = solution.numbers
        top = tops[name]
        cost = getattr(numbers, "cost", None) if top is None else top.cost
        record: PlainDict = {"method": name, "status": str(solution.status), "cost": cost}
        record["lower_bound"] = getattr(numbers, "lower_bound", None) if top is None else top.lower_bound
        absolute = bool(getattr(top, "absolute", False))  # a logarithm: differences are what compares
        if best is not None and isinstance(cost, int | float) and (cost or absolute):
            gap = cost - best if absolute else (cost - best) / abs(cost)
            # shares of readings may cost less than any schedule of whole ones: there is nothing to compare
            split = solution.schedule is not None and not solution.schedule.is_integer
            record["gap_to_best_bound"] = None if split and gap < -SAME else gap
            record |= {"gap": "difference"} if absolute else {}
        # whatever else the family reports as a number, or as several that belong together
        for key, value in solution.result.items():
            if key in GROUPS and isinstance(value, dict):
                record[key] = value
        for key, value in solution.result.items():
            if isinstance(value, int | float) and key not in record and key != "relative_gap":
                record[key] = value
        rows.append({**record, "iterations": solution.iterations, "seconds": solution.seconds})
    return rows


def _print(rows: list[PlainDict], named: Sequence[str] = ()) -> None:
    known = {
        "method",
        "status",
        "cost",
        "lower_bound",
        "gap_to_best_bound",
        "switches",
        "iterations",
        "seconds",
        "continuous",
        "top",
        "gap",
    }
    bounded = any(isinstance(r.get("lower_bound"), int | float) for r in rows)
    # families without a cost bound are compared by the numbers that they report, some name theirs
    reported = [k for k in (rows[0] if rows else {}) if k not in known and all(k in r for r in rows)]
    reported = [k for k in reported if k.removesuffix(ERROR) not in reported or not k.endswith(ERROR)]
    others = [k for k in reported if k in named] if named else [] if bounded else reported[:6]
    headers = ["method", "status"]
    columns = [lambda r: r["method"], lambda r: r["status"]]
    if any(isinstance(r.get("cost"), int | float) for r in rows):
        headers.append("cost")
        columns.append(lambda r: number(r.get("cost")))
    if bounded:
        headers += ["lower bound", "above best bound", "switches"]
        columns += [
            lambda r: rounded_down(r.get("lower_bound"), 8),
            lambda r: (number if r.get("gap") else percent)(r.get("gap_to_best_bound")),
            lambda r: number(r.get("switches")),
        ]
    for key in others:
        headers.append(key.replace("_", " "))
        columns.append(lambda r, key=key: with_error(r.get(key), r.get(key + ERROR)))
    headers.append("seconds")
    columns.append(lambda r: number(r["seconds"], 3))
    print_table(headers, [[column(r) for column in columns] for r in rows], right=range(2, len(headers)))


def _write(
    folder: Path, problem: BaseProblem, solutions: dict[str, Solution], rows: list[PlainDict], quiet: bool
) -> None:
    from occontrol.api import write_comparison
    from occontrol.core.errors import FileAccessError
    from occontrol.files.atomic import write_text
    from occontrol.files.plain_json import to_json

    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "compare.json", to_json(rows))
        # where no method has anything usable there is nothing to draw
        usable = any(s.status.exit_code in (0, 5) for s in solutions.values())
        if usable:
            write_comparison(folder, problem, solutions, rows)
    except OSError as error:
        raise FileAccessError(f"cannot write to {folder}: {error.strerror or error}") from error
    if not quiet:
        print(f"written  {folder}/")
