"""occontrol list, init, schema, check: what there is, a file to start from, its keys, and what a file says."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from occontrol.cli.complete import complete_example, complete_family
from occontrol.cli.output import print_pairs, print_table
from occontrol.cli.solve import ProblemFile, StrictFlag

FamilyName = Annotated[
    str | None,
    typer.Argument(
        metavar="[FAMILY]",
        help="A family that `occontrol list` names.",
        show_default=False,
        autocompletion=complete_family,
    ),
]


def list_all() -> int:
    """Show the families, their methods, and example problems."""
    from occontrol.families import find_family, names, title
    from occontrol.files.examples import examples, heading

    rows = [(name, title(name), ", ".join(find_family(name).methods)) for name in names()]
    print_table(("family", "what it does", "methods, the default first"), rows)
    shipped = [(_near(path), *heading(path)) for path in examples().values()]
    if shipped:
        print_table(("example problem", "family", "name"), shipped)
        print("occontrol init --example NAME copies one of them")
    print("occontrol init FAMILY writes a commented problem file to start from")
    return 0


def _near(path: Path) -> str:
    """A path from here, where it lies below."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def init(
    family: FamilyName = None,
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="[default: FAMILY.yaml]", show_default=False)
    ] = None,
    example: Annotated[
        str | None,
        typer.Option("--example", metavar="NAME", help="Copy a shipped problem.", autocompletion=complete_example),
    ] = None,
    source: Annotated[
        Path | None, typer.Option("--from", metavar="MODEL.MAT", help="Start from the state space in a MATLAB file.")
    ] = None,
) -> int:
    """Write a problem file that solves as it stands; never over an existing file.

    It is a commented template, a shipped problem, or made of a state space. With --example or --from, name FILE alone.
    """
    from occontrol.core.errors import UsageError
    from occontrol.families import find_family, shipped_schema, template
    from occontrol.files import examples

    if example is None and source is None:
        if family is None:
            raise UsageError("init needs a family\n  hint: occontrol init athans, or init --example NAME")
        schema = shipped_schema(find_family(family).name)
        target = file or Path(f"{family}.yaml")
        text = template(family).read_text(encoding="utf-8")
        examples.write_new(target, examples.with_modeline(text, schema))
        written = [target]
    elif file is not None or (example is not None and source is not None):
        raise UsageError("init takes one of FAMILY, --example and --from\n  hint: occontrol init --example NAME [FILE]")
    elif example is not None:
        target = Path(family or f"{example.removesuffix('.yaml')}.yaml")
        shipped = examples.examples().get(example.removesuffix(".yaml"))
        schema = shipped_schema(examples.heading(shipped)[0] if shipped else None)
        written = examples.copy_example(example, target, schema)
    else:
        from occontrol.api.model import problem_text

        assert source is not None
        target = Path(family or f"{source.stem}.yaml")
        examples.write_new(target, examples.with_modeline(problem_text(source), shipped_schema("athans")))
        written = [target]
    print(f"{', '.join(map(str, written))} written; next: occontrol solve {target}")
    return 0


def schema(
    family: FamilyName = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write it to a file.")] = None,
) -> int:
    """Print the JSON Schema of problem files, for editors: of one family, or of all."""
    from occontrol.families import find_family, shipped_schema

    text = shipped_schema(None if family is None else find_family(family).name).read_text(encoding="utf-8")
    if out is None:
        print(text, end="")
        return 0
    from occontrol.files.atomic import write_text

    write_text(out, text)
    print(f"{out} written; first line of a problem file: # yaml-language-server: $schema={out.as_posix()}")
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
