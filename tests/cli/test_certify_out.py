"""`certify --out`: a run folder for anybody's schedule, on which the other commands work."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from occontrol.api import read_measurements as read_samples
from occontrol.api import read_problem, read_run, run_filter
from occontrol.cli import run

Captured = pytest.CaptureFixture[str]

PROBLEMS = {
    "athans": """\
family: athans
horizon: {start: 0, end: 2, intervals: 10}
plant: {A: [[0, 1], [-1, -0.4]], noise: [[0, 0], [0, 0.5]], initial: {mean: [1, 0], covariance: {diag: [1, 1]}}}
sensors: [{name: one, C: [[1, 0]], noise: [[0.1]]}, {name: two, C: [[0, 1]], noise: [[0.4]], cost: 0.5}]
objective: {output: [[1, 0]]}
""",
    "vlambda": """\
family: vlambda
horizon: {steps: 4}
plant: {F: [[1, 0.1], [0, 1]], Q: {diag: [0.1, 0.2]}, initial: {mean: [0, 0], covariance: {diag: [1, 1]}}}
sensors: [{name: one, H: [[1, 0]], R: 0.5}, {name: two, H: [[0, 1]], R: 0.5}]
""",
    "robust": """\
family: robust
horizon: {end: 1.0, slots: 2}
plant: {A: [[0, 1], [-1, -0.4]], B: [[0], [1]], K: [[0.2, 0.1]],
        initial: {center: [1, 0], weight: {diag: [2, 1]}, level: 1}}
sensors: [{name: one, C: [[1, 0]]}, {name: two, C: [[0, 1]]}]
""",
}
# the first and the last switch within an interval, and so within a slot: an edge is added
BY_HAND = {"athans": (0, 0.77, 2), "vlambda": (0, 1, 4), "robust": (0, 0.3, 1)}


@pytest.fixture(params=list(PROBLEMS))
def family(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("p.yaml").write_text(PROBLEMS[request.param])
    start, switch, end = BY_HAND[request.param]
    Path("by_hand.csv").write_text(f"start,end,sensors\n{start},{switch},two\n{switch},{end},one\n")
    return request.param


def test_the_other_commands_work_on_the_run_folder_of_anybodys_schedule(family: str, capsys: Captured) -> None:
    figures = [] if family == "athans" else ["--no-figures"]
    assert run(["certify", "p.yaml", "by_hand.csv", "--out", "mine", *figures, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said == json.loads(Path("mine/result.json").read_text()) and said["status"] == "feasible"
    assert bool(figures) or (Path("mine/figures/overview.png").exists() and Path("mine/report.html").exists())
    problem, solution = read_run("mine")
    assert problem.family == family and solution.schedule is not None
    switch = BY_HAND[family][1]
    assert {"one", "two"} == set(solution.schedule.names) and switch in solution.schedule.edges
    assert run(["simulate", "p.yaml", "--run", "mine", "--out", "s.csv", "--seed", "1"]) == 0
    sensors = [(m.time, m.sensor) for m in read_samples("s.csv", problem)]
    late = switch + (1e-9 if family != "vlambda" else -0.5)  # a sample is told at the end of its time, or at step k
    assert all(name == ("two" if t <= late else "one") for t, name in sensors if 0 < t) and len(sensors) > 1
    assert run(["filter", "mine", "s.csv", "--out", "e.csv", "--no-figures"]) == 0
    estimate = run_filter(problem, solution, read_samples("s.csv"))
    assert len(Path("e.csv").read_text().splitlines()) == 1 + len(estimate.times)
    for form in ("csv", "json", "npz", "mat", "c"):
        assert run(["export", "mine", "--to", form]) == 0
    assert run(["show", "mine"]) == 0
    assert "mine/" in capsys.readouterr().out
    # and what is written is certified again
    assert run(["certify", "mine", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert (again["cost"], again["lower_bound"]) == pytest.approx((said["cost"], said["lower_bound"]), rel=1e-9)


def test_what_is_read_is_not_written_over(family: str, capsys: Captured) -> None:
    if family != "robust":
        return
    assert run(["certify", "p.yaml", "by_hand.csv", "--out", "mine", "--no-figures"]) == 0
    before = Path("mine/result.json").read_bytes()
    for words in (["mine", "--out", "mine"], ["p.yaml", "mine", "--out", "mine"], ["mine/problem.json", "by_hand.csv"]):
        out = [] if "--out" in words else ["--out", "mine"]
        assert run(["certify", *words, *out, "--no-figures"]) == 2
        assert "is an input" in capsys.readouterr().err
    assert Path("mine/result.json").read_bytes() == before
    assert run(["certify", "mine", "--out", "copy", "--no-figures"]) == 0
    assert read_problem("copy/problem.json").family == "robust"
