"""The command line: parse, one library call, print. One file per command or small group of commands."""

from __future__ import annotations

import os
import sys

import typer

from occontrol.cli import certify, compare, export, filter, problems, simulate, solve, tradeoff

HELP = "Optimal sensor scheduling, with a proven lower bound beside every schedule."

app = typer.Typer(
    name="occontrol",
    help=HELP,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS = {
    "list": problems.list_all,
    "init": problems.init,
    "check": problems.check,
    "solve": solve.solve,
    "certify": certify.certify,
    "simulate": simulate.simulate,
    "filter": filter.filter_measurements,
    "compare": compare.compare,
    "export": export.export,
    "tradeoff": tradeoff.tradeoff,
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


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and leave with its exit code.

    Parameters
    ----------
    arguments : the words after `occontrol`; those of the process if left out
    """
    prepare()
    code = run(sys.argv[1:] if arguments is None else arguments)
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            code = _report(f"cannot write to standard output: {error.strerror}", 8)
    sys.exit(code)


def prepare() -> None:
    """Make the streams fit for any text, and leave the libraries' warnings to those who look for a fault.

    Products of small matrices on several threads take longer than on one: unless the user has set their number, one.
    """
    import warnings

    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")

    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # a name that the terminal's alphabet lacks costs nothing
    if not os.environ.get("OCCONTROL_DEBUG"):
        warnings.simplefilter("ignore")


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code; every error becomes one message on standard error.

    Parameters
    ----------
    arguments : the words after `occontrol`
    """
    from occontrol.core.errors import OccontrolError

    try:
        code = app(arguments, prog_name="occontrol", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except OccontrolError as error:
        return _report(str(error), error.exit_code)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        return _report(f"{name}{error.strerror or error}", 8)
    except SystemExit as error:  # what the parser makes of a reader that has left
        return 0 if error.code == 1 else int(error.code or 0)
    except (KeyboardInterrupt, typer.Abort):
        return _report("interrupted, nothing written", 130)
    except MemoryError:
        return _report("out of memory\n  hint: fewer intervals or sensors", 6)
    except Exception as error:
        if hasattr(error, "show") and hasattr(error, "exit_code"):  # the parser's own mistakes
            error.show()  # type: ignore[attr-defined]
            return error.exit_code  # type: ignore[attr-defined]
        if os.environ.get("OCCONTROL_DEBUG"):
            raise
        text = " ".join(str(error).split())
        return _report(f"unexpected {type(error).__name__}: {text}\n  hint: OCCONTROL_DEBUG=1 shows where", 6)


def _report(text: str, code: int) -> int:
    print(text, file=sys.stderr)
    return code
