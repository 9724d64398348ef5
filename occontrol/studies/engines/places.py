"""Processes, here or on a Dask cluster, that keep pieces of one computation and answer questions about them."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from occontrol.core.errors import SolveFailed
from occontrol.core.spread import HERE, Piece, Reply, Spread
from occontrol.studies.engines.dask import check_address, require_dask
from occontrol.studies.engines.local import begin_worker, single_threads

if TYPE_CHECKING:
    from distributed import Client

LOST = "a process that kept a part of the problem died twice\n  hint: fewer jobs, or more memory"

_kept: list[object] = []  # in a worker: the piece that it keeps


class Places(Spread):
    """One process of this machine a piece; a process that dies is replaced once, for the same question.

    Parameters
    ----------
    count : of processes
    stack : which ends them
    """

    def __init__(self, count: int, stack: ExitStack):
        self.count, self._stack = count, stack

    def hold(self, function: Callable[..., Reply], pieces: Sequence[Piece]) -> Callable[..., list[Reply]]:
        """See `Spread.hold`. Raises SolveFailed, when asked, where a process and the one after it die."""
        pools = [self._begin(piece) for piece in pieces]

        def ask(*words: object) -> list[Reply]:
            running = [pool.submit(_of_kept, function, words) for pool in pools]
            answers = []
            for number, future in enumerate(running):
                try:
                    answers.append(future.result())
                except BrokenProcessPool:
                    pools[number] = self._begin(pieces[number])
                    try:
                        answers.append(pools[number].submit(_of_kept, function, words).result())
                    except BrokenProcessPool as error:
                        raise SolveFailed(LOST) from error
            return answers

        return ask

    def _begin(self, piece: object) -> ProcessPoolExecutor:
        pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _keep, (piece,))
        self._stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        return pool


class DaskPlaces(Spread):
    """Workers of a Dask cluster; a piece is sent once, and again to another worker where its own is lost.

    Parameters
    ----------
    client : distributed.Client
    count : of pieces
    """

    def __init__(self, client: Client, count: int):
        self.count, self._client = count, client

    def hold(self, function: Callable[..., Reply], pieces: Sequence[Piece]) -> Callable[..., list[Reply]]:
        """See `Spread.hold`. Raises SolveFailed, when asked, where the cluster is lost."""
        kept = [self._client.submit(_itself, piece, pure=False) for piece in pieces]

        def ask(*words: object) -> list[Reply]:
            running = [self._client.submit(function, piece, *words, pure=False) for piece in kept]
            try:
                return self._client.gather(running)
            except Exception as error:
                told = f"the Dask cluster is lost: {type(error).__name__}: {error}"
                raise SolveFailed(f"{told}\n  hint: try again, or with --jobs on this machine") from error

        return ask


@contextmanager
def places(jobs: int, cluster: str | None = None) -> Iterator[Spread]:
    """Where the pieces of one computation are done.

    Parameters
    ----------
    jobs : processes of this machine, or of a local cluster
    cluster : None, 'dask', or tls://HOST:PORT

    Raises UsageError for other addresses and without Dask.
    """
    if cluster is not None:
        check_address(cluster)
        require_dask()
        with _cluster(jobs, cluster) as client:
            yield DaskPlaces(client, jobs)
    elif jobs <= 1:
        yield HERE
    else:
        with single_threads(), ExitStack() as stack:
            yield Places(jobs, stack)


@contextmanager
def _cluster(jobs: int, address: str) -> Iterator[Client]:
    import dask.config
    import distributed

    with dask.config.set({"distributed.worker.daemon": True}), single_threads(), ExitStack() as stack:
        try:
            target: object = address
            if address == "dask":
                local = {"host": "127.0.0.1", "dashboard_address": None, "threads_per_worker": 1}
                target = stack.enter_context(distributed.LocalCluster(n_workers=jobs, **local))
            client = stack.enter_context(distributed.Client(target, timeout=30))
        except (OSError, TimeoutError) as error:
            raise SolveFailed(f"the Dask cluster {address} does not answer: {type(error).__name__}") from error
        yield client


def _keep(piece: object) -> None:
    begin_worker()
    _kept[:] = [piece]


def _of_kept(function: Callable[..., Reply], words: Sequence[object]) -> Reply:
    return function(_kept[0], *words)


def _itself(piece: Piece) -> Piece:
    return piece
