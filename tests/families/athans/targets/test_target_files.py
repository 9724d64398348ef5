"""Files of many targets: tables, passes, schedules that anybody wrote, and the whole command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import family_of
from tests.target_problems import FIVE, read


def run(*arguments: str) -> int:
    """The exit code of the command line."""
    from occontrol.cli import main

    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    return int(end.value.code or 0)


TABLE = FIVE[FIVE.index("{table: {") + 8 : FIVE.index("}, model: aircraft}") + 1]


def test_columns_from_csv_and_npz_are_those_of_the_file(tmp_path: Path) -> None:
    names, q, r = list("abcde"), [0.1, 0.2, 0.4, 0.6, 1.0], [1, 1, 2, 2, 3]
    lines = ["name,q,r", *(f"{n},{x},{y}" for n, x, y in zip(names, q, r, strict=True)), ""]
    (tmp_path / "five.csv").write_text("\n".join(lines))
    np.savez(tmp_path / "five.npz", name=np.array(names), q=np.array(q), r=np.array(r))
    inside = oc.solve(read(FIVE, tmp_path), "round-robin")
    for file in ("five.csv", "five.npz"):
        problem = read(FIVE.replace(TABLE, file), tmp_path)
        assert problem.target_names == names
        assert oc.solve(problem, "round-robin").cost == inside.cost
    assert read(FIVE.replace(TABLE, "five.csv, rows: 2"), tmp_path).targets == 2


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("c,x,0.2", "five.csv:2: q is 'x', it must be a finite number"),
        ("c,1", "five.csv:2: the line has 2 fields, the header names 3"),
        ("c,1e999,1", "five.csv:2: q is '1e999'"),
    ],
)
def test_a_wrong_line_of_a_table_is_named(line: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "five.csv").write_text(f"name,q,r\n{line}\n")
    with pytest.raises(oc.ProblemError, match=words):
        read(FIVE.replace(TABLE, "five.csv"), tmp_path)


def test_a_table_outside_the_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(oc.ProblemError, match="lies outside the folder of the problem file"):
        read(FIVE.replace(TABLE, "../five.csv"), tmp_path)


def test_passes_open_looks_and_bring_columns_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "passes.csv").write_text("target,resource,start,end,rate\na,radar,1,3,0.5\nb,radar,2,2.6,2\n")
    text = FIVE.replace(", model: aircraft}", ", model: aircraft, passes: passes.csv}")
    text = text.replace("[[sharp*r]]", "[[sharp*r*rate]]")
    problem = read(text, tmp_path)
    looks = problem.groups[0].looks[0]
    # between 2 and 2.6 lie two whole intervals of a quarter
    assert np.bincount(looks.target).tolist() == [8, 2]
    assert looks.noise[looks.which[looks.target == 0][0], 0, 0] == pytest.approx(0.05)
    assert looks.noise[looks.which[looks.target == 1][0], 0, 0] == pytest.approx(0.2)
    solution = oc.solve(problem)
    assert set(solution.schedule.target) <= {0, 1}
    assert "3 targets are never seen: 'c', 'd', 'e'" in family_of(problem).warnings(problem)[0].what


def test_the_command_line_from_check_to_export(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("five.yaml").write_text(FIVE)
    assert run("check", "five.yaml") == 0
    said = capsys.readouterr().out
    assert "5 targets of 1 model, n = 10" in said and "5 blocks: 5 of 2 states" in said
    assert run("solve", "five.yaml", "--out", "run") == 0
    result = json.loads(Path("run/result.json").read_text())
    assert Path("run/figures/overview.png").exists()
    capsys.readouterr()
    assert run("certify", "run", "--json") == 0
    assert json.loads(capsys.readouterr().out)["cost"] == result["cost"]
    assert run("export", "run", "--to", "csv") == 0
    assert Path("run/csv/schedule.csv").read_text().startswith("start,end,resource,target\n")
    assert run("certify", "five.yaml", "run/csv/schedule.csv") == 0
    assert run("certify", "five.yaml", "run/result.json") == 0
    assert run("simulate", "five.yaml", "--run", "run", "--out", "data.csv") == 0
    assert run("filter", "run", "data.csv", "--out", "estimates.csv") == 0
    header = Path("estimates.csv").read_text().split("\n")[0]
    assert header.startswith("t,x1,") and "x10" in header
    assert run("compare", "five.yaml", "--methods", "schedule,round-robin,information", "--out", "cmp") == 0
    assert Path("cmp/compare.png").exists()
    assert run("show", "run") == 0
    capsys.readouterr()


def test_a_schedule_that_the_problem_does_not_allow_is_refused(tmp_path: Path) -> None:
    problem = read(FIVE, tmp_path)
    cases = {
        "0,0.25,radar,z": "there is no target 'z'",
        "0,0.25,sonar,a": "there is no resource 'sonar'",
        "0,0.3,radar,a": "end = 0.3 is no edge of the problem\n  hint: the nearest are 0.25 and 0.5",
        "4,4.5,radar,a": "resource 'radar' does not see target 'a' between t = 4 and 4.25, and 1 more look like it",
        "0,0.25,radar,a\n0,0.25,radar,b": "resource 'radar' gives 2 looks between t = 0 and 0.25\n  hint: its capacity",
        "0,0.25,radar,a\n0,0.25,radar,a": "a look is taken twice on one interval",
        "1,0.5,radar,a": "the look ends at 0.5, which is not after its start 1",
    }
    path = tmp_path / "s.csv"
    for lines, words in cases.items():
        path.write_text(f"start,end,resource,target\n{lines}\n")
        with pytest.raises(oc.ProblemError) as error:
            oc.certify(problem, oc.read_schedule(path, problem))
        assert words in str(error.value), lines
    path.write_text("start,end,resource,target\n")
    assert oc.certify(problem, oc.read_schedule(path, problem)).cost > oc.solve(problem).cost


def test_a_wrong_claim_about_a_run_is_found(tmp_path: Path) -> None:
    from dataclasses import replace

    from occontrol.core.claims import Claims

    problem = read(FIVE, tmp_path)
    solution = oc.solve(problem)
    claims = Claims(solution.cost, 1.02 * solution.cost, None, None, {})
    assert oc.certify(problem, solution.schedule, claims).status is oc.Status.DISAGREES
    good = replace(claims, lower_bound=solution.result["lower_bound"])
    assert oc.certify(problem, solution.schedule, good).status is not oc.Status.DISAGREES
