"""Athans' methods as values: options that make no sense, limits that stay their own, and a method from outside."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from occontrol.api import certify, solve
from occontrol.core.errors import ProblemError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Status
from occontrol.families.athans.family import FAMILY
from occontrol.families.athans.found import Found
from occontrol.families.athans.methods import (
    METHODS,
    BestSingle,
    Collocation,
    Greedy,
    HMinimal,
    Random,
    Relaxed,
    RelaxRoundPolish,
    RoundRobin,
)
from occontrol.scheduling.baselines import round_robin
from tests.families.athans.random_problems import random_problem


@pytest.mark.parametrize(("kind", "options", "words"), [
    (Relaxed, {"relative_gap": -1.0}, "relative_gap of method relaxed is -1.0\n  hint: a number above 0"),
    (Relaxed, {"relative_gap": 0.0}, "relative_gap of method relaxed is 0.0"),
    (Relaxed, {"relative_gap": float("nan")}, "relative_gap of method relaxed is nan"),
    (Relaxed, {"max_iterations": -5}, "max_iterations of method relaxed is -5\n  hint: a whole number of at least 1"),
    (RelaxRoundPolish, {"relative_gap": -1.0}, "relative_gap of method schedule is -1.0"),
    (RelaxRoundPolish, {"max_iterations": 0}, "max_iterations of method schedule is 0"),
    (RelaxRoundPolish, {"polish": -1}, "polish of method schedule is -1\n  hint: a whole number of at least 0"),
    (RelaxRoundPolish, {"time_limit": -2.0}, "time_limit of method schedule is -2.0"),
    (HMinimal, {"relative_gap": 0}, "relative_gap of method hminimal is 0"),
    (HMinimal, {"max_iterations": 0}, "max_iterations of method hminimal is 0"),
    (HMinimal, {"tolerance": -1.0}, "tolerance of method hminimal is -1.0"),
    (HMinimal, {"start": "best"}, "start of method hminimal is 'best'\n  hint: one of: best-single, round-robin"),
    (Collocation, {"scheme": "euler"}, "scheme of method collocation is 'euler'\n  hint: one of: radau, legendre"),
    (Collocation, {"stages": 0}, "stages of method collocation is 0"),
    (Collocation, {"max_iterations": 0}, "max_iterations of method collocation is 0"),
    (BestSingle, {"relative_gap": -1}, "relative_gap of method best-single is -1"),
    (RoundRobin, {"dwell": 0}, "dwell of method round-robin is 0\n  hint: a whole number of at least 1"),
    (RoundRobin, {"dwell": -3}, "dwell of method round-robin is -3"),
    (Random, {"seed": -1}, "seed of method random is -1"),
    (Greedy, {"relative_gap": "x"}, "relative_gap of method greedy is 'x'"),
])  # fmt: skip
def test_options_that_no_problem_can_make_sense_of_are_refused(kind, options, words):
    with pytest.raises(ProblemError) as refused:
        kind(**options)
    assert words in str(refused.value)
    with pytest.raises(ProblemError):
        replace(kind(), **options)


@pytest.mark.parametrize("kind", METHODS.values(), ids=lambda kind: kind.name)
def test_every_method_is_one(kind):
    method = kind()
    assert isinstance(method, Method)
    assert list(method.check(random_problem(1))) == []


@dataclass(frozen=True)
class Boastful:
    """A method from outside: a policy with a bound that is not one."""

    name: ClassVar[str] = "boastful"
    bound: float = 1e6
    relative_gap: float = 1e-4

    def check(self, problem):
        return ()

    def run(self, problem, sweep, feasible_set, monitor):
        return Found(round_robin(sweep.recursion, feasible_set), 1, Status.CERTIFIED, bound=self.bound)


def test_a_toy_method_needs_no_other_file_and_its_false_bound_is_found_out():
    problem = random_problem(2)
    honest = FAMILY.solve(problem, Boastful(0.0), Monitor())
    assert honest.method == "boastful" and honest.status is Status.FEASIBLE
    assert honest.cost == solve(problem, RoundRobin()).cost
    caught = FAMILY.solve(problem, Boastful(), Monitor())
    assert caught.status is Status.DISAGREES
    assert "the lower bound 1000000 lies above the cost" in caught.message
    assert caught.result["lower_bound"] == 1e6  # shown, not hidden


def test_the_time_limit_of_one_method_does_not_leak_to_the_next():
    problem = random_problem(5, states=4, sensors=5, intervals=60)
    monitor = Monitor()
    first = solve(problem, RelaxRoundPolish(relative_gap=1e-12, time_limit=1e-9), monitor)
    assert first.status is Status.LIMIT
    assert monitor.time_limit is None and not monitor.stop
    second = solve(problem, Relaxed(), monitor)
    assert second.status is Status.CERTIFIED
    assert second.cost == solve(problem, Relaxed()).cost
    # each has the history of its own, by its own clock
    assert second.history[0]["iteration"] == 0 and second.history[0]["seconds"] <= second.seconds
    assert len(second.history) < len(monitor.history)


def test_a_monitors_own_limit_is_tighter_than_the_methods():
    problem = random_problem(5, states=4, sensors=5, intervals=60)
    stopped = solve(problem, Relaxed(relative_gap=1e-13, time_limit=1000.0), Monitor(time_limit=0.0))
    assert stopped.status is Status.LIMIT and stopped.iterations == 0


@pytest.mark.parametrize(("row", "words"), [
    ([1.0, 1.0, 0.0], ": 2 sensors are named, but select is 1"),
    ([5.0, 5.0, 0.0], ": the weight of sensor 's0' is 5, it must lie between 0 and 1"),
    ([0.4, 0.0, 0.0], ": the weights add up to 0.4, but select is 1"),
])  # fmt: skip
def test_a_schedule_that_the_problem_does_not_allow_is_not_certified(row, words):
    problem = random_problem(3)
    with pytest.raises(ProblemError) as refused:
        certify(problem, Schedule(problem.edges, np.tile(row, (8, 1)), ("s0", "s1", "s2")))
    assert str(refused.value).startswith(f"t = 0 .. {problem.edges[-1]:.12g}{words}")


def test_use_outside_a_window_is_not_certified():
    problem = random_problem(3, windows=True)
    with pytest.raises(ProblemError) as refused:
        certify(problem, Schedule(problem.edges, np.tile([1.0, 0.0, 0.0], (8, 1)), ("s0", "s1", "s2")))
    used = f"sensor 's0' is used from 0 to {problem.edges[-1]:g}, outside its windows\n  hint: its windows: [0, "
    assert used in str(refused.value)
