"""Ipopt's wrapper: statuses, the check before the start, best iterate, interrupts."""

import os
import signal
import subprocess
import sys
import time

import casadi
import numpy as np
import pytest

from occontrol.core.errors import SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.athans.collocation.points import butcher_table
from occontrol.numerics.nlp import IPOPT_STATUS, IpoptOptions, Program, interruptible, solve_nlp


def rosenbrock(size=2, **changes):
    x = casadi.SX.sym("x", size)
    f = sum(100 * (x[i + 1] - x[i] ** 2) ** 2 + (1 - x[i]) ** 2 for i in range(size - 1))
    big = np.full(size, np.inf)
    given = {
        "variables": x,
        "objective": f,
        "constraints": casadi.vertcat(x[0] + x[1]),
        "lower": -big,
        "upper": big,
        "g_lower": np.array([-np.inf]),
        "g_upper": np.array([1.0]),
    }
    return Program(**{**given, **changes})


def test_a_constrained_minimum_and_its_multiplier(capfd):
    monitor = Monitor()
    found = solve_nlp(rosenbrock(), np.array([-1.2, 1.0]), IpoptOptions(), monitor)
    assert found.status is Status.FEASIBLE and found.native == "Solve_Succeeded"
    x, y = found.x
    assert x + y == pytest.approx(1.0, abs=1e-7)
    # stationarity of f + multiplier (x + y)
    assert 200 * (y - x * x) + found.multipliers[0] == pytest.approx(0, abs=1e-5)
    assert found.iterations == len(monitor.history) - 1
    printed = capfd.readouterr()
    assert printed.out == "" and printed.err == ""


def test_iteration_limit_returns_the_best_iterate():
    found = solve_nlp(rosenbrock(), np.array([-1.2, 1.0]), IpoptOptions(max_iterations=3), Monitor())
    assert found.status is Status.LIMIT and "max_iterations" in found.message
    assert 0 < found.objective < 24.2


def test_an_infeasible_program_is_failed():
    x = casadi.SX.sym("x")
    program = Program(x, x, casadi.vertcat(x**2), np.array([-9.0]), np.array([9.0]), np.array([-2.0]), np.array([-1.0]))
    found = solve_nlp(program, np.array([1.0]), IpoptOptions(), Monitor())
    assert found.status is Status.FAILED and found.violation > 0.5


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ({"objective": lambda x: casadi.log(x[0])}, "the objective is nan at the start"),
        (
            {"constraints": lambda x: casadi.vertcat(1 / (x[0] + 1.0) + 0 * x[1])},
            "constraint 0 is not finite at the start",
        ),
        (
            {"constraints": lambda x: casadi.vertcat(casadi.sqrt(x[0] + 1.0))},
            "the derivative of constraint 0 is not finite",
        ),
        (
            {"objective": lambda x: casadi.sqrt(x[0] + 1.0)},
            "the derivative of the objective by variable 0 is not finite",
        ),
    ],
)
def test_what_is_not_finite_at_the_start_is_named(part, words):
    plain = rosenbrock()
    changes = {name: make(plain.variables) for name, make in part.items()}
    program = Program(**{**plain.__dict__, **changes})
    with pytest.raises(SolveFailed, match=words):
        solve_nlp(program, np.array([-1.0, 1.0]), IpoptOptions(), Monitor())


def test_stop_of_the_monitor_ends_the_solve():
    def show(record):
        if record["iteration"] == 4:
            monitor.interrupted = signal.SIGINT

    monitor = Monitor(show=show)
    found = solve_nlp(rosenbrock(), np.array([-1.2, 1.0]), IpoptOptions(), monitor)
    assert found.status is Status.INTERRUPTED and found.iterations == 4
    assert np.isfinite(found.objective) and found.objective > 0  # CasADi alone would say 0.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_inside_ipopt(number):
    """It comes from another process at whatever moment; the last iterations wait for it."""
    handler = signal.getsignal(number)
    kill = f"import os; os.kill({os.getpid()}, {int(number)})"
    killers = []

    def show(record):
        if record["iteration"] == 3:
            killers.append(subprocess.Popen([sys.executable, "-c", kill]))
        while record["iteration"] >= 20 and not monitor.interrupted:
            time.sleep(0.01)

    monitor = Monitor(show=show)
    found = solve_nlp(rosenbrock(40), np.tile([-1.2, 1.0], 20), IpoptOptions(), monitor)
    assert found.status is Status.INTERRUPTED and monitor.interrupted == number
    assert killers[0].wait() == 0 and 4 <= len(monitor.history) <= 21
    assert 0 < found.objective < monitor.history[0]["cost"]
    assert signal.getsignal(number) is handler


def test_time_limit():
    """It passes at the sixth iteration: then the clock is set forward."""

    def show(record):
        if record["iteration"] == 5:
            monitor.started -= 2e4

    monitor = Monitor(show=show, time_limit=1e4)
    found = solve_nlp(rosenbrock(40), np.tile([-1.2, 1.0], 20), IpoptOptions(), monitor)
    assert found.status is Status.LIMIT and "time_limit" in found.message
    assert found.iterations == 5 and 0 < found.objective < monitor.history[0]["cost"]


def test_a_second_interrupt_gets_through():
    monitor = Monitor()
    with pytest.raises(KeyboardInterrupt), interruptible(monitor):
        signal.raise_signal(signal.SIGINT)
        assert monitor.interrupted == signal.SIGINT
        signal.raise_signal(signal.SIGINT)


def test_every_status_has_a_sentence():
    assert all(isinstance(status, Status) and len(text) > 10 for status, text in IPOPT_STATUS.values())


@pytest.mark.parametrize(("scheme", "order"), [("radau", lambda s: 2 * s - 1), ("legendre", lambda s: 2 * s)])
@pytest.mark.parametrize("stages", [1, 2, 3, 5])
def test_butcher_tables(scheme, order, stages):
    A, b, c = butcher_table(scheme, stages)
    for k in range(stages):
        np.testing.assert_allclose(A @ c**k, c ** (k + 1) / (k + 1), atol=1e-13)
    for k in range(order(stages)):
        assert b @ c**k == pytest.approx(1 / (k + 1), abs=1e-13)
    if scheme == "radau":
        np.testing.assert_allclose(A[-1], b, atol=1e-13)
    with pytest.raises(ValueError, match="schemes: radau, legendre"):
        butcher_table("euler", 1)
