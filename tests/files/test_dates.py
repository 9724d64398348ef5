"""Dates in problem files, schedules and measurements: exact times, the column utc, and what is refused."""

from __future__ import annotations

import csv
import json
from datetime import UTC, datetime, timedelta, timezone
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import document
from occontrol.cli import run
from occontrol.core.calendar import Calendar
from occontrol.core.errors import ProblemError
from occontrol.core.state_labels import state_labels

PLAIN = """
family: athans
horizon: {HORIZON}
plant: {A: [[0, 1], [0, -0.4]], noise: {diag: [0, 0.5]}, initial: {covariance: {diag: [5, 5]}}}
sensors:
  - {name: range, C: [[1, 0]], noise: [[0.1]], windows: WINDOWS}
  - idle
objective: {cost_weight: 0.01, output: [[1, 0]]}
"""
NUMBERS = PLAIN.replace("{HORIZON}", "{end: 3, intervals: 12, predict_at: 4}").replace("WINDOWS", "[[0.5, 2]]")
DATED = PLAIN.replace(
    "{HORIZON}", "{date: 2026-03-01T12:00:00Z, unit: min, end: 2026-03-01T12:03:00Z, intervals: 12, predict_at: 4}"
).replace("WINDOWS", "[[2026-03-01T12:00:30Z, 2026-03-01T14:02+02:00]]")


def read(path: Path, text: str) -> oc.SchedulingProblem:
    path.write_text(text)
    return oc.read_problem(path)  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("date", "unit", "text", "t"),
    [
        ("2026-01-01T00:00:00Z", "s", "2026-01-01T00:18:43.25Z", 1123.25),
        ("2026-01-01T00:00:00Z", "d", "2026-03-01T12:00:00Z", 59.5),
        ("2024-02-28T00:00:00Z", "h", "2024-03-01T00:00:00+02:00", 46.0),
        ("2026-01-01T01:00:00+01:00", "min", "2025-12-31T23:59:30Z", -0.5),
        ("1970-01-01T00:00Z", "s", "2026-01-01T00:00:00.123456789Z", float(Fraction("1767225600.123456789"))),
    ],
)
def test_a_date_is_the_nearest_double(date: str, unit: str, text: str, t: float) -> None:
    assert Calendar(date, unit).time(text) == t


def test_dates_agree_with_datetime_and_come_back() -> None:
    calendar, zone = Calendar("2026-01-01T00:00:00Z", "s"), timezone(timedelta(hours=-3, minutes=-30))
    random = np.random.default_rng(5)
    for micro in random.integers(-(10**15), 10**15, size=200):
        moment = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(micro))
        t = calendar.time(moment.astimezone(zone).isoformat())
        assert t == float(Fraction(int(micro), 10**6))
        assert datetime.fromisoformat(calendar.utc(t)) == moment


def test_dates_in_a_problem_are_the_times_that_they_stand_for(tmp_path: Path) -> None:
    plain, dated = read(tmp_path / "n.yaml", NUMBERS), read(tmp_path / "d.yaml", DATED)
    assert np.array_equal(plain.edges, dated.edges) and plain.sensors[0].windows == dated.sensors[0].windows
    assert plain.predict_at == dated.predict_at and plain.calendar is None
    assert dated.calendar == Calendar("2026-03-01T12:00:00Z", "min")
    written = document(dated)
    assert written["horizon"]["date"] == "2026-03-01T12:00:00Z" and written["sensors"][0]["windows"] == [[0.5, 2.0]]
    assert dated.with_edges([(0.1, "test")]).calendar == dated.calendar


def rows(path: Path) -> list[list[str]]:
    return list(csv.reader(path.open()))


def test_a_day_of_work_with_dates_has_the_numbers_of_one_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in (("n", NUMBERS), ("d", DATED)):
        Path(f"{name}.yaml").write_text(text)
        assert run(["solve", f"{name}.yaml", "--no-figures"]) == 0
        assert run(["simulate", f"{name}.yaml", "--out", f"{name}.csv", "--seed", "3"]) == 0
        assert run(["filter", f"runs/{name}", f"{name}.csv", "--out", f"{name}e.csv", "--no-figures"]) == 0
        assert run(["export", f"runs/{name}", "--to", "csv", "--out", f"{name}x"]) == 0
    for file in ("{}.csv", "{}.truth.csv", "{}e.csv", "{}x/covariance.csv"):
        plain, dated = (rows(Path(file.format(name))) for name in "nd")
        assert dated[0][1] == "utc" and [row[:1] + row[2:] for row in dated] == plain
        assert all(Calendar("2026-03-01T12:00:00Z", "min").time(row[1]) == float(row[0]) for row in dated[1:])
    plan = rows(Path("dx/schedule.csv"))
    assert plan[0] == ["start", "end", "sensors", "utc", "utc_end"] and plan[1][3] == "2026-03-01T12:00:00Z"
    assert [row[:3] for row in plan] == rows(Path("nx/schedule.csv"))
    # the dates alone, as another program would write them
    Path("plan.csv").write_text("\n".join(["start,end,sensors", *(",".join([*r[3:5], r[2]]) for r in plan[1:])]))
    samples = rows(Path("d.csv"))
    Path("z.csv").write_text("\n".join(["t,sensor,z1", *(",".join(r[1:]) for r in samples[1:])]))
    assert run(["filter", "runs/d", "z.csv", "--out", "ze.csv", "--truth", "d.truth.csv", "--no-figures"]) == 0
    assert Path("ze.csv").read_text() == Path("de.csv").read_text()
    problem, solution = oc.read_run("runs/d")
    schedule = oc.read_schedule("plan.csv", problem)
    assert solution.schedule is not None and np.array_equal(schedule.edges, solution.schedule.edges)
    assert np.array_equal(schedule.weights, solution.schedule.weights)


def test_a_date_rounded_to_the_microsecond_is_the_edge_beside_it(tmp_path: Path) -> None:
    text = DATED.replace("unit: min, end: 2026-03-01T12:03:00Z, intervals: 12", "unit: s, end: 1, intervals: 3")
    problem = read(tmp_path / "d.yaml", text.replace("2026-03-01T12:00:30Z, 2026-03-01T14:02+02:00", "0, 1"))
    assert problem.calendar is not None
    (tmp_path / "s.csv").write_text(
        "start,end,sensors\n2026-03-01T12:00:00Z,2026-03-01T12:00:00.333333Z,range\n"
        "2026-03-01T12:00:00.333333Z,2026-03-01T12:00:01Z,idle\n"
    )
    assert np.array_equal(oc.read_schedule(tmp_path / "s.csv", problem).edges, problem.edges)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("date: 2026-03-01T12:00:00Z, unit: min, ", "", "6:59: a date stands here, '2026-03-01T12:00:30Z', and"),
        ("date: 2026-03-01T12:00:00Z, ", "", "3:11: horizon has a 'unit' without a 'date'"),
        ("T12:03:00Z", "T12:03:00", "3:55: '2026-03-01T12:03:00' has neither Z nor an offset"),
        ("T12:03:00Z", "T12:03:60Z", "is a leap second\n  hint: times are UTC without leap seconds"),
        ("03-01T12:03:00Z", "02-29T12:03:00Z", "'2026-02-29T12:03:00Z' is not a date\n  hint: there is no such day"),
        ("date: 2026-03-01T12:00:00Z", "date: 2026-03-01", "3:17: horizon.date: '2026-03-01' is not a date"),
        ("unit: min", "unit: week", "3:45: horizon.unit: the unit of time is 'week'\n  hint: one of: s, min, h, d"),
        ("T12:00:30Z", "T12:00:3Z", "6:59: '2026-03-01T12:00:3Z' is not a date\n  hint: ISO 8601"),
    ],
)
def test_what_is_refused(tmp_path: Path, old: str, new: str, what: str) -> None:
    assert old in DATED
    with pytest.raises(ProblemError) as caught:
        read(tmp_path / "d.yaml", DATED.replace(old, new, 1))
    assert what in str(caught.value)


def test_dates_in_data_are_refused_once_with_their_number(tmp_path: Path) -> None:
    plain, dated = read(tmp_path / "n.yaml", NUMBERS), read(tmp_path / "d.yaml", DATED)
    path = tmp_path / "m.csv"
    path.write_text("t,sensor,z1\n" + "".join(f"2026-03-01T12:00:{s}.5,range,1\n" for s in range(30, 42)))
    for problem, what in (
        (dated, "m.csv:2: t: '2026-03-01T12:00:30.5' has neither Z nor an offset, and 11 more lines like it"),
        (plain, "it must be a finite number, and 11 more lines like it\n  hint: dates need horizon.date"),
    ):
        with pytest.raises(ProblemError) as caught:
            oc.read_measurements(path, problem)
        assert what in str(caught.value) and str(caught.value).count("\n") == 1


OTHERS = {
    "oshman_every_step": ("horizon: {", "horizon: {date: 2026-01-01T00:00:00Z, unit: min, "),
    "robust_oscillator": (
        "horizon: {end: 2.0",
        "horizon: {date: 2026-01-01T00:00:00Z, unit: h, end: 2026-01-01T02:00Z",
    ),
    "turning_target": ("horizon: {", "horizon: {date: 2026-01-01T00:00:00Z, unit: s, "),
}


@pytest.mark.parametrize("name", OTHERS)
def test_families_with_a_clock_know_dates(tmp_path: Path, name: str) -> None:
    text = (Path(__file__).resolve().parents[2] / "problems" / f"{name}.yaml").read_text()
    old, new = OTHERS[name]
    assert old in text
    plain, dated = read(tmp_path / "n.yaml", text), read(tmp_path / "d.yaml", text.replace(old, new))
    horizon = document(dated)["horizon"]
    assert horizon.pop("date") == "2026-01-01T00:00:00Z" and horizon.pop("unit") in new
    assert horizon == document(plain)["horizon"] and plain.calendar is None
    again = read(tmp_path / "again.json", json.dumps(document(dated)))
    assert again.calendar == dated.calendar


def test_a_choice_at_a_step_and_a_slot_have_dates_in_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = Path(__file__).resolve().parents[2] / "problems"
    for name, step, columns in (
        ("oshman_every_step", 60.0, ["utc"]),
        ("robust_oscillator", 3600.0, ["utc", "utc_end"]),
    ):
        old, new = OTHERS[name]
        path = tmp_path / f"{name}.yaml"
        path.write_text((folder / f"{name}.yaml").read_text().replace(old, new))
        method = "fixed" if name.startswith("oshman") else "one-step"
        assert run(["solve", str(path), "--method", method, "--no-figures", "--out", name]) == 0
        assert run(["export", name, "--to", "csv", "--out", f"{name}_csv"]) == 0
        header, *lines = rows(tmp_path / f"{name}_csv" / "schedule.csv")
        assert header[-len(columns) :] == columns
        for line in (lines[0], lines[-1]):
            t = float(line[header.index("k" if "k" in header else "start")])
            moment = datetime.fromisoformat(line[header.index("utc")])
            wanted = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=t * step)
            assert abs((moment - wanted).total_seconds()) <= 1e-6


def test_a_problem_without_a_clock_says_so(tmp_path: Path) -> None:
    text = (Path(__file__).resolve().parents[2] / "problems" / "moments_small.yaml").read_text()
    with pytest.raises(ProblemError, match="unknown key 'horizon'"):
        read(tmp_path / "p.yaml", text + "\nhorizon: {date: 2026-01-01T00:00:00Z}\n")


def test_states_of_an_uncertain_plant_have_names(tmp_path: Path) -> None:
    text = (Path(__file__).resolve().parents[2] / "problems" / "robust_oscillator.yaml").read_text()
    named = read(tmp_path / "p.yaml", text.replace("plant:\n", "plant:\n  states: [place, speed]\n  units: [m, m/s]\n"))
    assert state_labels(named) == ["place [m]", "speed [m/s]"]
    assert document(named)["plant"]["states"] == ["place", "speed"]
    with pytest.raises(ProblemError, match="the plant has 2 states"):
        read(tmp_path / "q.yaml", text.replace("plant:\n", "plant:\n  states: [place]\n"))
