"""Options that make no sense, methods of other families, and results as data."""

import dataclasses
import json
import pickle

import numpy as np
import pytest

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.result import PlainResult
from occontrol.core.solution import Status
from occontrol.families.athans.methods import HMinimal
from occontrol.families.family import Ability
from occontrol.families.precision.family import FAMILY
from occontrol.families.precision.methods import Barrier, ClarabelRoute, Uniform
from occontrol.families.precision.moments import Moments
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.program import solve_program
from occontrol.families.precision.result import PrecisionResult, numbers_of
from tests.families.precision.files import BASE, MOMENTS, load

SMALL = Moments(np.array([[2.0]]), np.array([[0.8, 0.5]]), np.array([[0.5, 0.2], [0.2, 0.4]]))


def small(**changes):
    return Problem(**{"name": "small", "moments": SMALL, "bound_factor": 0.7, **changes})


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        (Barrier, {"relative_gap": -1.0}, "relative_gap of method barrier is -1.0\n  hint: a number above 0"),
        (Barrier, {"relative_gap": 1.5}, "relative_gap of method barrier is 1.5\n  hint: between 0 and 1"),
        (Barrier, {"max_iterations": -5}, "max_iterations of method barrier is -5\n  hint: a whole number"),
        (ClarabelRoute, {"max_iterations": 2.5}, "max_iterations of method clarabel is 2.5"),
        (ClarabelRoute, {"form": "dual"}, "form of method clarabel is 'dual'\n  hint: one of: reduced, factor"),
        (ClarabelRoute, {"time_limit": 0}, "time_limit of method clarabel is 0\n  hint: a number above 0"),
    ],
)
def test_an_option_without_sense_is_refused_by_its_name(kind, options, words):
    with pytest.raises(ProblemError) as error:
        kind(**options)
    (mistake,) = error.value.mistakes
    assert mistake.path == (next(iter(options)),)
    assert f"{mistake.what}\n  hint: {mistake.hint}".startswith(words)


def test_a_wrong_option_in_a_file_is_refused_at_its_place(tmp_path):
    with pytest.raises(ProblemError, match=r"p\.yaml:4:32: form of method clarabel is 'dual'"):
        load(tmp_path, MOMENTS + "method: {name: clarabel, form: dual}\n")


def test_every_method_is_one_by_the_contract_and_runs_itself():
    program = small().program(SMALL)
    best = solve_program(program).objective
    for name, kind in FAMILY.methods.items():
        assert isinstance(kind(), Method) and kind.name == name
        found = kind().run(program, Monitor())
        assert found.objective >= best * (1 - 1e-9)
        assert (found.objective > best * 1.01) == (kind is Uniform)


def test_a_method_of_another_family_is_refused():
    with pytest.raises(UsageError, match="HMinimal of family athans is not a method of family precision"):
        FAMILY.solve(small(), HMinimal())
    with pytest.raises(UsageError, match="HMinimal of family athans is not a method of family precision"):
        FAMILY.solve(small(method=HMinimal()))
    with pytest.raises(UsageError, match="family precision has no method 'barier'\n  hint: did you mean 'barrier'"):
        FAMILY.solve(small(), "barier")


@pytest.mark.parametrize(
    ("text", "present", "absent"),
    [
        (MOMENTS, {"objective", "cost", "precisions", "active_sensors"}, {"batches", "pruning", "infeasible_batch"}),
        (BASE, {"objective", "lower_bound", "margin"}, {"batches", "rms_error", "preventing_direction"}),
        (BASE + "batches: 2\n", {"batches", "rms_error"}, {"active_sensors", "pruning"}),
        (BASE + "prune: true\n", {"pruning", "active_sensors"}, {"batches"}),
        (BASE + "prune: true\nbatches: 2\n", {"batches"}, {"pruning"}),
        (BASE.replace("50", "0.1"), {"preventing_direction", "infeasible_batch"}, {"objective", "cost", "batches"}),
    ],
)
def test_a_result_is_frozen_data_and_reads_back(tmp_path, text, present, absent):
    problem = load(tmp_path, text)
    found = FAMILY.solve(problem)
    numbers = found.numbers
    assert type(numbers) is FAMILY.result_type and found.result == numbers.as_dict()
    assert present <= set(found.result) and not absent & set(found.result)
    with pytest.raises(dataclasses.FrozenInstanceError):
        numbers.route = ""
    written = json.loads(json.dumps(numbers.as_dict()))
    again = PrecisionResult.from_dict(written)
    assert again.as_dict() == written and list(again.as_dict()) == list(found.result)
    bare = dataclasses.replace(found, numbers=PlainResult(dict(found.result)))  # as read from a folder
    assert FAMILY.summarise(problem, bare) == FAMILY.summarise(problem, found)
    assert set(FAMILY.figures(problem, bare)) == set(FAMILY.figures(problem, found))
    assert pickle.loads(pickle.dumps(numbers)).as_dict() == written
    if numbers.batches is not None:
        last = numbers_of(bare).batches[-1]
        assert last.guarantee and (last.pruning is not None) == ("prune" in text)


def test_the_time_limit_of_a_method_stays_with_it(tmp_path):
    problem, monitor = load(tmp_path, BASE + "batches: 3\n"), Monitor()
    found = FAMILY.solve(problem, Barrier(time_limit=1e-9), monitor)
    assert found.status is Status.LIMIT
    assert monitor.time_limit is None and not monitor.timed_out
    assert FAMILY.solve(problem, Barrier(), monitor).status is Status.CERTIFIED


def test_the_family_declares_what_it_can():
    assert not FAMILY.can(Ability.CERTIFY)
    with pytest.raises(UsageError, match="family precision cannot certify schedules"):
        FAMILY.certify(small(), None)
    with pytest.raises(UsageError, match="family precision cannot run on line"):
        FAMILY.online(small())
