"""The scheduling problem built in Python says no in the same words."""

import numpy as np
import pytest

from occontrol.core.errors import InfeasibleError, ProblemError
from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import Sensor, SensorSuite, idle_sensor
from occontrol.families.athans.problem import SchedulingProblem


def make(**changes) -> SchedulingProblem:
    plant = LinearPlant(A=[[0, 1], [0, 0]], noise=np.eye(2), covariance=np.eye(2))
    keys = dict(name="p", plant=plant, sensors=[Sensor("a", [[1, 0]], 1), Sensor("b", [[0, 1]], 1)])
    return SchedulingProblem(**{**keys, "edges": [0, 1, 3], "output": [[1, 0]], **changes})


def paths(**changes) -> list[tuple]:
    with pytest.raises(ProblemError) as error:
        make(**changes)
    return [m.path for m in error.value.mistakes]


def test_defaults():
    p = make()
    assert (p.predict_at, p.select, p.intervals, p.states) == (3.0, 1, 2, 2) and isinstance(p.sensors, SensorSuite)


@pytest.mark.parametrize("edges", [[], [1], [1, 1], [2, 1], [0, np.nan], [0, np.inf], [[0, 1]], 3.0])
def test_horizons_that_are_none(edges):
    assert paths(edges=edges) == [("horizon",)]


def test_all_mistakes_at_once():
    wrong = paths(
        edges=[3, 1],
        cost_weight=-1,
        output=[[1, 0, 0]],
        running=[[1, 2], [2, 1]],
        sensors=[Sensor("a", [[1]], 1), Sensor("b", [[0, 1]], [[0]], cost=-1)],
        select=5,
    )
    assert wrong == [
        ("horizon",),
        ("objective", "cost_weight"),
        ("sensors", 0, "C"),
        ("objective", "output"),
        ("select",),
        ("sensors", 1, "noise"),
        ("sensors", 1, "cost"),
        ("objective", "running"),
    ]
    assert paths(predict_at=2) == [("horizon", "predict_at")] == paths(predict_at=np.nan)


def test_the_plant_is_checked_up_to_the_time_of_prediction():
    plant = LinearPlant(A=[["1/(t-5)", 0], [0, 1]], noise=np.eye(2), covariance=np.eye(2))
    make(plant=plant)
    assert paths(plant=plant, predict_at=6) == [("plant", "A")]


def test_windows_that_touch_are_one():
    s = Sensor("a", 1, 1, windows=[(4, 6), (0, 4), (7, 9), (8, 12)])
    assert s.windows == ((0, 4), (4, 6), (7, 9), (8, 12))
    for start, end, inside in (
        (3, 5, 1),
        (0, 6, 1),
        (0, 6.1, 0),
        (6, 7, 0),
        (6.5, 8, 0),
        (7, 12, 1),
        (8.5, 11, 1),
        (12, 13, 0),
    ):
        assert s.available(start, end) == bool(inside), (start, end)


@pytest.mark.parametrize(("select", "feasible"), [(1, True), (2, False)])
def test_feasible_where_enough_sensors_are_available(select, feasible):
    sensors = [Sensor("a", [[1, 0]], 1), Sensor("b", [[0, 1]], 1, windows=[(0, 1)])]
    p = make(sensors=sensors, select=select)
    if feasible:
        p.require_feasible()
    else:
        with pytest.raises(InfeasibleError, match="between t = 1 and 3 only 1 of the 2 sensors"):
            p.require_feasible()
    make(sensors=[*sensors, idle_sensor(2)], select=3).require_feasible()


@pytest.mark.parametrize("name", ["", " ", " a", "a;b", "a,b", "a\nb", 'a"b', "x" * 101, 3, None, "\x00"])
def test_names_that_do_not_fit_a_csv(name):
    with pytest.raises(ProblemError) as error:
        Sensor(name, 1, 1)
    assert error.value.mistakes[0].path == ("name",)


@pytest.mark.parametrize("name", ["radar", "Größe 1", "雷达", "a-b_c.d(1)", "O'Higgins"])
def test_names_that_do(name):
    assert Sensor(name, 1, 1).name == name
