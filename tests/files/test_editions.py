"""Files say the edition of their keys; those without one are read, those of a later one are refused in plain words."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from occontrol.api import document, export_run, read_problem, read_run, write_run
from occontrol.core.errors import ProblemError
from occontrol.core.solution import Solution
from occontrol.core.versions import SCHEMA_VERSION, newer
from occontrol.families import names, template
from occontrol.files.run_choice import problem_digest

LATER = SCHEMA_VERSION + 1


@pytest.mark.parametrize("family", names())
def test_templates_say_it_and_problems_without_it_are_the_same(tmp_path: Path, family: str) -> None:
    text = template(family).read_text(encoding="utf-8")
    stated = [line for line in text.splitlines() if line.startswith("schema_version:")]
    assert len(stated) == 1 and stated[0].split()[1] == str(SCHEMA_VERSION)
    path = tmp_path / "p.yaml"
    path.write_text(text.replace(stated[0] + "\n", ""), encoding="utf-8")
    there, absent = document(read_problem(template(family))), document(read_problem(path))
    assert there == absent and there["schema_version"] == SCHEMA_VERSION
    path.write_text(text.replace(stated[0], f"schema_version: {LATER}\nnew_in_{LATER}: 1"), encoding="utf-8")
    with pytest.raises(ProblemError, match=rf"schema_version is {LATER}, .* reads up to {SCHEMA_VERSION}") as error:
        read_problem(path)
    assert "new_in" not in str(error.value)  # of the rest nothing is known


def test_which_problem_it_is_does_not_depend_on_it(small_solution: Solution) -> None:
    asked = document(small_solution.problem)
    without = {key: value for key, value in asked.items() if key != "schema_version"}
    assert problem_digest(without) == problem_digest(asked) != problem_digest({**asked, "objective": {}})


def test_a_run_says_it_and_a_later_one_is_refused(tmp_path: Path, small_solution: Solution) -> None:
    write_run(tmp_path, small_solution.problem, small_solution)
    for name in ("problem.json", "result.json"):
        assert json.loads((tmp_path / name).read_text(encoding="utf-8"))["schema_version"] == SCHEMA_VERSION
    path = (tmp_path / "result.json").resolve()
    content = json.loads(path.read_text(encoding="utf-8"))
    del content["schema_version"]
    path.write_text(json.dumps(content), encoding="utf-8")
    assert read_run(tmp_path)[1].cost == small_solution.cost  # as written before files said it
    path.write_text(json.dumps({**content, "schema_version": LATER}), encoding="utf-8")
    with pytest.raises(ProblemError, match=rf"result.json: schema_version is {LATER}, .*\n  hint: .*upgrade"):
        read_run(tmp_path)


def test_exports_say_it(tmp_path: Path, small_solution: Solution) -> None:
    write_run(tmp_path / "run", small_solution.problem, small_solution)
    files = {to: export_run(tmp_path / "run", to)[0] for to in ("json", "npz", "mat")}
    assert json.loads(files["json"].read_text(encoding="utf-8"))["schema_version"] == SCHEMA_VERSION
    assert np.load(files["npz"])["schema_version"] == SCHEMA_VERSION
    assert loadmat(files["mat"])["schema_version"] == SCHEMA_VERSION
    manifest = next(p for p in export_run(tmp_path / "run", "flight") if p.name == "MANIFEST.json")
    assert json.loads(manifest.read_text(encoding="utf-8"))["schema_version"] == SCHEMA_VERSION


def test_what_is_no_whole_number_is_left_to_the_schema() -> None:
    assert newer({}) is newer({"schema_version": True}) is newer({"schema_version": "9"}) is None
    assert newer({"schema_version": SCHEMA_VERSION}) is None and newer({"schema_version": LATER}) is not None
