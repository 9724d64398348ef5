"""Pages of several results: methods side by side, the front, a study."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import occontrol
from occontrol.api import write_comparison
from occontrol.cli import run
from occontrol.cli.compare import comparison
from occontrol.families.athans.front_folder import front_groups
from occontrol.files.figures.style import house_style, new_figure
from occontrol.files.page.estimate import estimate_groups
from occontrol.files.page.records import records_table, write_records_page


def test_records_become_one_row_each() -> None:
    records = [
        {"method": "a", "cost": 1.5, "top": {"lower_bound": 1.0}, "list": [1, 2]},
        {"method": "b", "switches": 3},
    ]
    table = records_table("methods", records)
    assert table.columns == {
        "method": ["a", "b"], "cost": [1.5, None], "top lower bound": [1.0, None], "switches": [None, 3],
    }  # fmt: skip


def test_a_page_of_records_stands_beside_its_pictures(tmp_path: Path) -> None:
    with house_style():
        figure = new_figure((4, 3), "one")
        figure.subplots().plot([1, 2], label="a")
    records = [{"task": "1", "cost": 2.5}]
    written = write_records_page(
        tmp_path / "study.html", "my study", "study", records, {"lines": figure}, pictures=tmp_path / "figures"
    )
    assert written == [tmp_path / "figures/lines.png", tmp_path / "study.html"] and all(p.exists() for p in written)
    text = written[1].read_text()
    assert "<h1>my study</h1>" in text and "2.5" in text and 'alt="one. a from 1 to 2."' in text


def test_methods_side_by_side(small_solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = small_solution.problem
    solutions = {"schedule": small_solution, "greedy": occontrol.solve(problem, "greedy")}
    rows = comparison(solutions)
    monkeypatch.setattr("occontrol.api.pages.compare_figure", lambda *_: None)  # pictures have their own tests
    (path,) = write_comparison(tmp_path, problem, solutions, rows)
    text = path.read_text()
    data = json.loads(text.split('id="panels0-data">')[1].split("</script>")[0])
    titles = [m["attributes"]["text"] for m in found(data, "Title")]
    assert titles == ["schedule", "greedy"]
    for row in rows:
        assert f"<td>{row['method']}</td>" in text and repr(row["cost"]) in text


def found(value, name: str) -> list[dict]:
    """Every model of a kind inside of what Bokeh is given, in order."""
    if isinstance(value, list):
        return [model for entry in value for model in found(entry, name)]
    if not isinstance(value, dict):
        return []
    own = [value] if value.get("name") == name and "attributes" in value else []
    return own + [model for entry in value.values() for model in found(entry, name)]


def test_the_front_and_its_bound(small_solution, tmp_path: Path) -> None:
    from occontrol.api import family_of

    problem = small_solution.problem
    front = occontrol.tradeoff(problem, [0.01, 0.1, 1.0])
    error, gap = (group.panels[0] for group in front_groups(front))
    assert np.all(np.diff(error.times) >= 0) and np.all(error.values[:, 0] >= error.values[:, 1] * (1 - 1e-9))
    assert gap.times.tolist() == [0.01, 0.1, 1.0] and np.all(gap.values >= 0)
    written = family_of(problem).write_tradeoff(tmp_path, front)
    assert {p.name for p in written} == {
        "tradeoff.json", "front.csv", "arrays.npz", "front.png", "schedules.png", "tradeoff.html",
    }  # fmt: skip
    text = (tmp_path / "tradeoff.html").read_text()
    assert all(repr(point["cost"]) in text for point in front.as_dict()["points"])


def test_the_page_of_a_filter_run(small_solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    problem = small_solution.problem
    occontrol.write_run(tmp_path / "run", problem, small_solution, lambda s, _: (s / "report.html").write_text("x"))
    monkeypatch.setattr("occontrol.families.athans.family.AthansFamily.estimate_figures", lambda *_: {})
    monkeypatch.chdir(tmp_path)
    problem_file = str(tmp_path / "run/problem.json")
    assert run(["simulate", problem_file, "--run", "run", "--out", "m.csv", "--seed", "1"]) == 0
    assert run(["filter", "run", "m.csv", "--out", "e.csv"]) == 0
    assert "estimates in e.csv, pictures in e.html" in capsys.readouterr().err
    text = Path("e.html").read_text()
    assert "NIS per value" in text and "NEES against m.truth.csv" in text
    estimate = occontrol.run_filter(problem, small_solution, occontrol.read_measurements("m.csv", problem))
    used = estimate.dimension > 0
    (group,) = estimate_groups(problem, small_solution, estimate, None)
    titles = [panel.title for panel in group.panels]
    assert [title.split(" ")[0] for title in titles] == ["who", "x1;", "x2;", "prediction", "normalised"]
    nis = group.panels[-1]
    np.testing.assert_allclose(nis.values[:, 0] * estimate.dimension[used], estimate.nis[used])
    np.testing.assert_allclose(group.panels[1].high - group.panels[1].low, 4 * estimate.standard_deviation[:, [0]])
    # the page is no way around what protects a run
    assert run(["filter", "run", "m.csv", "--out", "run/report.csv"]) == 2
