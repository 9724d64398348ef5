"""Compile once what the families' templates need, in two processes: compilers lock each other out within one.

What is compiled is kept for later calls (core/compile_cache.py). Each piece of work is a template that is solved; of a
family with a filter another piece reads measurements meanwhile, which compiles proof and filter.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from occontrol.core.errors import SolveFailed
from occontrol.studies.engines.local import begin_worker, single_threads

PROCESSES = 2
BASELINE = "round-robin"


def warm(families: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Compile for some families; each yields (family, remark) when a piece of it is done, the remark mostly empty.

    Parameters
    ----------
    families : their names

    Raises SolveFailed where a process dies.
    """
    pieces = [(name, planned) for name in families for planned in (True, False)]
    context = multiprocessing.get_context("spawn")
    with single_threads(), ProcessPoolExecutor(min(PROCESSES, len(pieces)), context, begin_worker) as pool:
        running = {pool.submit(warm_piece, name, planned): name for name, planned in pieces}
        try:
            for future in as_completed(running):
                yield running[future], future.result()
        except BrokenProcessPool as error:
            raise SolveFailed("a process that compiled has died\n  hint: more memory") from error


def warm_piece(name: str, planned: bool) -> str:
    """Solve the template of a family, or run its filter along the plan of a baseline; what the compiler's cache says.

    Parameters
    ----------
    name : of the family
    planned : whether the family's own method is to be compiled; else the filter, where there is one
    """
    from occontrol.api import read_problem, run_filter, simulate, solve
    from occontrol.core import compile_cache
    from occontrol.families import find_family, template
    from occontrol.families.family import Ability

    problem, family = read_problem(template(name)), find_family(name)
    if planned:
        solve(problem)
    elif BASELINE in family.methods and {Ability.SIMULATE, Ability.FILTER} <= set(family.abilities):
        solution = solve(problem, BASELINE)
        measurements, _ = simulate(solution.problem, solution)
        run_filter(solution.problem, solution, measurements)
    return compile_cache.remark()
