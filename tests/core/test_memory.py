"""Memory is compared with what is there before anything is asked for."""

from __future__ import annotations

import pytest

from occontrol.core import memory
from occontrol.core.errors import ProblemError


def test_more_than_there_is_is_refused_with_both_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available", lambda: 3 * 2**30)
    memory.require(3 * 2**30, "a solve", "fewer intervals")
    with pytest.raises(ProblemError, match=r"a solve needs at least 4 GB of memory, 3 GB are there\n  hint: fewer"):
        memory.require(4 * 2**30, "a solve", "fewer intervals")


def test_some_memory_is_there() -> None:
    assert memory.available() is None or memory.available() > 2**20


def test_spans_taken_block_by_block_give_the_same_bits_in_less_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    import tracemalloc

    import numpy as np

    from occontrol.core.signal import TableSignal, as_signal
    from occontrol.numerics import transition

    n, times, edges = 12, np.linspace(0, 10, 301), np.linspace(0, 10, 201)
    swing = 1 + 0.1 * np.sin(times)[:, None, None]
    A = TableSignal(times, np.random.default_rng(0).standard_normal((1, n, n)) * swing)
    found, peaks = [], []
    for block in (2**40, 2**20):
        monkeypatch.setattr(transition, "BLOCK", block)
        tracemalloc.start()
        found.append(transition.transitions(A, as_signal(np.eye(n)), edges[:-1], edges[1:]))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert all(np.array_equal(*pair) for pair in zip(*found, strict=True))
    assert peaks[1] < peaks[0] / 4


def test_the_count_of_a_solve_holds_what_was_measured(tmp_path) -> None:
    """Peaks of whole solves, from getrusage of a process of their own: 230 MB, 426 MB and (A in a table) 790 MB."""
    import numpy as np

    import occontrol as oc
    from occontrol.core.signal import TableSignal
    from occontrol.families.athans.need import need

    for n, M, N, varies, measured in ((4, 3, 4000, 0, 230e6), (20, 20, 1000, 0, 426e6), (20, 20, 1000, 1, 790e6)):
        A = -np.eye(n)
        table = TableSignal(np.linspace(0, 10, 1000), np.repeat(A[None], 1000, axis=0))
        plant = oc.LinearPlant(A=table if varies else A, noise=np.eye(n), covariance=np.eye(n), mean=np.zeros(n))
        sensors = [oc.Sensor(f"s{j}", np.eye(n)[:1], [[1.0]], 1.0) for j in range(M)]
        problem = oc.SchedulingProblem("m", plant, sensors, np.linspace(0, 10, N + 1), np.eye(n), 10.0)
        assert need(problem, 1) / 1.3 <= measured <= 1.3 * need(problem), (n, varies)
        assert need(problem) <= 2 * measured, (n, varies)
