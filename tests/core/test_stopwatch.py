"""The clock behind `seconds` and `time_limit` does not count compiling, whatever the loop and whoever calls it."""

from __future__ import annotations

import dataclasses
import time
import types
from pathlib import Path

import pytest

import occontrol as oc
from occontrol.core import stopwatch
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status

DATA = Path(__file__).resolve().parents[1] / "data" / "soundness"

class Clock:
    """Stands in for the time module."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(stopwatch, "time", made)
    return made


def test_the_clock_stands_still_inside_and_goes_on_after(clock: Clock) -> None:
    began = stopwatch.seconds()
    clock.now += 2.0
    with stopwatch.stopped():
        clock.now += 30.0
        assert stopwatch.seconds() - began == 2.0
        with stopwatch.stopped():  # a loop that calls another one is compiled after it
            clock.now += 30.0
        clock.now += 30.0
        assert stopwatch.seconds() - began == 2.0
    clock.now += 1.0
    assert stopwatch.seconds() - began == 3.0


def test_a_failure_inside_starts_the_clock_again(clock: Clock) -> None:
    began = stopwatch.seconds()
    with pytest.raises(ValueError), stopwatch.stopped():
        clock.now += 5.0
        raise ValueError
    clock.now += 1.0
    assert stopwatch.seconds() - began == 1.0


def test_a_time_limit_does_not_count_what_is_compiled(clock: Clock) -> None:
    watch = Monitor(time_limit=10.0)
    child = watch.child(5.0)
    with stopwatch.stopped():
        clock.now += 1000.0
    assert not watch.stop and not child.stop and watch.seconds == pytest.approx(0.0, abs=1e-9)
    clock.now += 6.0
    assert child.stop and not watch.stop


def test_numba_stops_the_clock_and_says_so_once(clock: Clock) -> None:
    from numba import njit
    from numba.core import event

    said = []

    class Slow(event.Listener):
        def on_start(self, event: object) -> None:
            assert stopwatch.compiling()
            clock.now += 1000.0

        def on_end(self, event: object) -> None:
            pass

    @njit
    def half(x: float) -> float:
        return 0.5 * x

    slow, began = Slow(), stopwatch.seconds()
    event.register("numba:compile", slow)
    try:
        stopwatch.tell(lambda: said.append("compiling"))
        assert half(3.0) == 1.5 and half(3) == 1.5  # two kinds of argument, two compilations
    finally:
        event.unregister("numba:compile", slow)
        stopwatch.tell(None)
    assert clock.now == 2100.0
    assert stopwatch.seconds() == pytest.approx(began, abs=1e-9)  # sums of pauses round
    assert said == ["compiling"] and not stopwatch.compiling()


def test_an_empty_cache_changes_neither_status_nor_cost_nor_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    import numba
    from numba.core import event

    from occontrol.families.vlambda import sequence_search

    late, real = [0.0], time.perf_counter
    slow = type("Slow", (event.Listener,), {"on_start": lambda *_: None, "on_end": lambda *_: late.append(1000.0)})()
    problem = oc.read_problem(DATA / "v2_time_limit_compile.yaml")
    method = dataclasses.replace(problem.method, time_limit=500.0)  # each compilation below takes a thousand
    warm = oc.solve(problem, method)
    monkeypatch.setattr(sequence_search, "undominated", numba.njit(sequence_search.undominated.py_func))
    monkeypatch.setattr(stopwatch, "time", types.SimpleNamespace(perf_counter=lambda: real() + sum(late)))
    event.register("numba:compile", slow)
    try:
        cold = oc.solve(problem, method)
    finally:
        event.unregister("numba:compile", slow)
    assert sum(late) >= 1000.0
    assert cold.status is warm.status is Status.CERTIFIED and cold.message == warm.message
    assert cold.cost == warm.cost == pytest.approx(53.62875199) and cold.certificate == warm.certificate
    assert cold.seconds < 500.0 and all(record["seconds"] < 500.0 for record in cold.history)
