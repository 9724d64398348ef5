"""Schedules and measurements that anyone wrote."""

import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from occontrol.api import write_run
from occontrol.core.errors import FileAccessError, ProblemError
from occontrol.core.measurement import Measurement
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.files.data_files import read_measurements, read_schedule
from occontrol.files.problem_file import read_problem
from occontrol.files.tables import write_measurements


def problem(select: int = 1, idle: bool = True, edges=None, windows=((0, 4), (4, 6), (7, 10))) -> SchedulingProblem:
    sensors = [
        Sensor("radar", [[1, 0], [0, 1]], np.eye(2), windows=windows),
        Sensor("doppler", [[0, 1]], 0.4),
        Sensor("Kamera 2", [[1, 1]], 0.4),
    ]
    return SchedulingProblem(
        name="p",
        plant=LinearPlant(A=-np.eye(2), noise=np.eye(2), covariance=np.eye(2)),
        sensors=[*sensors, *([idle_sensor(2)] if idle else [])],
        edges=np.linspace(0, 10, 21) if edges is None else edges,
        output=[[1, 0]],
        select=select,
    )


def written(folder: Path, text: str, name: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def words(function, *arguments) -> list[str]:
    with pytest.raises(ProblemError) as error:
        function(*arguments)
    return [line for line in str(error.value).split("\n") if not line.startswith("  hint")]


def test_csv_on_the_grid_and_beside_it(tmp_path):
    text = "start,end,sensors\n0,3.3,radar\n3.3,5.5,doppler\n5.5,9.99,idle\n9.99,10,\n"
    p = problem()
    s = read_schedule(written(tmp_path, text, "s.csv"), p)
    assert np.array_equal(s.edges, np.sort([*p.edges, 3.3, 9.99]))
    assert [(x["start"], x["end"], x["sensors"]) for x in s.segments()] == [
        (0, 3.3, ["radar"]),
        (3.3, 5.5, ["doppler"]),
        (5.5, 10, ["idle"]),
    ]
    assert s.names == tuple(p.sensors.names) and np.all(s.weights.sum(axis=1) == 1)


def test_order_of_lines_and_rounding_on_paper_do_not_matter(tmp_path):
    p = problem(edges=np.linspace(0, 10 / 3, 8))
    text = "Start, End, Sensors\r\n1.0000002,3.333333,doppler\r\n\r\n0,1,radar\r\n"
    s = read_schedule(written(tmp_path, "\ufeff" + text, "s.csv"), p)
    assert s.edges[-1] == 10 / 3 and 1.0 in s.edges and 1.0000002 not in s.edges
    assert s.segments()[1]["sensors"] == ["doppler"] and len(s.edges) == 9


def test_a_switch_at_an_edge_up_to_rounding_is_at_that_edge(tmp_path):
    p = problem(edges=np.linspace(0, 10, 101))
    s = read_schedule(written(tmp_path, "start,end,sensors\n0,0.3,radar\n0.3,10,doppler\n", "s.csv"), p)
    assert np.array_equal(s.edges, p.edges)


def test_select_two_and_idle(tmp_path):
    text = "start,end,sensors\n0,2,radar;doppler\n2,4,doppler\n4,5,idle\n5,6,idle;radar\n6,10, doppler ; Kamera 2 \n"
    s = read_schedule(written(tmp_path, text, "s.csv"), problem(select=2))
    rows = s.weights[np.searchsorted(s.edges, [1, 3, 4.5, 5.5, 8]) - 1]
    assert rows.tolist() == [[1, 1, 0, 0], [0, 1, 0, 1], [0, 0, 0, 2], [1, 0, 0, 1], [0, 1, 1, 0]]


def test_json_list_dict_and_fractions(tmp_path):
    p = problem()
    segments = [
        {"start": 0, "end": 5.25, "sensors": ["radar", "doppler"], "weights": [0.25, 0.75]},
        {"start": 5.25, "end": 10.0, "sensors": "doppler"},
    ]
    for content in (segments, {"schedule": segments, "cost": 3}):
        s = read_schedule(written(tmp_path, json.dumps(content), "s.json"), p)
        assert np.array_equal(s.weights[0], [0.25, 0.75, 0, 0]) and np.array_equal(s.weights[-1], [0, 1, 0, 0])
        assert 5.25 in s.edges and len(s.edges) == len(p.edges) + 1


def test_a_run_folder_and_its_result_give_the_schedule_back(tmp_path):
    p = problem()
    rng = np.random.default_rng(1)
    weights = np.zeros((p.intervals, 4))
    weights[:, 1:] = rng.dirichlet([1, 1, 1], size=p.intervals)
    schedule = Schedule(p.edges, weights, tuple(p.sensors.names))
    solution = Solution(
        family="athans",
        method="relaxed",
        status=Status.FEASIBLE,
        message="",
        iterations=1,
        seconds=0.0,
        result={"cost": 1.0, "lower_bound": 0.5, "schedule": schedule.segments()},
        arrays={"times": p.edges, "edges": p.edges, "weights": weights},
        schedule=schedule,
    )
    write_run(tmp_path / "run", p, solution)
    back = read_schedule(tmp_path / "run", p)
    assert np.array_equal(back.edges, p.edges) and np.allclose(back.weights, weights, rtol=0, atol=1e-15)
    listed = read_schedule(tmp_path / "run" / "result.json", p)
    assert np.allclose(listed.weights, weights, rtol=0, atol=2e-6)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("0,5,doppler\n5.1,10,doppler", ["3: nothing is scheduled between t = 5 and 5.1"]),
        ("0,5,doppler\n4.9,10,doppler", ["3: the segment starts at 4.9, but the one before it ends at 5"]),
        ("1,10,doppler", ["2: nothing is scheduled between t = 0 and 1"]),
        ("0,9,doppler", ["2: nothing is scheduled between t = 9 and 10"]),
        ("-1,10,doppler", ["2: the segment starts at -1, the horizon at 0"]),
        ("0,11,doppler", ["2: the segment ends at 11, the horizon at 10"]),
        ("0,5,doppler\n5,5,doppler\n5,10,doppler", ["3: the segment ends at 5, which is not after its start 5"]),
        ("0,10,dopler", ["2: there is no sensor 'dopler'"]),
        ("0,10,doppler;Kamera 2", ["2: 2 sensors are named, but select is 1"]),
        ("0,10,doppler;doppler", ["2: sensor 'doppler' is named twice"]),
        ("0,7,radar\n7,10,doppler", ["2: sensor 'radar' is used from 0 to 7, outside its windows"]),
        ("0,ten,doppler", ["2: end is 'ten', it must be a finite number"]),
        ("0,inf,doppler", ["2: end is 'inf', it must be a finite number"]),
        ("0,1_0,doppler", ["2: end is '1_0', it must be a finite number"]),
        ("0,10,doppler,radar", ["2: the line has 4 fields, not 3"]),
        ("0,5,doppler\n5", ["3: the line has 1 fields"]),
        ("", [" the schedule has no segment"]),
        (
            "0,3,dopler\n4,10,radar",
            [
                "2: there is no sensor 'dopler'",
                "3: nothing is scheduled between t = 3 and 4",
                "3: sensor 'radar' is used from 4 to 10, outside its windows",
            ],
        ),
    ],
)
def test_schedules_that_are_refused(tmp_path, lines, expected):
    path = written(tmp_path, "start,end,sensors\n" + lines + "\n", "s.csv")
    assert words(read_schedule, path, problem()) == [f"{path}:{line}" for line in expected]


def test_choices_in_discrete_time_last_until_the_next_one(tmp_path):
    p = read_problem(Path(__file__).parents[2] / "problems" / "oshman_example.yaml")
    names = list(p.sensors.names)
    records = [{"epoch": i, "k": int(k), "sensors": [names[i % 3]]} for i, k in enumerate(p.starts[:-1])]
    from_json = read_schedule(written(tmp_path, json.dumps({"schedule": records}), "s.json"), p)
    rows = [f"{a},{b},{names[i % 3]}" for i, (a, b) in enumerate(pairwise(p.starts))]
    from_csv = read_schedule(written(tmp_path, "\n".join(["start,end,sensors", *rows]), "s.csv"), p)
    for s in (from_json, from_csv):
        assert np.array_equal(s.edges, p.starts) and np.array_equal(s.weights, np.eye(3)[np.arange(12) % 3])


def test_without_idle_all_places_are_filled(tmp_path):
    path = written(tmp_path, "start,end,sensors\n0,5,\n5,10,doppler\n", "s.csv")
    assert words(read_schedule, path, problem(idle=False)) == [f"{path}:2: 0 sensors are named, but select is 1"]
    path = written(tmp_path, "start,end,sensors\n0,10,doppler\n", "s.csv")
    assert words(read_schedule, path, problem(2, False)) == [f"{path}:2: 1 sensor is named, but select is 2"]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{}", "1:1: there is no 'schedule'"),
        ("7", "1:1: this is not a schedule"),
        ('[{"start": 0, "end": 10}]', "1:2: segment 1 has no 'sensors'"),
        ('[\n {"start": 0, "end": NaN, "sensors": []}]', "2:22: end is not a number, it must be a finite number"),
        ('[{"start": 0, "end": 1e400, "sensors": []}]', "1:22: end is infinite, it must be a finite number"),
        ('[{"start": 0, "end": true, "sensors": []}]', "1:22: end is true, it must be a finite number"),
        ('[{"start": 0, "end": 10, "sensors": [3]}]', "1:37: sensors is not a list of names"),
        ('[{"start": 0, "end": 10, "sensors": ["radar"], "weights": [1, 2]}]', "1:59: 2 weights for 1 sensors"),
        (
            '[\n{"start": 0, "end": 10, "sensors": ["doppler"], "weights": [1.5]}]',
            "2:1: the weight of sensor 'doppler' is 1.5",
        ),
        (
            '[{"start": 0, "end": 10, "sensors": ["doppler"], "weights": [-0.5]}]',
            "1:2: the weight of sensor 'doppler' is -0.5",
        ),
        ('[{"start": 0, "end": 10, "sensors": ["rader"]}]', "1:2: there is no sensor 'rader'"),
        ('[{"start": 0, "end": 10,]', "1:25: this is not JSON"),
    ],
)
def test_json_schedules_that_are_refused(tmp_path, content, expected):
    path = written(tmp_path, content, "s.json")
    assert words(read_schedule, path, problem())[0].startswith(f"{path}:{expected}")


def test_weights_that_do_not_add_up(tmp_path):
    content = [{"start": 0, "end": 10, "sensors": ["doppler"], "weights": [0.5]}]
    path = written(tmp_path, json.dumps(content), "s.json")
    assert words(read_schedule, path, problem(idle=False)) == [
        f"{path}:1:2: the weights add up to 0.5, but select is 1"
    ]
    assert read_schedule(path, problem()).weights[0].tolist() == [0, 0.5, 0, 0.5]


def test_files_that_are_no_schedules(tmp_path):
    with pytest.raises(FileAccessError):
        read_schedule(tmp_path / "none.csv", problem())
    with pytest.raises(FileAccessError):
        read_schedule(tmp_path / "none.xls", problem())
    path = written(tmp_path, "x", "s.xls")
    assert words(read_schedule, path, problem()) == [f"{path}: the file name ends in '.xls'"]
    path = written(tmp_path, "t,sensor\n", "s.csv")
    assert words(read_schedule, path, problem()) == [f"{path}:1: the first line is 't,sensor'"]
    (tmp_path / "b.csv").write_bytes(b"\x00\x01")
    assert words(read_schedule, tmp_path / "b.csv", problem()) == [
        f"{tmp_path}/b.csv:1:1: this is binary data, not a schedule"
    ]


def test_a_long_schedule_reads_in_a_moment(tmp_path):
    import time

    edges = np.linspace(0, 10, 20_001)
    rows = "".join(
        f"{a!r},{b!r},{'doppler' if k % 2 else 'idle'}\n" for k, (a, b) in enumerate(pairwise(edges.tolist()))
    )
    path = written(tmp_path, "start,end,sensors\n" + rows, "s.csv")
    start = time.process_time()
    s = read_schedule(path, problem(edges=np.linspace(0, 10, 5001)))
    assert time.process_time() - start < 5 and s.switches == 19_999


def test_measurements_there_and_back(tmp_path):
    rng = np.random.default_rng(0)
    given = [
        Measurement(0.5, "radar", rng.normal(size=2)),
        Measurement(0.5, "doppler", rng.normal(size=1)),
        Measurement(1.0 / 3.0 + 1, "radar", np.array([math.nan, 1.0])),
        Measurement(2.0, "Kamera 2", np.array([math.nan])),
    ]
    back = read_measurements(write_measurements(tmp_path / "z.csv", given), problem())
    assert [(m.time, m.sensor) for m in back] == [(m.time, m.sensor) for m in given]
    assert all(np.array_equal(a.values, b.values, equal_nan=True) for a, b in zip(given, back, strict=True))
    assert [m.line for m in back] == [2, 3, 4, 5]


def test_measurements_in_any_order_with_gaps(tmp_path):
    text = "t,sensor,z1,z2\n2,doppler,0.25,\n1,radar,1,nan\n3,radar,,\n4,idle,,\n5,doppler\n"
    ms = read_measurements(written(tmp_path, text, "z.csv"), problem())
    assert [(m.time, m.sensor, m.values.tolist()) for m in ms[:2]][1] == (2, "doppler", [0.25])
    assert ms[0].values[0] == 1 and math.isnan(ms[0].values[1])
    assert np.all(np.isnan(ms[2].values)) and ms[2].values.shape == (2,)
    assert ms[3].values.shape == (0,) and ms[4].values.shape == (1,) and math.isnan(ms[4].values[0])


def test_measurements_that_are_refused(tmp_path):
    lines = ["1,radr,1,2", "2,doppler,1,2", "x,radar,1,2", "4,radar,1e999,two", "5,radar,1,2,3", *["6,radar,1,2"] * 2]
    path = written(tmp_path, "\n".join(["t,sensor,z1,z2", *lines]), "z.csv")
    assert words(read_measurements, path, problem()) == [
        f"{path}:2: there is no sensor 'radr'",
        f"{path}:3: sensor 'doppler' has 1 values, the line has 2",
        f"{path}:4: t is 'x', it must be a finite number",
        f"{path}:5: z1 is '1e999', it must be a finite number",
        f"{path}:5: z2 is 'two', it must be a finite number",
        f"{path}:6: the line has 3 values, the header names 2",
        f"{path}:8: a second sample of sensor 'radar' at t = 6",
    ]
    path = written(tmp_path, "t,sensor,z1\n7\n", "z.csv")
    assert words(read_measurements, path, problem()) == [f"{path}:2: the line has 1 fields"]
    path = written(tmp_path, "time;sensor;z1\n", "z.csv")
    assert words(read_measurements, path, problem()) == [f"{path}:1: the first line is 'time;sensor;z1'"]
    path = written(tmp_path, 't,sensor,z1\n1,"radar,2\n', "z.csv")
    assert words(read_measurements, path, problem())[0].startswith(f"{path}:2: this is not CSV")


def test_shares_of_a_relaxed_schedule_are_read_from_csv(small_file, tmp_path):
    import occontrol

    problem = occontrol.read_problem(small_file)
    path = tmp_path / "shares.csv"
    path.write_text("start,end,sensors,weights\n0,2,range;doppler,0.25;0.75\n2,4,doppler,\n")
    schedule = occontrol.read_schedule(path, problem)
    np.testing.assert_allclose(schedule.weights[0], [0.25, 0.75, 0])
    np.testing.assert_allclose(schedule.weights[-1], [0, 1, 0])
    path.write_text("start,end,sensors,weights\n0,4,range;doppler,0.25\n")
    with pytest.raises(ProblemError, match="1 weights for 2 sensors"):
        occontrol.read_schedule(path, problem)
