"""Watching a solve: a line of progress on a terminal, and Ctrl-C or SIGTERM as 'stop, keep the best so far'."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from occontrol.core import stopwatch
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down

if TYPE_CHECKING:
    from rich.live import Live

RECENT = 40
EVERY = 10.0  # seconds between two lines of progress where there is no terminal
COMPILING = "compiling (once)"
PATIENCE = 0.5  # seconds in which nothing is said
SHOW_CURSOR = b"\r\n\x1b[?25h"
_pending: threading.Timer | None = None


@dataclass
class Watched(Monitor):
    """A Monitor that also knows what the method at work aims at, and by when it must end.

    Parameters
    ----------
    target : relative gap, or None where there is none
    deadline : `seconds` at which the method's own time limit passes, or None
    absolute : whether gaps are differences and not shares: the cost holds a logarithm
    """

    target: float | None = None
    deadline: float | None = None
    absolute: bool = False


@contextmanager
def watched(log: Path | None = None) -> Iterator[Watched]:
    """A Monitor that shows progress on a terminal and is interrupted by signals.

    The first SIGINT or SIGTERM sets `interrupted`; after it the system's own handling returns, so that a second one
    ends the process at once. The handlers are put back at the end.

    Parameters
    ----------
    log : file that gets every record of progress as a line of JSON, for machines
    """
    with _logged(log) as show:
        monitor = Watched(show=show)
        with _signals(monitor):
            yield monitor


@contextmanager
def _signals(monitor: Watched) -> Iterator[None]:
    display = _display(monitor)
    lines = None if display is not None else _Lines(monitor)
    previous: dict[int, Any] = {}

    def stop(number: int, frame: FrameType | None) -> None:
        monitor.interrupted = number
        for each in previous:
            signal.signal(each, signal.SIG_DFL)
        if display is not None:
            try:
                display.stop()  # also brings the cursor back, should a second signal end the process
            except RuntimeError:  # the signal came while the display was writing: its buffer takes no second writer
                os.write(2, SHOW_CURSOR)
        # os.write: a print could be inside the very buffer that the signal interrupted
        os.write(2, b"stopping; the best so far is kept (once more to abort at once)\n")

    if threading.current_thread() is threading.main_thread():
        for each in (signal.SIGINT, signal.SIGTERM):
            previous[each] = signal.getsignal(each)
        for each in previous:
            signal.signal(each, stop)
    try:
        if display is not None:
            hush()
            display.start()
        if lines is not None:
            lines.start()
        yield
    finally:
        if display is not None:
            display.stop()
        if lines is not None:
            lines.done.set()
        for each, handler in previous.items():
            signal.signal(each, handler)


class _Lines(threading.Thread):
    """One line of progress every so often, for log files and pipes."""

    def __init__(self, monitor: Watched):
        super().__init__(daemon=True)
        self.monitor, self.done = monitor, threading.Event()

    def run(self) -> None:
        while not self.done.wait(EVERY):
            try:
                print(progress_text(self.monitor), file=sys.stderr, flush=True)
            except (OSError, ValueError):  # nobody reads any more
                return


@contextmanager
def _logged(path: Path | None) -> Iterator[Callable[[Mapping], None] | None]:
    """What a Monitor calls with every record, writing it to `path` as a line of JSON at once."""
    if path is None:
        yield None
        return
    import json

    from occontrol.core.errors import FileAccessError
    from occontrol.files.plain_json import plain

    try:
        file = open(path, "w", encoding="utf-8", buffering=1)
    except OSError as error:
        raise FileAccessError(f"cannot write {path}: {error.strerror or error}") from error
    with file:

        def show(record: Mapping) -> None:
            try:
                file.write(json.dumps(plain(record), allow_nan=False) + "\n")
            except OSError as error:
                raise FileAccessError(f"cannot write {path}: {error.strerror or error}") from error

        yield show


def exit_code(monitor: Monitor, code: int) -> int:
    """The exit code of a solve that returned `code`: 130 or 143 when `monitor` was interrupted.

    Parameters
    ----------
    monitor : Monitor
    code : exit code of the solution's status
    """
    return 128 + monitor.interrupted if monitor.interrupted else code


def announce(text: str) -> None:
    """Say what is begun if nothing else has been said PATIENCE seconds from now, on a terminal and off it.

    Nothing heavy is imported before it: whoever has started a long work reads something within a second. A short work,
    a mistake and a line of progress speak for themselves: `hush` comes first.

    Parameters
    ----------
    text : one line, such as "solving two_radars.yaml"
    """
    global _pending
    hush()
    _pending = threading.Timer(PATIENCE, print, [text], {"file": sys.stderr, "flush": True})
    _pending.daemon = True
    _pending.start()


def hush() -> None:
    """What was announced and not yet said need not be said."""
    if _pending is not None:
        _pending.cancel()


def _on_terminal() -> bool:
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def _display(monitor: Watched) -> Live | None:
    if not _on_terminal():
        return None
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    console = Console(stderr=True, highlight=False, markup=False)

    def line() -> Text:
        return Text(progress_text(monitor), style="cyan")

    return Live(get_renderable=line, console=console, refresh_per_second=5, transient=True)


def progress_text(monitor: Watched) -> str:
    """The line of progress: iteration, cost, bound, gap and the time left.

    Parameters
    ----------
    monitor : Watched
    """
    compiling = stopwatch.compiling()
    if compiling and not monitor.history:
        return COMPILING
    elapsed = f"{monitor.seconds:.0f} s"
    if not monitor.history:
        return f"{monitor.stage or 'preparing'} · {elapsed}"
    record = monitor.history[-1]
    parts = [str(record.get("stage") or monitor.stage or "solving"), f"iteration {record['iteration']}"]
    cost, bound = record["cost"], record["lower_bound"]
    if math.isfinite(cost):
        parts.append(f"cost {cost:.8g}")
    if math.isfinite(bound):
        parts.append(f"bound {rounded_down(bound, 8)}")
        if math.isfinite(cost) and monitor.absolute:
            parts.append(f"gap {cost - bound:.2g}")
        elif math.isfinite(cost) and cost:
            parts.append(f"gap {100 * (cost - bound) / abs(cost):.2g} %")
    if compiling:
        return " · ".join([*parts, COMPILING])
    left = time_left(monitor)
    return " · ".join(
        [*parts, elapsed, *([f"about {left:.0f} s left" if left >= 1 else "nearly there"] if left is not None else [])]
    )


def time_left(monitor: Watched) -> float | None:
    """Seconds until the gap reaches its target at its recent rate of decrease; never beyond the time limit.

    Parameters
    ----------
    monitor : Watched, with its history

    Returns None when nothing can be said.
    """
    ends = [x for x in (monitor.time_limit, monitor.deadline) if x is not None]
    limit = max(0.0, min(ends) - monitor.seconds) if ends else None
    stage = monitor.history[-1].get("stage") if monitor.history else None
    points = []
    for record in monitor.history[-RECENT:]:
        size = 1.0 if monitor.absolute else abs(record["cost"])
        gap = (record["cost"] - record["lower_bound"]) / size if size else 0.0
        if record.get("stage") == stage and math.isfinite(gap) and gap > 0:
            points.append((record["seconds"], math.log(gap)))
    target = monitor.target
    if not target or target <= 0 or len(points) < 5:
        return limit
    (t0, g0), (t1, g1) = points[0], points[-1]
    if g1 <= math.log(target):
        return 0.0
    if t1 <= t0 or g1 >= g0:
        return limit
    guess = (g1 - math.log(target)) * (t1 - t0) / (g0 - g1) - (monitor.seconds - t1)
    return max(0.0, guess) if limit is None else min(limit, max(0.0, guess))
