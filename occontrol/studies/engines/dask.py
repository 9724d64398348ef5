"""Dask: a local cluster that listens to this machine alone, or a scheduler elsewhere that is reached with certificates.

Dask keeps nothing: tasks write their results as everywhere else. Its messages can run any code, so whoever reaches a
scheduler without certificates is its user: such an address is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from occontrol.core.errors import SolveFailed, UsageError
from occontrol.studies.engines.local import Progress
from occontrol.studies.folder import MOST_TRIES, Entry, StudyFolder
from occontrol.studies.queue import TaskQueue
from occontrol.studies.run_task import run_task

if TYPE_CHECKING:
    from distributed import Client, Future

PAUSE = 0.5  # seconds


def check_address(address: str) -> None:
    """Raise UsageError unless `address` is 'dask' or begins with tls://.

    Parameters
    ----------
    address : what --cluster says
    """
    if address == "dask" or (address.startswith("tls://") and len(address) > len("tls://")):
        return
    if "://" in address:
        hint = "tls://HOST:PORT with certificates; whoever reaches an open scheduler can run any program on it"
        raise UsageError(f"--cluster {address}: only tls:// addresses are used\n  hint: {hint}")
    raise UsageError(f"--cluster {address} is no engine\n  hint: slurm-array, dask, or tls://HOST:PORT")


def require_dask() -> None:
    """Raise UsageError, with what installs it, where Dask is missing."""
    from importlib.util import find_spec

    if find_spec("distributed") is None:
        raise UsageError("--cluster dask needs Dask\n  hint: pip install 'occontrol[cluster]'")


def run_on_dask(
    folder: StudyFolder,
    entries: list[Entry],
    address: str,
    jobs: int,
    stopped: Callable[[], bool] = lambda: False,
    tell: Callable[[Progress], None] = lambda progress: None,
) -> Progress:
    """Do the tasks that have no result yet on a Dask cluster; the folder must be seen by all of its workers.

    Parameters
    ----------
    folder : of the study
    entries : its tasks
    address : 'dask' for a local cluster, or tls://HOST:PORT, whose certificates Dask's own configuration names
    jobs : workers of a local cluster
    stopped : asked again and again; once it is true nothing more is waited for
    tell : called with the progress whenever it changes

    Raises UsageError for other addresses and without Dask, SolveFailed where the cluster is lost; what is done stays.
    """
    check_address(address)
    require_dask()
    import dask.config
    import distributed
    from distributed.comm.core import CommClosedError

    todo = folder.missing(entries)
    progress = Progress(len(entries), sum(folder.done(e.identity) for e in entries))
    progress.failed = len(entries) - progress.done - len(todo)
    tell(progress)
    if not todo:
        return progress
    with dask.config.set({"distributed.scheduler.allowed-failures": 0, "distributed.worker.daemon": True}):
        cluster = None
        try:
            if address == "dask":
                workers = min(jobs, len(todo))
                local = {"host": "127.0.0.1", "dashboard_address": None, "threads_per_worker": 1}
                cluster = distributed.LocalCluster(n_workers=workers, **local)
            with distributed.Client(address if cluster is None else cluster, timeout=30) as client:
                _drive(client, folder, todo, progress, stopped, tell)
        except (OSError, CommClosedError, TimeoutError) as error:
            told = f"the Dask cluster is lost: {type(error).__name__}"
            raise SolveFailed(f"{told}\n  hint: what is done is kept, the same command goes on") from error
        finally:
            if cluster is not None:
                cluster.close(timeout=5)
    return progress


def _drive(
    client: Client,
    folder: StudyFolder,
    todo: list[Entry],
    progress: Progress,
    stopped: Callable[[], bool],
    tell: Callable[[Progress], None],
) -> None:
    import distributed

    def submit_what_can_begin() -> None:
        while (entry := queue.take()) is not None:
            words = (str(folder.path.resolve()), entry.identity, entry.start)
            running[client.submit(run_task, *words, pure=False)] = entry

    running: dict[Future, Entry] = {}
    queue = TaskQueue(folder, todo)
    submit_what_can_begin()
    while running and not stopped():
        try:
            ended = distributed.wait(list(running), timeout=PAUSE, return_when="FIRST_COMPLETED").done
        except (TimeoutError, distributed.TimeoutError):
            if client.status not in ("running", "newly-created"):
                raise OSError("the scheduler is gone") from None
            continue
        for future in ended:
            entry = running.pop(future)
            if future.cancelled():
                raise OSError("the scheduler is gone")
            error = future.exception()
            message = f"{type(error).__name__}: {error}" if error is not None else future.result()
            if not message:
                folder.forget_failures(entry.identity)
                progress.done += 1
            elif folder.failed(entry.identity, message) < MOST_TRIES:
                queue.again(entry)
            else:
                progress.failed += 1
            submit_what_can_begin()
        progress.running = len(running)
        tell(progress)
