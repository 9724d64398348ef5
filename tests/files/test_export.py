"""Exports say what the run says: the same numbers, with their times, in files that other tools read."""

from __future__ import annotations

import csv
import dataclasses
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from occontrol.api import export_run, read_schedule, write_run
from occontrol.core.errors import FileAccessError, UsageError
from occontrol.core.solution import Solution
from occontrol.files.export import FORMATS, c, npz
from occontrol.files.export import csv as exported_csv


@pytest.fixture
def run(tmp_path: Path, small_solution: Solution) -> Path:
    write_run(tmp_path / "run", small_solution.problem, small_solution)
    return tmp_path / "run"


def table(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(newline="") as file:
        header, *rows = list(csv.reader(file))
    return header, np.array([[float(x or "nan") for x in row] for row in rows])


def test_csv_holds_every_array_with_its_times(run: Path, small_solution: Solution) -> None:
    names = {path.name for path in export_run(run, "csv")}
    assert {"schedule.csv", "gains.csv", "covariance.csv", "switching.csv", "weights.csv"} <= names
    arrays = small_solution.arrays
    header, values = table(run / "csv" / "covariance.csv")
    assert header == ["t", "covariance_1_1", "covariance_1_2", "covariance_2_1", "covariance_2_2"]
    assert np.array_equal(values[:, 0], arrays["times"])
    assert np.array_equal(values[:, 1:].reshape(-1, 2, 2), arrays["covariance"])
    header, values = table(run / "csv" / "switching.csv")
    assert header == ["start", "end", "range", "doppler", "idle"]
    assert np.array_equal(values[:, 2:], arrays["switching"])
    assert np.array_equal(values[1:, 0], values[:-1, 1])
    header, values = table(run / "csv" / "gains.csv")
    assert np.array_equal(values[:, 2:].reshape(arrays["gain"].shape), arrays["gain"])


def test_the_exported_schedule_reads_back_to_the_same_schedule(run: Path, small_solution: Solution) -> None:
    export_run(run, "csv", run.parent / "elsewhere")
    back = read_schedule(run.parent / "elsewhere" / "schedule.csv", small_solution.problem)
    assert small_solution.schedule is not None
    assert np.array_equal(back.weights, small_solution.schedule.weights)


def test_json_holds_schedule_and_arrays(run: Path, small_solution: Solution) -> None:
    (path,) = export_run(run, "json", run.parent / "out" / "run.json")
    content = json.loads(path.read_text())
    assert content["sensors"] == ["range", "doppler", "idle"]
    assert content["schedule"] == small_solution.result["schedule"]
    assert content["result"]["cost"] == small_solution.cost
    assert np.array_equal(content["arrays"]["gain"], small_solution.arrays["gain"])


def test_every_format_writes_what_it_says(run: Path) -> None:
    for name, place in FORMATS.items():
        written = export_run(run, name)
        assert written and all(path.exists() for path in written)
        assert (run / place).exists()


def test_an_unknown_format_and_a_place_that_cannot_be(run: Path) -> None:
    with pytest.raises(UsageError, match="there is no format 'xls'"):
        export_run(run, "xls")
    with pytest.raises(FileAccessError, match="cannot write"):
        export_run(run, "csv", run / "result.json" / "below")


def test_a_csv_file_named_by_the_user_is_the_schedule(run: Path, small_solution: Solution) -> None:
    names = {path.name for path in export_run(run, "csv", run.parent / "plan.csv")}
    assert {"plan.csv", "plan_gains.csv", "plan_covariance.csv"} <= names
    back = read_schedule(run.parent / "plan.csv", small_solution.problem)
    assert small_solution.schedule is not None
    assert np.array_equal(back.weights, small_solution.schedule.weights)


def test_c_holds_the_same_numbers(run: Path, small_solution: Solution) -> None:
    (path,) = export_run(run, "c", run.parent / "tables.h")
    text = path.read_text(encoding="ascii")
    assert 'occontrol_sensors[3] = {"range", "doppler", "idle"};' in text
    for name in ("edges", "gain", "covariance", "weights"):
        array = small_solution.arrays[name]
        (sizes, body), *more = re.findall(rf"static const double occontrol_{name}((?:\[\d+\])+) =\n([^;]*);", text)
        assert not more
        assert tuple(map(int, re.findall(r"\d+", sizes))) == array.shape
        assert np.array_equal(np.array(json.loads(body.replace("{", "[").replace("}", "]"))), array)


def odd_arrays(solution: Solution) -> Solution:
    """The same with an array of what is no ordinary number, one of integers, and one that needs 17 digits."""
    odd = {"odd": np.array([[np.nan, np.inf, -np.inf], [0.1 + 0.2, 1.0, -2e-300]]), "counts": np.array([3, -1])}
    return dataclasses.replace(solution, arrays={**solution.arrays, **odd})


def test_c_says_what_is_no_number_and_keeps_every_digit(tmp_path: Path, small_solution: Solution) -> None:
    c.write(small_solution.problem, odd_arrays(small_solution), {}, tmp_path / "x.h")
    text = (tmp_path / "x.h").read_text(encoding="ascii")
    body = "{{NAN, INFINITY, -INFINITY}, {0.30000000000000004, 1.0, -2e-300}};"
    assert f"static const double occontrol_odd[2][3] =\n  {body}\n" in text
    assert "static const int occontrol_counts[2] =\n  {3, -1};\n" in text


def test_csv_and_npz_keep_them_too(tmp_path: Path, small_solution: Solution) -> None:
    solution = odd_arrays(small_solution)
    exported_csv.write(solution.problem, solution, {}, tmp_path / "csv")
    header, values = table(tmp_path / "csv" / "odd.csv")
    assert header == ["k", "odd_1", "odd_2", "odd_3"]
    odd = solution.arrays["odd"]
    assert np.array_equal(values[:, 1:], np.where(np.isfinite(odd), odd, np.nan), equal_nan=True)  # an empty cell
    npz.write(solution.problem, solution, {"gain": solution.arrays["odd"]}, tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as file:
        assert np.array_equal(file["odd"], solution.arrays["odd"], equal_nan=True)
        assert np.array_equal(file["filter_gain"], solution.arrays["odd"], equal_nan=True)


def test_intervals_begin_before_they_end_and_rows_come_before_columns(run: Path, small_solution: Solution) -> None:
    export_run(run, "csv")
    _, values = table(run / "csv" / "weights.csv")
    edges = small_solution.arrays["edges"]
    assert np.array_equal(values[:, 0], edges[:-1]) and np.array_equal(values[:, 1], edges[1:])
    header, values = table(run / "csv" / "gains.csv")
    assert header[2:] == ["gain_1_1", "gain_2_1"]  # two states, one value
    assert np.array_equal(values[:, 2:], small_solution.arrays["gain"][:, :, 0])


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_c_compiles_and_prints_the_gain(run: Path, small_solution: Solution) -> None:
    export_run(run, "c", run.parent / "tables.h")
    main = run.parent / "main.c"
    main.write_text(
        '#include <stdio.h>\n#include "tables.h"\nint main(void) { printf("%.17g %s\\n", '
        "occontrol_gain[3][1][0], occontrol_sensors[1]); return 0; }\n"
    )
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", str(main), "-o", str(run.parent / "main")]
    subprocess.run(command, check=True)
    value, name = subprocess.run([str(run.parent / "main")], check=True, capture_output=True, text=True).stdout.split()
    assert (float(value), name) == (small_solution.arrays["gain"][3, 1, 0], "doppler")
