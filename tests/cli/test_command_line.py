"""The commands as a user meets them: what they print, what they write, how they end."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

import occontrol
from occontrol.api import choose_method, read_run
from occontrol.cli import run, watch
from occontrol.cli.watch import announce, hush
from occontrol.core.errors import SolveFailed, UsageError
from occontrol.core.solution import Solution, Status

Captured = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_help_loads_no_heavy_library() -> None:
    typer = tuple(int(part) for part in version("typer").split(".")[:2])
    rich = "rich" if typer >= (0, 19) else ""  # older ones import it whatever is asked
    code = (
        "import sys, occontrol\nfrom occontrol.cli import run\n"
        "assert run(['--help']) == 0\n"
        f"heavy = 'casadi numba scipy matplotlib numpy pydantic clarabel ruamel {rich}'.split()\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_list_names_families_methods_and_problems(capsys: Captured) -> None:
    assert run(["list"]) == 0
    text = capsys.readouterr().out
    for word in ("athans", "vlambda", "hybrid", "precision", "robust", "hminimal", "best-single", "scalar_on_off.yaml"):
        assert word in text


def test_init_writes_a_problem_that_reads_and_never_over_a_file(capsys: Captured) -> None:
    assert run(["init", "athans", "mine.yaml"]) == 0
    assert occontrol.read_problem("mine.yaml").family == "athans"
    before = Path("mine.yaml").read_text()
    assert run(["init", "athans", "mine.yaml"]) == 8
    assert "mine.yaml exists already, it was left as it is" in capsys.readouterr().err
    assert Path("mine.yaml").read_text() == before
    assert run(["init", "athens"]) == 2
    assert "there is no family 'athens'\n  hint: did you mean 'athans'?" in capsys.readouterr().err


def test_check_tells_sizes_and_observability_and_solves_nothing(
    small_file: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("occontrol.families.athans.family.AthansFamily.solve", None)
    assert run(["check", str(small_file)]) == 0
    text = capsys.readouterr().out
    for words in ("two radars", "2 states", "40 intervals", "rank 2 of 2", "availability", "work"):
        assert words in text
    assert not Path("runs").exists()


def test_solve_writes_a_run_folder_and_prints_its_result(small_file: Path, capsys: Captured) -> None:
    assert run(["solve", str(small_file), "--json"]) == 0
    said = capsys.readouterr()
    content = json.loads(said.out)
    assert content == json.loads(Path("runs/radars/result.json").read_text())
    # of the progress away from a terminal a line every ten seconds
    begun = {f"solving {small_file}", "compiling (once)"}
    assert all(line in begun or " · " in line for line in said.err.splitlines())
    assert content["status"] == "certified" and content["relative_gap"] < 0.01
    made = {str(p.relative_to("runs/radars")) for p in Path("runs/radars").rglob("*") if p.is_file()}
    kept = {path for path in made if path.startswith(".runs/")}
    made -= kept
    assert {f".runs/1/{path}" for path in made} == kept - {".runs/lock"}  # what is visible are links to what is kept
    figures = {f"figures/{name}.png" for name in ("overview", "schedule", "deviations", "switching", "convergence")}
    assert made == {"problem.json", "result.json", "arrays.npz", "provenance.json", "report.html"} | figures
    assert "<h1>two radars</h1>" in Path("runs/radars/report.html").read_text()
    assert read_run("runs/radars")[1].cost == content["cost"]


def test_solve_prints_a_summary_for_people(small_file: Path, capsys: Captured) -> None:
    assert run(["solve", str(small_file), "--out", "here", "--no-figures", "--method", "greedy"]) == 0
    text = capsys.readouterr().out
    for words in ("status", "cost", "lower bound", "gap", "greedy", "here/"):
        assert words in text
    assert not Path("here/figures").exists()


def test_another_method_keeps_the_options_that_the_file_states(small_file: Path) -> None:
    problem = occontrol.read_problem(small_file)
    stated = dataclasses.replace(problem, method=occontrol.RelaxRoundPolish(relative_gap=3e-3))
    assert choose_method(stated, "relaxed") == occontrol.Relaxed(relative_gap=3e-3)
    assert choose_method(stated, "schedule") is stated.method
    with pytest.raises(UsageError, match="did you mean 'hminimal'"):
        choose_method(problem, "hminmal")


def test_usage_mistakes_end_with_2(small_file: Path, capsys: Captured) -> None:
    assert run(["solve", str(small_file), "--method", "relaxd"]) == 2
    assert "family athans has no method 'relaxd'\n  hint: did you mean 'relaxed'?" in capsys.readouterr().err
    for words in (["solve"], ["solve", "x.yaml", "--nonsense"], ["nonsense"], ["certify", str(small_file)]):
        assert run(words) == 2
        assert capsys.readouterr().err
    assert run(["tradeoff", str(small_file), "--weights", "3:1"]) == 2
    assert "'3:1' is not FROM:TO:COUNT" in capsys.readouterr().err


def test_a_bad_problem_ends_with_3_and_every_mistake(small_text: str, capsys: Captured) -> None:
    bad = small_text.replace("C: [[1, 0]]", "C: [[1, 0, 0]]").replace("cost: 0.5", "cost: -1")
    Path("bad.yaml").write_text(bad)
    assert run(["solve", "bad.yaml", "--json"]) == 3
    said = capsys.readouterr()
    assert said.out == ""
    assert "bad.yaml:9:22: C" in said.err and "C of sensor 'range' is 1x3, but the plant has 2 states" in said.err
    assert "bad.yaml:10:56: cost" in said.err and "cost of sensor 'doppler' is -1" in said.err


@pytest.mark.parametrize("flag", [["--json"], []])
def test_an_infeasible_problem_ends_with_4_and_says_when(small_text: str, capsys: Captured, flag: list[str]) -> None:
    nobody = small_text.replace("  - idle\n", "").replace("cost: 0.5", "cost: 0.5, windows: [[0, 1]]")
    Path("nobody.yaml").write_text(nobody)
    assert run(["solve", "nobody.yaml", *flag]) == 4
    said = capsys.readouterr()
    assert "between t = 2 and 3 no sensor is available" in said.err
    assert not Path("runs").exists()
    if flag:
        content = json.loads(said.out)
        assert content["status"] == "infeasible" and "t = 2 and 3" in content["message"]
    assert run(["check", "nobody.yaml"]) == 4


def test_a_limit_ends_with_5_and_the_best_is_written(small_text: str, capsys: Captured) -> None:
    hasty = small_text.replace("relative_gap: 1.0e-4", "relative_gap: 1.0e-9, max_iterations: 1")
    Path("hasty.yaml").write_text(hasty)
    assert run(["solve", "hasty.yaml", "--json", "--no-figures"]) == 5
    content = json.loads(capsys.readouterr().out)
    assert content["status"] == "limit" and content["lower_bound"] <= content["cost"]
    assert read_run("runs/hasty")[1].cost == content["cost"]


def test_a_disagreement_ends_with_7_and_is_written(
    small_file: Path, small_solution: Solution, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = dataclasses.replace(small_solution, status=Status.DISAGREES, message="the integrator says 3")
    monkeypatch.setattr("occontrol.families.athans.family.AthansFamily.solve", lambda *_: wrong)
    assert run(["solve", str(small_file), "--json", "--no-figures"]) == 7
    assert json.loads(capsys.readouterr().out)["status"] == "disagrees"
    assert read_run("runs/radars")[1].status is Status.DISAGREES


def test_a_failed_solver_ends_with_6_without_a_run_folder(
    small_file: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise SolveFailed("no step was acceptable\n  hint: raise max_iterations")

    monkeypatch.setattr("occontrol.families.athans.family.AthansFamily.solve", fail)
    assert run(["solve", str(small_file)]) == 6
    assert "hint: raise max_iterations" in capsys.readouterr().err
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("command", "line"),
    [("solve {}", "solving {}"), ("compare {} --methods greedy", "comparing methods on {}"),
     ("tradeoff {} --weights 1:2:2 --no-figures", "tracing the front of {}"), ("certify {} {}", "certifying {}")],
)  # fmt: skip
def test_what_takes_a_while_says_so_while_it_still_reads(
    command: str, line: str, small_file: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    class AtOnce:
        def __init__(self, after: float, say: Any, words: list[str], how: dict[str, Any]) -> None:
            assert after < 0.9  # of the second in which something is said, what starting Python leaves
            self.start = lambda: say(*words, **how)

        def cancel(self) -> None:
            pass

    def fail(*_: object) -> None:
        assert capsys.readouterr().err == line.format(small_file) + "\n"
        raise SolveFailed("nothing is read here")

    monkeypatch.setattr("occontrol.cli.watch.threading.Timer", AtOnce)
    monkeypatch.setattr("occontrol.api.read_problem", fail)
    assert run(command.format(small_file, small_file).split()) == 6
    assert capsys.readouterr().err == "nothing is read here\n"


def test_what_is_done_at_once_says_nothing_of_it(small_file: Path, capsys: Captured) -> None:
    announce("solving it")
    hush()
    assert watch._pending is not None
    watch._pending.join()
    assert capsys.readouterr().err == ""


def test_the_unexpected_ends_with_6_and_one_message(
    small_file: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("by\nnothing")

    monkeypatch.setattr("occontrol.families.athans.family.AthansFamily.solve", fail)
    monkeypatch.delenv("OCCONTROL_DEBUG", raising=False)
    assert run(["solve", str(small_file)]) == 6
    err = capsys.readouterr().err
    assert "unexpected ZeroDivisionError: by nothing\n" in err and "Traceback" not in err
    monkeypatch.setenv("OCCONTROL_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        run(["solve", str(small_file)])


def test_what_cannot_be_read_or_written_ends_with_8(small_file: Path, capsys: Captured) -> None:
    assert run(["solve", "missing.yaml"]) == 8
    assert "missing.yaml" in capsys.readouterr().err
    Path("taken").write_text("mine")
    assert run(["solve", str(small_file), "--out", "taken"]) == 8
    assert "taken is not a folder" in capsys.readouterr().err
    assert Path("taken").read_text() == "mine"


def test_a_picture_that_cannot_be_drawn_costs_nobody_the_result(
    small_file: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("no ink")

    monkeypatch.setattr("occontrol.api.pages.figures_of", fail)
    assert run(["solve", str(small_file)]) == 0
    assert "the figures could not be drawn: ValueError: no ink" in capsys.readouterr().err
    assert read_run("runs/radars")[1].status is Status.CERTIFIED


def test_certify_recomputes_schedules_and_catches_what_a_run_folder_claims(small_file: Path, capsys: Captured) -> None:
    assert run(["solve", str(small_file), "--json", "--no-figures"]) == 0
    content = json.loads(capsys.readouterr().out)
    Path("mine.csv").write_text("start,end,sensors\n0,4,doppler\n")
    assert run(["certify", str(small_file), "mine.csv", "--json"]) == 0
    mine = json.loads(capsys.readouterr().out)
    assert mine["cost"] > content["cost"] and mine["lower_bound"] <= content["cost"] * (1 + 1e-12)
    assert run(["certify", str(small_file), "runs/radars/result.json", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["cost"] == pytest.approx(content["cost"], rel=1e-12)
    assert run(["certify", "runs/radars"]) == 0
    capsys.readouterr()
    Path("runs/radars/result.json").write_text(json.dumps({**content, "cost": content["cost"] * 0.99}))
    assert run(["certify", "runs/radars"]) == 7
    assert "the stated cost is" in "".join(capsys.readouterr())
    assert run(["certify", str(small_file), "runs/radars", "--json"]) == 7
    assert json.loads(capsys.readouterr().out)["status"] == "disagrees"
    # of another problem the run says nothing: its schedule is judged, not its numbers
    other = Path("other.yaml")
    other.write_text(small_file.read_text().replace("cost: 0.5", "cost: 0.6"))
    assert other.read_text() != small_file.read_text()
    assert run(["certify", str(other), "runs/radars"]) == 0


def test_certify_catches_a_listed_schedule_that_is_not_the_solved_one(small_file: Path, capsys: Captured) -> None:
    assert run(["solve", str(small_file), "--json", "--no-figures"]) == 0
    content = json.loads(capsys.readouterr().out)
    content["schedule"] = [{"start": 0.0, "end": content["schedule"][-1]["end"], "sensors": ["doppler"]}]
    Path("runs/radars/result.json").write_text(json.dumps(content))
    for words in (["runs/radars"], [str(small_file), "runs/radars"]):
        assert run(["certify", *words]) == 7
        assert "the schedule that result.json lists is not the one in arrays.npz" in "".join(capsys.readouterr())


def test_compare_gives_every_method_a_clock_of_its_own(small_text: str, tmp_path: Path, capsys: Captured) -> None:
    """The time limit of the first method stops it, and nobody else."""
    hasty = small_text.replace("relative_gap: 1.0e-4", "relative_gap: 1.0e-6, time_limit: 1.0e-9")
    (tmp_path / "x.yaml").write_text(hasty)
    assert run(["compare", str(tmp_path / "x.yaml"), "--methods", "schedule,greedy,random", "--json"]) == 0
    rows = {row["method"]: row for row in json.loads(capsys.readouterr().out)["methods"]}
    assert rows["schedule"]["status"] == "limit"
    for name in ("greedy", "random"):
        assert rows[name]["status"] == "feasible"


def test_compare_sets_methods_side_by_side(small_file: Path, capsys: Captured) -> None:
    assert run(["compare", str(small_file), "--methods", "schedule,best-single,greedy"]) == 0
    text = capsys.readouterr().out
    for word in ("schedule", "best-single", "greedy", "above best bound", "switches", "seconds"):
        assert word in text
    records = json.loads(Path("runs/radars-compare/compare.json").read_text())
    assert [r["method"] for r in records] == ["schedule", "best-single", "greedy"]
    assert all(r["gap_to_best_bound"] >= 0 for r in records)
    assert Path("runs/radars-compare/compare.png").stat().st_size > 10_000
    assert run(["compare", str(small_file), "--methods", "schedule,magic"]) == 2
    assert "no method 'magic'" in capsys.readouterr().err


def test_export_needs_the_run_folder_alone(small_file: Path, capsys: Captured) -> None:
    assert run(["solve", str(small_file), "--no-figures"]) == 0
    capsys.readouterr()
    small_file.unlink()
    assert run(["export", "runs/radars", "--to", "csv", "--out", "tables"]) == 0
    assert "tables/schedule.csv" in capsys.readouterr().out
    assert run(["export", "runs/radars", "--to", "json"]) == 0
    assert Path("runs/radars/export.json").exists()
    assert run(["export", "runs/radars", "--to", "exel"]) == 2
    assert "there is no format 'exel'" in capsys.readouterr().err
    assert run(["export", "nowhere", "--to", "csv"]) == 8


def test_simulate_follows_the_run_of_the_same_problem_and_only_of_that(small_file: Path, capsys: Captured) -> None:
    assert run(["solve", str(small_file), "--no-figures", "--method", "best-single"]) == 0
    for name in ("a.csv", "b.csv"):
        assert run(["simulate", str(small_file), "--out", name, "--seed", "7"]) == 0
    assert Path("a.csv").read_text() == Path("b.csv").read_text()
    assert {line.split(",")[1] for line in Path("a.csv").read_text().splitlines()[1:]} == {"doppler"}
    assert Path("a.truth.csv").read_text().startswith("t,x1,x2\n")
    assert run(["filter", "runs/radars", "a.csv", "--out", "estimate.csv"]) == 0
    header = Path("estimate.csv").read_text().splitlines()[0]
    assert header.startswith("t,x1,x2,sd_x1,sd_x2,w1,sd_w1,nis")
    small_file.write_text(small_file.read_text().replace("cost: 0.5", "cost: 0.6"))
    capsys.readouterr()
    assert run(["simulate", str(small_file), "--out", "c.csv", "--run", "runs/radars"]) == 3
    assert "runs/radars is the run of another problem" in capsys.readouterr().err
    assert run(["simulate", str(small_file), "--out", "c.csv"]) == 0
    assert "solving again" in capsys.readouterr().err


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    code = "import sys\nfrom occontrol.cli import main\nmain(['list'])"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == b""
    assert process.wait(60) == 0
