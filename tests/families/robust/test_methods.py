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
from occontrol.core.sensor import Sensor
from occontrol.families.athans.methods import Random as RandomOfAthans
from occontrol.families.family import Ability
from occontrol.families.robust.family import FAMILY
from occontrol.families.robust.methods import All, Fixed, Optimal, Random, RelaxedShares
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.result import (
    SequenceResult,
    SharesResult,
    SwitchingResult,
    UnobservableResult,
    numbers_of,
)


def oscillator(gain=1.0, **changes):
    plant = UncertainPlant([[0, 1], [-1, -0.4]], [[0], [1]], [[0.5 * gain, 0.2 * gain]], np.diag([2.0, 1.0]))
    sensors = [Sensor("one", [[1, 0]], [[1]]), Sensor("two", [[0, 1]], [[1]])]
    return Problem(**{"name": "osc", "plant": plant, "sensors": sensors, "edges": np.linspace(0, 2, 5), **changes})


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        (Optimal, {"relative_gap": -1.0}, "relative_gap of method optimal is -1.0\n  hint: a number of at least 0"),
        (Optimal, {"node_limit": 0}, "node_limit of method optimal is 0\n  hint: a whole number of at least 1"),
        (Optimal, {"width": 2.5}, "width of method optimal is 2.5\n  hint: a whole number of at least 1"),
        (Optimal, {"time_limit": 0}, "time_limit of method optimal is 0\n  hint: a number above 0"),
        (RelaxedShares, {"relative_gap": float("nan")}, "relative_gap of method relaxed is nan"),
        (All, {"limit": True}, "limit of method all is True"),
        (Random, {"seed": -1}, "seed of method random is -1\n  hint: a whole number of at least 0"),
    ],
)
def test_an_option_without_sense_is_refused_by_its_name(kind, options, words):
    with pytest.raises(ProblemError) as error:
        kind(**options)
    (mistake,) = error.value.mistakes
    assert mistake.path == (next(iter(options)),)
    assert f"{mistake.what}\n  hint: {mistake.hint}".startswith(words)


def test_every_method_is_one_by_the_contract():
    for name, kind in FAMILY.methods.items():
        assert isinstance(kind(), Method) and kind.name == name
        assert kind.__dataclass_params__.frozen


def test_a_method_of_another_family_is_refused_even_with_the_same_name():
    with pytest.raises(UsageError, match="Random of family athans is not a method of family robust"):
        FAMILY.solve(oscillator(), RandomOfAthans())
    with pytest.raises(UsageError, match="Random of family athans is not a method of family robust"):
        FAMILY.solve(oscillator(method=RandomOfAthans()))
    with pytest.raises(UsageError, match="family robust has no method 'newton'"):
        FAMILY.solve(oscillator(), "newton")


def test_options_that_do_not_fit_the_problem_are_refused_with_it():
    with pytest.raises(ProblemError, match=r"method\.sequence\[1\]: there is no sensor 'three'"):
        oscillator(method=Fixed(["one", "three", "two", "one"]))
    with pytest.raises(ProblemError, match=r"method: method all would rank 2\^4 sequences, its limit is 15"):
        oscillator(method=All(limit=15))
    assert FAMILY.solve(oscillator(method=All(limit=16))).result["sequences"] == 16


@pytest.mark.parametrize(
    ("gain", "method", "kind"),
    [
        (1.0, "optimal", SequenceResult),
        (1.0, "all", SequenceResult),
        (1.0, "relaxed", SharesResult),
        (9.0, "optimal", UnobservableResult),
        (9.0, "round-robin", UnobservableResult),
    ],
)
def test_a_result_is_frozen_data_and_reads_back(gain, method, kind):
    found = FAMILY.solve(oscillator(gain), method)
    numbers = found.numbers
    assert type(numbers) is kind and isinstance(numbers, FAMILY.result_type)
    assert found.result == numbers.as_dict()
    with pytest.raises(dataclasses.FrozenInstanceError):
        numbers.cost = 0.0
    written = json.loads(json.dumps(numbers.as_dict()))
    again = SwitchingResult.from_dict(written)
    assert type(again) is kind and again.as_dict() == written and list(again.as_dict()) == list(found.result)
    bare = dataclasses.replace(found, numbers=PlainResult(dict(found.result)))  # as read from a folder
    assert type(numbers_of(bare)) is kind
    assert FAMILY.summarise(oscillator(gain), bare) == FAMILY.summarise(oscillator(gain), found)
    assert pickle.loads(pickle.dumps(numbers)).as_dict() == numbers.as_dict()
    assert ("escape_time" in written) == (gain > 1 and method == "round-robin")


def test_the_time_limit_of_a_method_stays_with_it():
    monitor = Monitor()
    found = FAMILY.solve(oscillator(), Optimal(time_limit=1e-9), monitor)
    assert monitor.time_limit is None and not monitor.timed_out
    assert found.result["lower_bound"] <= FAMILY.solve(oscillator(), Optimal(), monitor).cost <= found.cost


def test_the_family_declares_what_it_can():
    assert not FAMILY.can(Ability.TRADEOFF)
    with pytest.raises(UsageError, match="family robust cannot trade observation cost against prediction error"):
        FAMILY.tradeoff(oscillator(), [1.0], None)
    assert FAMILY.compare_names(oscillator())[0] == "optimal"
    assert FAMILY.online(oscillator()).sensor is not None
