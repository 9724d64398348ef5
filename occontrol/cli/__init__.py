"""The command line: parse, one library call, print. One file per command or small group of commands.

Nothing heavy is imported here: the handlers of signals stand before the libraries are loaded.
"""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and leave with its exit code.

    Parameters
    ----------
    arguments : the words after `occontrol`; those of the process if left out
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, leave)
    prepare()
    code = run(sys.argv[1:] if arguments is None else arguments)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the work is done and has its code
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            code = _report(f"cannot write to standard output: {error.strerror}", 8)
    sys.exit(code)


def leave(number: int, frame: FrameType | None) -> None:
    """End the process at once with one line, wherever a signal finds it outside of a solve.

    An exception could be swallowed by the import or the callback that it is raised in; unfinished files are swept by
    the next write.

    Parameters
    ----------
    number : of the signal
    frame : where it was
    """
    atomic = sys.modules.get("occontrol.files.atomic")
    written = [str(path) for path in getattr(atomic, "WRITTEN", ())]
    text = f"interrupted; complete: {', '.join(written)}" if written else "interrupted, nothing written"
    os.write(2, f"{text}\n".encode("utf-8", "backslashreplace"))
    os._exit(128 + number)


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
    import typer

    from occontrol.cli.application import app
    from occontrol.cli.watch import hush
    from occontrol.core import compile_cache, stopwatch
    from occontrol.core.errors import OccontrolError

    stopwatch.tell(lambda: print("compiling (once)", file=sys.stderr, flush=True))
    try:
        code = app(arguments, prog_name="occontrol", standalone_mode=False)
        hush()
        if compile_cache.remark():
            print(f"note: {compile_cache.remark()}", file=sys.stderr)
        return code if isinstance(code, int) else 0
    except OccontrolError as error:
        hush()
        return _report(str(error), error.exit_code)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        return _report(f"{name}{error.strerror or error}", 8)
    except SystemExit as error:  # what the parser makes of a reader that has left
        return 0 if error.code == 1 else int(error.code or 0)
    except KeyboardInterrupt:
        return _report("interrupted, nothing written", 130)
    except MemoryError:
        return _report("out of memory\n  hint: fewer intervals or sensors, or more memory; check says the need", 6)
    except Exception as error:
        if isinstance(error, typer.Abort) and not isinstance(error.__cause__, EOFError):  # the parser's Ctrl-C
            return _report("interrupted, nothing written", 130)
        if hasattr(error, "show") and hasattr(error, "exit_code"):  # the parser's own mistakes
            error.show()  # type: ignore[attr-defined]
            return error.exit_code  # type: ignore[attr-defined]
        if os.environ.get("OCCONTROL_DEBUG"):
            raise
        text = " ".join(str(error).split())
        hush()
        return _report(f"unexpected {type(error).__name__}: {text}\n  hint: OCCONTROL_DEBUG=1 shows where", 6)


def _report(text: str, code: int) -> int:
    print(text, file=sys.stderr)
    return code
