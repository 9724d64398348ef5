"""The application: which function answers which command."""

from __future__ import annotations

import typer

from occontrol.cli import (
    certify,
    compare,
    convert,
    export,
    filter,
    montecarlo,
    problems,
    report,
    sensitivity,
    show,
    simulate,
    solve,
    sweep,
    tradeoff,
    warm,
)

HELP = "Optimal sensor scheduling, with a proven lower bound beside every schedule."

app = typer.Typer(
    name="occontrol",
    help=HELP,
    no_args_is_help=True,
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS = {
    "list": problems.list_all,
    "init": problems.init,
    "schema": problems.schema,
    "check": problems.check,
    "solve": solve.solve,
    "certify": certify.certify,
    "simulate": simulate.simulate,
    "filter": filter.filter_measurements,
    "compare": compare.compare,
    "export": export.export,
    "tradeoff": tradeoff.tradeoff,
    "show": show.show,
    "report": report.report,
    "convert": convert.convert,
    "sensitivity": sensitivity.sensitivity,
    "montecarlo": montecarlo.montecarlo,
    "sweep": sweep.sweep,
    "work": sweep.work,
    "warm": warm.warm,
}
for _name, _function in COMMANDS.items():
    app.command(_name)(_function)


@app.callback(invoke_without_command=True)
def _root(version: bool = typer.Option(False, "--version", help="Print the version and stop.")) -> None:
    """Optimal sensor scheduling, with a proven lower bound beside every schedule."""
    if version:
        from importlib.metadata import version as installed

        typer.echo(f"occontrol {installed('occontrol')}")
        raise typer.Exit()
