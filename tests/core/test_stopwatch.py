"""The clock behind `seconds` and `time_limit` does not count compiling, whatever the loop and whoever calls it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from occontrol.core import stopwatch
from occontrol.core.monitor import Monitor

ROOT = Path(__file__).resolve().parents[2]

# every compilation "takes" a thousand seconds; a solve whose clock counted one would be far beyond its limit
SOLVE = """\
import sys, time
import occontrol as oc
from occontrol.core import stopwatch
from numba.core import event

class Slow(event.Listener):
    late, compiled = 0.0, 0
    def on_start(self, what):
        Slow.compiled += 1
    def on_end(self, what):
        Slow.late += 1000.0

event.register("numba:compile", Slow())
real = time.perf_counter
stopwatch.time.perf_counter = lambda: real() + Slow.late
problem = oc.read_problem(sys.argv[1])
solution = oc.solve(problem)
print(solution.status, solution.cost, solution.seconds < 500, Slow.compiled)
"""


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
    assert not watch.stop and not child.stop and watch.seconds == 0.0
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
    assert clock.now == 2100.0 and stopwatch.seconds() == began
    assert said == ["compiling"] and not stopwatch.compiling()


def test_an_empty_cache_changes_neither_status_nor_seconds(tmp_path: Path) -> None:
    file = tmp_path / "two.yaml"
    file.write_text(
        "family: robust\nhorizon: {end: 1.0, slots: 4}\n"
        "plant: {A: [[-1, 1], [0, -1]], B: [[0.2], [0.2]], K: [[0.1, 0.1]],\n"
        "        initial: {center: [0, 0], weight: {diag: [1, 1]}, level: 1}}\n"
        "sensors: [{name: one, C: [[1, 0]]}, {name: two, C: [[0, 1]]}]\n"
        "method: {name: optimal, time_limit: 500}\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    said = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", SOLVE, str(file)], env=environment, capture_output=True, text=True, check=True
        )
        said.append(done.stdout.split())
    cold, warm = said
    assert cold[0] == warm[0] == "certified" and cold[1] == warm[1] and cold[2] == warm[2] == "True"
    assert int(cold[3]) > 0 and int(warm[3]) == 0
