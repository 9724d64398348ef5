"""occontrol list, init, check: what there is, a file to start from, and what a file says."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.output import print_pairs, print_table
from occontrol.cli.solve import ProblemFile, StrictFlag

FamilyName = Annotated[
    str, typer.Argument(metavar="FAMILY", help="A family that `occontrol list` names.", show_default=False)
]


def list_all() -> int:
    """Show the families, their methods, and example problems."""
    from occontrol.families import find_family, names, title

    rows = [(name, title(name), ", ".join(find_family(name).methods)) for name in names()]
    print_table(("family", "what it does", "methods, the default first"), rows)
    examples = _examples()
    if examples:
        print_table(("example problem", "family", "name"), examples)
    print("occontrol init FAMILY writes a commented problem file to start from")
    return 0


def _examples() -> list[tuple[str, str, str]]:
    """Problem files below ./problems, or beside a checkout of the package."""
    folders = [Path("problems"), Path(__file__).resolve().parents[2] / "problems"]
    folder = next((f for f in folders if any(f.glob("*.yaml"))), None)
    if folder is None:
        return []
    found = []
    for path in sorted(folder.glob("*.yaml")):
        head = path.read_text(encoding="utf-8", errors="replace")
        words = {key: re.search(rf"^{key}:\s*(.+?)\s*(?:#.*)?$", head, re.MULTILINE) for key in ("family", "name")}
        family, name = (words[key].group(1).strip("'\"") if words[key] else "" for key in ("family", "name"))  # type: ignore[union-attr]
        try:
            shown = path.resolve().relative_to(Path.cwd())
        except ValueError:
            shown = path
        found.append((str(shown), family, name))
    return found


def init(
    family: FamilyName,
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="[default: FAMILY.yaml]", show_default=False)
    ] = None,
) -> int:
    """Write a commented problem file that solves as it stands; never over an existing file."""
    from occontrol.core.errors import FileAccessError
    from occontrol.families import find_family, template
    from occontrol.files.atomic import write_text

    source = template(find_family(family).name)
    target = file or Path(f"{family}.yaml")
    if os.path.lexists(target):
        raise FileAccessError(f"{target} exists already, it was left as it is\n  hint: name another file")
    write_text(target, source.read_text(encoding="utf-8"))
    print(f"{target} written; next: occontrol solve {target}")
    return 0


def check(file: ProblemFile, strict: StrictFlag = False) -> int:
    """Validate a problem file and show what it says, without solving it."""
    from occontrol.api import family_of, read_problem
    from occontrol.cli.warn import warn_of

    problem = read_problem(file)
    family = family_of(problem)
    print_pairs([("problem", f"{problem.name} (family {family.name})"), *family.describe(problem)])
    warn_of(problem, file, strict)
    family.require_feasible(problem)
    return 0
