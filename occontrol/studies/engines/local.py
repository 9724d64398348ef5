"""Processes of this machine. Every place has a pool of one, so that a dead worker costs its own task one try alone.

Workers watch their parent and end with it, whatever kills it. They leave interruptions to it, and have one thread each.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from occontrol.studies.folder import MOST_TRIES, Entry, StudyFolder
from occontrol.studies.queue import TaskQueue
from occontrol.studies.run_task import run_task

MOST_STILLBORN = 20  # workers of one run that may die while they load, before a task pays for it
PAUSE = 0.2  # seconds between looks at interruptions and time limits
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass
class Progress:
    """How far a run of tasks is.

    Parameters
    ----------
    total : tasks of the study, or of the part
    done, failed, running : of these
    """

    total: int
    done: int = 0
    failed: int = 0
    running: int = 0


@dataclass
class _Place:
    """One worker, and the task that it is at."""

    pool: ProcessPoolExecutor
    pid: Future[int]
    entry: Entry | None = None
    began: float = 0.0
    overdue: bool = field(default=False)

    @property
    def loaded(self) -> bool:
        """Whether the worker ever answered."""
        return self.pid.done() and self.pid.exception() is None

    def kill(self) -> None:
        """End the worker at once."""
        with suppress(OSError, BrokenProcessPool, TimeoutError):
            os.kill(self.pid.result(timeout=60), signal.SIGKILL)
        self.pool.shutdown(wait=False, cancel_futures=True)


def run_here(
    folder: StudyFolder,
    entries: list[Entry],
    jobs: int,
    timeout: float | None = None,
    stopped: Callable[[], bool] = lambda: False,
    tell: Callable[[Progress], None] = lambda progress: None,
) -> Progress:
    """Do the tasks that have no result yet, in `jobs` processes.

    Parameters
    ----------
    folder : of the study
    entries : its tasks, or those of one part
    jobs : processes
    timeout : seconds after which a task is ended and has failed, or None
    stopped : asked again and again; once it is true the workers end, and what they were at is left for another time
    tell : called with the progress whenever it changes

    Returns how far it came. A task that fails, or whose worker dies, is tried at most three times over all runs.
    """
    queue = TaskQueue(folder, folder.missing(entries))
    progress = Progress(len(entries), sum(folder.done(e.identity) for e in entries))
    progress.failed = len(entries) - progress.done - len(queue)
    tell(progress)
    stillborn = 0
    with _places(min(jobs, len(queue))) as places:
        running: dict[Future[str], int] = {}
        while (queue or running) and not stopped():
            for number, place in enumerate(places):
                if place.entry is None and (entry := queue.take()) is not None:
                    place.entry, place.began, place.overdue = entry, time.monotonic(), False
                    future = place.pool.submit(run_task, str(folder.path), entry.identity, entry.start)
                    running[future] = number
            progress.running = len(running)
            ended, _ = wait(running, timeout=PAUSE, return_when=FIRST_COMPLETED)
            for future in ended:
                number = running.pop(future)
                place = places[number]
                entry, place.entry = place.entry, None
                if entry is not None and not place.loaded and stillborn < MOST_STILLBORN:
                    stillborn += 1  # it died before it was at the task
                    queue.again(entry, first=True)
                elif entry is not None and (message := _outcome(future, place, timeout)):
                    tries = folder.failed(entry.identity, message)
                    if tries < MOST_TRIES:
                        queue.again(entry)
                    else:
                        progress.failed += 1
                elif entry is not None:
                    folder.forget_failures(entry.identity)
                    progress.done += 1
                if future.exception() is not None:  # the worker is gone
                    place.kill()
                    places[number] = _new_place()
            progress.running = len(running)
            if ended:
                tell(progress)
            if timeout is not None:
                _end_what_takes_too_long(places, timeout)
    return progress


def _outcome(future: Future[str], place: _Place, timeout: float | None) -> str:
    """Why a task failed; empty where it did not."""
    error = future.exception()
    if error is None:
        return future.result()
    if place.overdue:
        return f"took longer than task_timeout, {timeout:g} s"
    return f"its process died ({type(error).__name__})"


def _end_what_takes_too_long(places: list[_Place], timeout: float) -> None:
    for place in places:
        started = place.pid.done()  # the loading of a worker is not the task's time
        if place.entry is not None and not started:
            place.began = time.monotonic()
        elif place.entry is not None and not place.overdue and time.monotonic() - place.began > timeout:
            place.overdue = True
            with suppress(OSError, BrokenProcessPool):
                os.kill(place.pid.result(), signal.SIGKILL)


@contextmanager
def _places(count: int) -> Iterator[list[_Place]]:
    with single_threads():
        places = [_new_place() for _ in range(count)]
        try:
            yield places
        finally:
            for place in places:
                if place.entry is None:
                    place.pool.shutdown(wait=False)
                else:
                    place.kill()


@contextmanager
def single_threads() -> Iterator[None]:
    """Processes that begin inside have libraries of one thread."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))  # read by the libraries when a worker loads them
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _new_place() -> _Place:
    pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=begin_worker)
    return _Place(pool, pool.submit(os.getpid))


def begin_worker() -> None:
    """What a new worker does first: leave interruptions to its parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C reaches the whole group; the parent decides
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
