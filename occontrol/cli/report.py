"""occontrol report: the pictures and the page of a run, drawn again."""

from __future__ import annotations

from typing import Annotated

import typer

from occontrol.cli.export import RunFolder


def report(
    run: RunFolder,
    static: Annotated[bool, typer.Option("--static", help="Pictures only: a smaller page without scripts.")] = False,
) -> int:
    """Draw the pictures of a run and its page, DIR/report.html, again; the numbers stay as they are."""
    from occontrol.api import rewrite_report

    print(f"written  {rewrite_report(run, static)}")
    return 0
