"""What the commands print: aligned lines, tables, numbers."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence

ROUNDING = 1e-12  # relative


def print_pairs(pairs: Iterable[tuple[str, str]]) -> None:
    """Print label and text, the texts aligned.

    Parameters
    ----------
    pairs : (label, text); further lines of a text are indented below its first
    """
    pairs = [(str(label), str(text)) for label, text in pairs]
    width = max((len(label) for label, _ in pairs), default=0)
    for label, text in pairs:
        first, *rest = text.splitlines() or [""]
        print(f"{label:<{width}}  {first}".rstrip())
        for line in rest:
            print(" " * (width + 2) + line)


def print_table(headers: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[int] = ()) -> None:
    """Print a table that is never cut off away from a terminal.

    Parameters
    ----------
    headers : one per column
    rows : texts, one per column
    right : the columns to be aligned on the right
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for i, header in enumerate(headers):
        table.add_column(header, justify="right" if i in right else "left", no_wrap=i in right, overflow="fold")
    for row in rows:
        table.add_row(*(str(cell) for cell in row))

    class OnThePipe(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # handled in one place for every command, instead of rich's own exit code

    console = OnThePipe(width=None if sys.stdout.isatty() else 200, highlight=False, markup=False)
    console.print(table)


def number(value: object, digits: int = 8) -> str:
    """A number as text, '-' where there is none.

    Parameters
    ----------
    value : number or None
    digits : significant digits
    """
    return f"{value:.{digits}g}" if isinstance(value, int | float) and not isinstance(value, bool) else "-"


def percent(value: object) -> str:
    """A relative gap as a percentage, '-' where there is none; what is only rounding is 0.

    Parameters
    ----------
    value : number or None
    """
    if isinstance(value, int | float) and abs(value) < ROUNDING:
        value = 0.0
    return f"{100 * value:.3g} %" if isinstance(value, int | float) else "-"


def with_error(value: object, error: object, digits: int = 6) -> str:
    """A number with its standard error, '6.79 ± 0.092'; the number alone where the error is not known.

    Parameters
    ----------
    value, error : numbers or None
    digits : significant digits of the value
    """
    known = isinstance(error, int | float) and error == error
    return number(value, digits) + (f" ± {error:.2g}" if known else "")


def print_json(value: object) -> None:
    """Print `value` as JSON, and nothing else, on standard output.

    Parameters
    ----------
    value : nested mappings, sequences, arrays and numbers
    """
    from occontrol.files.plain_json import to_json

    text = to_json(value)
    try:
        text.encode(sys.stdout.encoding or "ascii")
    except (UnicodeError, LookupError):  # escapes are JSON on every console
        text = to_json(value, ascii_only=True)
    sys.stdout.write(text)
    sys.stdout.flush()


def note_linearised(results: Iterable[Mapping[str, object]]) -> None:
    """Say below a table that its costs and bounds are of a linearised problem, where they are.

    Parameters
    ----------
    results : contents of result.json, or of tradeoff.json
    """
    if any(result.get("certificate_of") == "linearised" for result in results):
        print("costs and bounds are of the problem linearised along its nominal path, not of the plant itself")


def note(text: str) -> None:
    """Print a remark on standard error.

    Parameters
    ----------
    text : what to say
    """
    print(text, file=sys.stderr)
