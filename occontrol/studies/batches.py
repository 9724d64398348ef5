"""Batches of simulated runs in several processes; the numbers do not depend on how many there are."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from numpy.random import SeedSequence

from occontrol.api import family_of
from occontrol.core.errors import SolveFailed
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.families.abilities import Work
from occontrol.studies.engines.local import begin_worker, single_threads

_at: list[tuple[BaseProblem, Solution]] = []


@contextmanager
def workers(problem: BaseProblem, solution: Solution, jobs: int) -> Iterator[Work | None]:
    """What does the batches of a problem in `jobs` processes; None where one is enough.

    Parameters
    ----------
    problem : whose runs are simulated
    solution : with the nominal plan
    jobs : processes

    Raises SolveFailed where a process dies.
    """
    if jobs <= 1:
        yield None
        return
    context = multiprocessing.get_context("spawn")
    with single_threads(), ProcessPoolExecutor(jobs, context, _begin, (problem, solution)) as pool:

        def work(
            policies: Sequence[str], pieces: Sequence[Sequence[SeedSequence]]
        ) -> Iterator[tuple[dict, dict]]:
            try:
                yield from pool.map(_batch, [list(policies)] * len(pieces), pieces)
            except BrokenProcessPool as error:
                hint = "fewer jobs, or more memory"
                raise SolveFailed(f"a process that simulated runs has died\n  hint: {hint}") from error

        yield work  # type: ignore[misc]


def _begin(problem: BaseProblem, solution: Solution) -> None:
    begin_worker()
    _at[:] = [(problem, solution)]


def _batch(policies: Sequence[str], seeds: Sequence[SeedSequence]) -> tuple[dict, dict]:
    problem, solution = _at[0]
    return family_of(problem).monte_carlo_batch(problem, solution, policies, seeds)


