"""occontrol sensitivity: what prices, noises, windows and places are worth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.export import RunFolder
from occontrol.cli.output import number, percent, print_json, print_pairs, print_table
from occontrol.cli.solve import JsonFlag
from occontrol.core.kinds import PlainDict
from occontrol.core.printed import rounded_down


def sensitivity(
    run: RunFolder,
    certify: Annotated[
        float | None,
        typer.Option("--certify", metavar="SHARE", min=1e-4, max=0.9, help="Solve again with so much less and more."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder [default: RUN's name-sensitivity].")] = None,
    json: JsonFlag = False,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figure.")] = True,
) -> int:
    """Say by how much the best possible cost would change with a price, a noise, a window or one more place."""
    from occontrol.cli.watch import announce, exit_code, watched

    announce(f"differentiating {run}")
    from occontrol.api import family_of, read_run
    from occontrol.api import sensitivity as differentiate
    from occontrol.core.versions import stamped
    from occontrol.files.atomic import write_text
    from occontrol.files.figures import save
    from occontrol.files.plain_json import to_json
    from occontrol.files.run_folder import check_writable
    from occontrol.files.run_record import refuse_run_files

    folder = run.with_name(run.name + "-sensitivity") if out is None else out
    refuse_run_files(run, folder / "sensitivity.json")
    problem, solution = read_run(run)
    check_writable(folder)
    with watched() as monitor:
        found = differentiate(solution.problem or problem, solution, monitor, certify)
    content = stamped(found.as_dict())
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "sensitivity.json", to_json(content))
    if figures:
        save(family_of(problem).sensitivity_figure(found), folder / "sensitivity.png")
    if json:
        print_json(content)
    else:
        _print(content)
        print(f"written  {folder}/")
    return exit_code(monitor, 0)


def _print(content: PlainDict) -> None:
    gap = (content["cost"] - content["lower_bound"]) / abs(content["cost"]) if content["cost"] else 0.0
    print_pairs([("optimum", f"{number(content['cost'])} with shares of time, proven to {percent(gap)}")])
    rows = []
    for name, s in content["sensors"].items():
        entry = s.get("entry_price")
        enters = "-" if entry is None else f"price {number(entry, 4)}" if entry else "at once"
        rows.append((name, percent(s["share"]), number(s["price"], 6), number(0.01 * s["noise"], 4), enters))
    headers = ("sensor", "in use", "per unit of price", "per 1 % more noise", "is used from")
    print_table(headers, rows, right=range(1, 5))
    worth = [w for w in content["windows"] if w["longer"] or w["shorter"]]
    if worth:
        rows = [
            (w["sensor"], w["end"], number(w["t"], 8), number(w["longer"], 4), _shorter(w["shorter"])) for w in worth
        ]
        print_table(("window of", "end", "t", "per unit longer", "per unit shorter"), rows, right=range(2, 5))
    if other := len(content["windows"]) - len(worth):
        print_pairs([("windows", f"{other} further end{'s' * (other > 1)} could move without changing the optimum")])
    more = content["select"].get("one_more")
    if more is not None:
        print_pairs([("one more place", f"no schedule at these edges would cost less than {rounded_down(more, 8)}")])
    for name, changes in content.get("changes", {}).items():
        print_pairs([(f"{name}: {what}", f"{low:+.6g} to {high:+.6g}") for what, (low, high) in changes.items()])


def _shorter(value: float | None) -> str:
    return "no schedule left" if value is None or value == float("inf") else number(value, 4)
