"""filter RUN -: a line in, a line out, and the numbers of the filter over a file."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from occontrol.api import family_of, read_problem, read_run, run_filter, simulate, write_run
from occontrol.api.stream import filter_stream
from occontrol.cli import run
from occontrol.core.errors import UsageError


@pytest.fixture
def folder(tmp_path: Path, small_solution) -> Path:
    write_run(tmp_path / "run", small_solution.problem, small_solution)
    return tmp_path / "run"


def lines_of(samples) -> list[str]:
    by_time: dict[float, dict] = {}
    for s in samples:
        values = [None if np.isnan(v) else float(v) for v in np.atleast_1d(s.values)]
        by_time.setdefault(float(s.time), {})[s.sensor] = values
    return [json.dumps({"t": t, "readings": readings}) for t, readings in sorted(by_time.items())]


@pytest.mark.parametrize("name", ["small", "radar_discrete", "oshman_example", "survey_panel"])
def test_it_is_the_filter_over_a_file(name: str, solved, small_solution) -> None:
    solution = small_solution if name == "small" else solved(name)
    problem = solution.problem
    samples = simulate(problem, solution, 4)[0]
    del samples[5:7]  # lost: the next line jumps over them
    want = run_filter(problem, solution, samples)
    answers = list(filter_stream(problem, solution, [*lines_of(samples), "\n"]))
    at = {t: i for i, t in enumerate(want.times)}
    for answer in answers:
        i = at[answer["t"]]
        assert answer["estimate"] == want.mean[i].tolist()
        assert np.allclose(answer["deviation"], want.standard_deviation[i], rtol=1e-12, atol=0)
        assert answer["nis"] is None or answer["nis"] == want.nis[i]
        assert answer.get("predicted", []) == want.predicted[i].tolist()
    assert answers[-1]["next_t"] is None or answers[-1]["next_t"] > answers[-1]["t"]


def test_one_answer_a_line_at_once(folder: Path) -> None:
    """The process answers before its input ends."""
    command = [sys.executable, "-m", "occontrol", "filter", str(folder), "-"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write("{}\n")
        process.stdin.flush()
        first = json.loads(process.stdout.readline())
        assert first == {"next_sensors": first["next_sensors"], "next_t": 0.1}
        process.stdin.write(json.dumps({"readings": {name: [0.1] for name in first["next_sensors"]}}) + "\n")
        process.stdin.flush()
        second = json.loads(process.stdout.readline())
        assert second["t"] == 0.1 and second["planned"] is True
        process.stdin.close()
        assert process.wait() == 0


@pytest.mark.parametrize(
    "line, said",
    [
        ("x", "the line is not one JSON object"),
        ("[1]", "the line is not one JSON object"),
        ('{"time": 1}', "there is no key 'time'"),
        ('{"t": "1"}', "t is not a number"),
        ('{"t": true}', "t is not a number"),
        ('{"t": 0.13}', "no values arrive at t = 0.13\n  hint: the nearest times from here on: 0.1 and 0.2"),
        ('{"t": 0.1, "t": 0.2}', "'t' stands twice in the line"),
        ('{"readings": [1]}', "readings is not an object of sensors"),
        ('{"readings": {"range": "1"}}', "the values of sensor 'range' are not numbers or null"),
        ('{"readings": {"range": [NaN]}}', "NaN is no number of JSON"),
        ('{"readings": {"nobody": [1]}}', "sensor 'nobody' is not in use"),
        ("[" * 100000, "the line is not one JSON object"),
    ],
)
def test_a_line_that_is_refused_is_answered_and_the_next_one_counts(
    line: str, said: str, folder: Path, capsys, monkeypatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(f'{line}\n{{"t": 0.1}}\n'))
    assert run(["filter", str(folder), "-"]) == 3
    error, answer = map(json.loads, capsys.readouterr().out.splitlines())
    assert said in error["error"] and error["line"] == 1
    assert answer["t"] == 0.1


def test_after_the_end(folder: Path) -> None:
    problem, solution = read_run(folder)
    answers = list(filter_stream(problem, solution, ['{"t": 4}', "{}", '{"t": 4.1}', "{}"]))
    assert answers[0]["next_t"] is None and answers[0]["next_sensors"] == []
    assert answers[1] == answers[0] == answers[3] and answers[2]["error"] == "the horizon is over"


def test_refusals(folder: Path, solved, capsys) -> None:
    assert run(["filter", str(folder), "-", "--out", "x.csv"]) == 2
    assert run(["filter", str(folder), "x.csv"]) == 2
    text = capsys.readouterr().err
    assert "with - the answers go to standard output" in text and "a file is needed for the estimates" in text
    solution = solved("oshman_example")
    with pytest.raises(UsageError, match="the filter of family vlambda has no gate"):
        list(filter_stream(solution.problem, solution, [], gate=0.9))
    hybrid = read_problem(Path(__file__).parents[2] / "problems" / "guarded_thermostat.yaml")
    with pytest.raises(UsageError, match="family hybrid cannot run on line"):
        list(filter_stream(hybrid, solution, []))


def test_a_set_of_possible_states_slot_by_slot(solved) -> None:
    solution = solved("robust_oscillator")
    loop = family_of(solution.problem).online(solution.problem, solution)
    answers = list(filter_stream(solution.problem, solution, ["{}", '{"readings": {}}']))
    assert set(answers[0]["next_sensors"]) <= set(solution.problem.sensors.names)
    done = loop.step({})
    assert answers[1]["estimate"] == done.estimate.tolist() and answers[1]["level"] == done.level
    assert answers[1]["nis"] is None and answers[1]["t"] == answers[0]["next_t"]
