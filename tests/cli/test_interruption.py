"""Ctrl-C and SIGTERM in a real process on a real terminal: the best so far is kept, certified and written."""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from occontrol.api import read_run
from occontrol.cli.watch import Watched, exit_code, progress_text, time_left, watched

PROGRAM = "from occontrol.cli import main; main()"
# from its second iteration on it waits for the signal, which then finds it at work on any machine
HELD = """
import time
from occontrol.core.monitor import Monitor
report = Monitor.report
def held(self, iteration, *numbers, **more):
    report(self, iteration, *numbers, **more)
    while iteration >= 2 and not self.interrupted:
        time.sleep(0.01)
Monitor.report = held
from occontrol.cli import main
main()
"""
DEAF = """
import sys, time
import occontrol.cli.solve
def deaf(problem, name, monitor):
    sys.stderr.write("deaf")
    sys.stderr.flush()
    while True:
        time.sleep(1)
occontrol.cli.solve.run_method = deaf
from occontrol.cli import main
main()
"""


class Terminal:
    """A process whose standard error is a terminal."""

    def __init__(self, *arguments: str, program: str = PROGRAM, **more: str):
        self.control, end = pty.openpty()
        self.text = ""
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, *arguments],
            stdout=subprocess.PIPE,
            stderr=end,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "150", **more},
        )
        os.close(end)

    def read_until(self, words: str, seconds: float = 200) -> None:
        end = time.monotonic() + seconds
        while words not in self.text:
            if time.monotonic() > end:
                self.process.kill()
                raise AssertionError(f"no '{words}' in: {self.text[-2000:]}")
            try:
                self.text += os.read(self.control, 4096).decode(errors="replace")
            except OSError as error:  # the other end is closed
                raise AssertionError(f"ended without '{words}': {self.text[-2000:]}") from error

    def finish(self) -> int:
        code = self.process.wait(200)
        os.close(self.control)
        return code


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("method", ["relaxed", "collocation"])
def test_one_signal_keeps_the_best_so_far_with_its_certificate(
    tmp_path: Path, small_text: str, number: int, code: int, method: str
) -> None:
    text = small_text[: small_text.index("method:")] + f"method: {{name: {method}, relative_gap: 1.0e-15}}\n"
    (tmp_path / "long.yaml").write_text(text)
    terminal = Terminal(
        "solve", str(tmp_path / "long.yaml"), "--out", str(tmp_path / "run"), "--no-figures", program=HELD
    )
    terminal.read_until("iteration 2")
    for words in ("cost", "bound", "gap") if method == "relaxed" else ("cost",):
        assert words in terminal.text
    terminal.process.send_signal(number)
    if method == "relaxed":  # Ipopt has a handler of its own, which says nothing
        terminal.read_until("the best so far is kept")
    terminal.read_until("\x1b[?25h")  # the cursor is back
    assert terminal.finish() == code
    _, solution = read_run(tmp_path / "run")
    assert solution.status == "interrupted" and solution.method == method and solution.certificate is not None
    # an interrupted Ipopt hands back 0.0
    assert 0 < solution.certificate.lower_bound <= solution.certificate.cost == solution.cost
    assert "\x1b[36m" in terminal.text  # in colour


@pytest.mark.slow
def test_a_second_signal_ends_the_process_at_once(tmp_path: Path, small_file: Path) -> None:
    """Even where the method does not listen to the first one."""
    terminal = Terminal("solve", str(small_file), "--out", str(tmp_path / "run"), "--no-figures", program=DEAF)
    terminal.read_until("deaf")
    terminal.process.send_signal(signal.SIGINT)
    terminal.read_until("once more")
    terminal.process.send_signal(signal.SIGINT)
    assert terminal.finish() == -signal.SIGINT
    assert not (tmp_path / "run" / "result.json").exists()


@pytest.mark.slow
def test_no_colour_and_a_dumb_terminal(tmp_path: Path, small_file: Path) -> None:
    plain = Terminal("solve", str(small_file), "--out", str(tmp_path / "run"), "--no-figures", NO_COLOR="1")
    plain.read_until("iteration")
    assert "\x1b[3" not in plain.text  # no colours; moving the cursor is no colour
    plain.process.wait(200)
    dumb = Terminal("solve", str(small_file), "--out", str(tmp_path / "run"), "--no-figures", TERM="dumb")
    assert dumb.process.wait(200) == 0
    os.set_blocking(dumb.control, False)
    said = b""
    with contextlib.suppress(BlockingIOError, OSError):
        while part := os.read(dumb.control, 1000):
            said += part
    assert b"\x1b" not in said  # lines may be said, nothing is drawn


def test_the_handlers_are_put_back() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with watched() as monitor:
        assert signal.getsignal(signal.SIGINT) not in before
        signal.raise_signal(signal.SIGTERM)
        assert monitor.stop and monitor.interrupted == signal.SIGTERM
        assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL  # so that the next one ends the process
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
    assert exit_code(monitor, 0) == 143


class Frozen(Watched):
    """A monitor whose clock stands still."""

    now = 0.0

    @property
    def seconds(self) -> float:
        return self.now


def at(records: list[tuple[float, float]], target: float | None = 1e-4, limit: float | None = None) -> Watched:
    """A monitor with the given (seconds, relative gap), now."""
    monitor = Frozen(target=target, time_limit=limit)
    monitor.now = records[-1][0] if records else 0.0
    monitor.history = [
        {"iteration": i, "cost": 1.0, "lower_bound": 1.0 - gap, "seconds": t, "stage": "relaxation"}
        for i, (t, gap) in enumerate(records)
    ]
    return monitor


def test_time_left_follows_the_rate_at_which_the_gap_falls() -> None:
    falling = at([(float(t), 10.0 ** (-t / 2)) for t in range(5)])  # a factor of ten every two seconds, now at 1e-2
    left = time_left(falling)
    assert left == pytest.approx(4.0, rel=1e-12)
    assert "iteration 4" in progress_text(falling) and "about 4 s left" in progress_text(falling)
    assert time_left(at([(float(t), 0.5) for t in range(9)])) is None
    assert time_left(at([(float(t), 0.5) for t in range(9)], limit=10.0)) == 2.0
    running = at([(float(t), 0.5) for t in range(9)])
    running.deadline = 11.0  # of the method at work
    assert time_left(running) == 3.0
    assert time_left(at([])) is None
    assert progress_text(at([])).startswith("preparing")


def test_after_an_interruption_no_figures_are_drawn(
    tmp_path: Path, small_file: Path, small_solution, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    from occontrol.cli import run

    def interrupted(problem, name, monitor):
        monitor.interrupted = signal.SIGINT
        return small_solution

    monkeypatch.setattr("occontrol.cli.solve.run_method", interrupted)
    assert run(["solve", str(small_file), "--out", str(tmp_path / "run")]) == 130
    assert "interrupted: no figures were drawn" in capsys.readouterr().err
    assert (tmp_path / "run" / "result.json").exists() and not (tmp_path / "run" / "figures").exists()


def test_polishing_one_by_one_stops_when_asked(
    small_text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import occontrol
    from occontrol.core.monitor import Monitor
    from occontrol.families.athans.discretise import discretise, feasible_set
    from occontrol.scheduling.baselines import round_robin
    from occontrol.scheduling.hminimal import polish
    from occontrol.scheduling.sweep import Sweep

    (tmp_path / "x.yaml").write_text(small_text.replace("output:", "running: {diag: [0.1, 0.2]}, output:"))
    problem = occontrol.read_problem(tmp_path / "x.yaml")
    sweep, allowed = Sweep(discretise(problem)), feasible_set(problem)
    assert sweep.dense  # a running weight
    start = round_robin(sweep.recursion, allowed)
    assert polish(sweep, allowed, start).cost < sweep.cost(start)
    calls: list[str] = []
    for name in ("cost", "cost_and_gradient"):
        counted = getattr(sweep, name)
        monkeypatch.setattr(
            sweep, name, lambda *a, _name=name, _of=counted, **k: (calls.append(_name), _of(*a, **k))[1], raising=False
        )
    asked = Monitor(interrupted=signal.SIGINT)
    stopped = polish(sweep, allowed, start, monitor=asked)
    assert stopped.end == "interrupted" and not asked.history
    assert len(calls) <= 3, calls


def test_a_signal_while_the_display_writes_is_heard_all_the_same(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The buffer of standard error takes no second writer: the handler then brings the cursor back by itself."""

    class Busy:
        def start(self) -> None:
            pass

        def stop(self) -> None:
            if signal.getsignal(signal.SIGINT) == signal.SIG_DFL:  # inside the handler
                raise RuntimeError("reentrant call inside <_io.BufferedWriter name='<stderr>'>")

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr("occontrol.cli.watch._display", lambda monitor: Busy())
    with watched() as monitor:
        signal.raise_signal(signal.SIGINT)
        assert monitor.stop and monitor.interrupted == signal.SIGINT
        signal.signal(signal.SIGINT, before)  # so that the display can be stopped at the end
    said = capfd.readouterr().err
    assert "\x1b[?25h" in said and "once more to abort at once" in said
