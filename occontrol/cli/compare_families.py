"""occontrol compare --families: one plant in every family that has words for it, judged by one yardstick."""

from __future__ import annotations

from pathlib import Path

from occontrol.cli.output import note, number, percent, print_json, print_table


def compare_families(
    file: Path, out: Path | None, json: bool, step: float | None, level: float | None, slots: int | None
) -> int:
    """Convert, solve, judge every schedule on the same plant, print and write one table.

    Parameters
    ----------
    file : problem file
    out : folder, or None for the usual one
    json : whether to print JSON
    step, level, slots : what conversions need; None: usual values
    """
    from occontrol.api import read_problem
    from occontrol.cli.watch import announce, exit_code, watched
    from occontrol.core.conversion import Asked
    from occontrol.core.versions import stamped
    from occontrol.files.atomic import refuse_same, write_text
    from occontrol.files.plain_json import to_json
    from occontrol.files.run_folder import check_writable
    from occontrol.studies.one_plant import side_by_side

    announce(f"comparing families on {file}")
    folder = out or Path("runs") / f"{file.stem}-families"
    refuse_same([folder / "families.json"], [file])
    problem = read_problem(file)
    check_writable(folder)
    with watched() as monitor:
        rows = side_by_side(problem, Asked(step, level, slots), monitor)
    content = {"problem": problem.name, "family": problem.family, "families": [row.as_dict() for row in rows]}
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "families.json", to_json(stamped(content)))
    if json:
        print_json(stamped(content))
    else:
        headers = ("family", "method", "error at the end", "cost", "above the bound", "worst case", "switches")
        cells = []
        for row in rows:
            gap = (row.cost - row.lower_bound) / abs(row.cost) if row.cost and row.lower_bound is not None else None
            worst = number(row.worst_case, 6)
            error = number(row.prediction_error)
            cells.append((row.family, row.method, error, number(row.cost), percent(gap), worst, number(row.switches)))
        print_table(headers, cells, right=range(2, 7))
        print(f"written  {folder}/")
    for row in rows:
        for remark in row.remarks:
            note(f"{row.family}: {remark}")
    return exit_code(monitor, 0 if any(row.cost is not None for row in rows) else 6)
