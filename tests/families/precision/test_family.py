"""The precision family as the user meets it: files, refusals with their words, exit codes, run folders."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from occontrol.api import document, read_problem
from occontrol.core.errors import ProblemError
from occontrol.core.solution import Status
from occontrol.families.precision import methods as methods_module
from occontrol.families.precision.family import FAMILY as precision
from tests.families.precision.files import BASE, MOMENTS, load

PROBLEMS = Path(__file__).parents[3] / "problems"
FILES = ["moments_small", "lorenz96_enkf", "lorenz96_enkf_batch3", "lorenz96_ukf", "space_object"]

@pytest.fixture
def run(capsys):
    """The command line: words in, exit code, output and errors out."""
    from occontrol import cli

    def call(*words):
        capsys.readouterr()
        code = cli.run([str(word) for word in words])
        return code, *capsys.readouterr()

    return call


@pytest.mark.parametrize("name", FILES)
def test_expected_objective(name):
    problem = read_problem(PROBLEMS / f"{name}.yaml")
    solution = precision.solve(problem)
    expect = problem.expect
    assert solution.status is Status.CERTIFIED
    assert abs(solution.result["objective"] - expect["cost"]) <= expect["tolerance"] * expect["cost"]
    if "precisions" in expect:
        assert np.allclose(solution.result["precisions"], expect["precisions"], rtol=0, atol=1e-8)
    assert solution.result["relative_margin"] >= -1e-8
    posterior = solution.arrays["posterior"][0]
    assert np.isclose(solution.result["margin"], np.linalg.eigvalsh(problem.bound - posterior)[0], atol=1e-12)


@pytest.mark.parametrize("name", FILES)
def test_document_round_trip(name, tmp_path):
    problem = read_problem(PROBLEMS / f"{name}.yaml")
    path = tmp_path / "again.json"
    path.write_text(json.dumps(document(problem)), encoding="utf-8")
    again = read_problem(path)
    assert document(again) == document(problem)
    assert precision.solve(again).result["objective"] == precision.solve(problem).result["objective"]


def test_round_trip_of_every_option(tmp_path):
    text = BASE.replace("caps: 50", "caps: [50, null]\nprices: [1, 2, 3, 4]\nfixed: [null, 3.0]\nbatches: 2")
    text += "prune: {sensors: 2, by: sensor, rise: 2.0}\ntruth: {seed: 5}\nmethod: {name: clarabel, form: factor}\n"
    problem = load(tmp_path, text)
    path = tmp_path / "again.json"
    path.write_text(json.dumps(document(problem)), encoding="utf-8")
    assert document(read_problem(path)) == document(problem)
    assert np.isinf(problem.caps[1]) and problem.fixed[3] == 3.0 and problem.prices[2] == 3.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("bound: {factor: 0.5}", "bound: {}", "bound has neither factor nor matrix"),
        ("bound: {factor: 0.5}", "bound: {factor: 0.5, matrix: [[1, 0], [0, 1]]}", "bound has both factor and matrix"),
        ("bound: {factor: 0.5}", "bound: {factor: -1}", "bound.factor is -1"),
        ("bound: {factor: 0.5}", "bound: {matrix: [[1]]}", "the bound is 1x1, but there are 2 bounded states"),
        ("bound: {factor: 0.5}", "bound: {matrix: [[1, 2], [2, 1]]}", "bound is not positive semidefinite"),
        ("bound: {factor: 0.5}", "bound: {faktor: 0.5}", "did you mean 'factor'"),
        ("caps: 50", "caps: [1, 2, 3]", "caps has 3 entries, it needs 2 (one per sensor) or 4"),
        ("caps: 50", "caps: [1, -2]", "caps entry 2 is -2"),
        ("caps: 50", "caps: .inf", "it must be a number"),
        ("caps: 50", "prices: 0", "prices is 0"),
        ("caps: 50", "prices: [1, null]", "prices entry 2 is"),
        ("caps: 50", "fixed: fast", "fixed is"),
        ("{name: ukf}", "{name: ukff}", "unknown filter 'ukff'"),
        ("{name: ukf}", "{name: ukf, members: 4}", "'members' is no option of ukf"),
        ("{name: ukf}", "{name: enkf, members: 1}", "at least 2"),
        ("{name: ukf}", "{name: ukf, kappa: -9}", "kappa > -4"),
        ("{diag: [0.3, 0.2]}", "[[1, 0.5], [0.4, 1]]", "covariance is not symmetric"),
        ("{diag: [0.3, 0.2]}", "{diag: [0.3, 0]}", "is not positive definite"),
        ("mean: [0.5, 0]", "mean: [0.5]", "mean has 1 entries"),
        ("noise: {diag: [0, 0.01]}", "noise: {diag: [0, -0.01]}", "noise is not positive semidefinite"),
        ('["x2", "-sin(x1)"]', '["x2", "-sin(x3)"]', "unknown name 'x3'"),
        ('["x2", "-sin(x1)"]', '["x2"]', "f has 1 entries, the plant has 2 states"),
        ('["x1", "x1 + x2"]', "[]", "is empty"),
        ("names: [a, b]", "names: [a, a]", "used twice"),
        ("names: [a, b]", "names: [a]", "1 names for 2 sensors"),
        ("batch: 2", "batch: 0", "batch is 0"),
        ("batch: 2", "batch: 2\nmethod: newton", "unknown method 'newton'"),
        ("batch: 2", "batch: 2\nprune: {by: weight}", "prune.by is 'weight'"),
        ("batch: 2", "batch: 2\nbaches: 3", "unknown key 'baches'"),
        ("step: 0.1", "step: 0", "step is 0"),
        ("filter: {name: ukf}\n", "", "the problem has no 'filter'"),
        (
            "family: precision\n",
            "family: precision\nmoments: {state: 1, cross: 1, measurement: 1}\n",
            "does not go with moments",
        ),
    ],
)
def test_refusals_name_the_place(tmp_path, old, new, words):
    assert BASE.count(old) == 1
    with pytest.raises(ProblemError) as error:
        load(tmp_path, BASE.replace(old, new))
    text = str(error.value)
    assert words in text, text
    assert "p.yaml:" in text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("cross: [[0.8]]", "cross: [[0.8, 1]]", "cross is 1x2, but state is 1x1 and measurement 1x1"),
        ("cross: [[0.8]]", "cross: [[1.8]]", "together are not positive semidefinite"),
        ("measurement: [[0.5]]", "measurement: [[0.0]]", "has variance 0 but a covariance"),
        ("state: [[2.0]]", "state: [[2.0, 1.0]]", "state is 1x2, it must be square"),
        ("bound:", "batch: 2\nbound:", "moments are a single batch"),
    ],
)
def test_refusals_of_moments(tmp_path, old, new, words):
    with pytest.raises(ProblemError) as error:
        load(tmp_path, MOMENTS.replace(old, new))
    assert words in str(error.value)


def test_infeasible_exits_4_with_the_smallest_factor(run, tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(MOMENTS.replace("1.2", "0.6"), encoding="utf-8")
    code, out, _ = run("solve", path, "--out", tmp_path / "r", "--json")
    content = json.loads(out)
    assert code == 4 and content["status"] == "infeasible"
    assert abs(content["smallest_factor"] - 1.2) < 1e-12  # times the matrix that was given: 0.72
    assert "objective" not in content and "1.2" in content["message"]
    code, out, _ = run("solve", path, "--out", tmp_path / "r")
    assert code == 4 and "smallest" in out and not (tmp_path / "r" / "result.json").exists()
    assert run("check", path)[0] == 4


def test_infeasible_factor_is_in_the_users_terms(tmp_path):
    problem = load(tmp_path, BASE.replace("caps: 50", "caps: 0.1"))
    found = precision.solve(problem)
    assert found.status is Status.INFEASIBLE
    reachable = found.result["smallest_factor"]
    assert f"{reachable:.10g}" in found.message and reachable > 0.5
    again = load(tmp_path, BASE.replace("caps: 50", "caps: 0.1").replace("0.5}", f"{reachable * (1 + 1e-6)}}}"))
    assert precision.solve(again).status is Status.CERTIFIED


@pytest.mark.slow
def test_solve_simulate_filter_and_compare(run, tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(BASE + "batches: 3\n", encoding="utf-8")
    folder = tmp_path / "r"
    code, out, err = run("solve", path, "--out", folder)
    assert code == 0, out + err
    content = json.loads((folder / "result.json").read_text())
    assert len(content["precisions"]) == 12 and len(content["batches"]) == 3
    assert all(r["guarantee"] for r in content["batches"])
    assert np.isclose(content["objective"], sum(r["objective"] for r in content["batches"]))
    assert run("simulate", path, "--run", folder, "--out", tmp_path / "m.csv", "--seed", 3)[0] == 0
    assert run("filter", folder, tmp_path / "m.csv", "--out", tmp_path / "e.csv")[0] == 0
    truth = np.genfromtxt(tmp_path / "m.truth.csv", delimiter=",", names=True)
    estimate = np.genfromtxt(tmp_path / "e.csv", delimiter=",", names=True)
    assert len(estimate) == 3
    at_end = np.array([truth["x1"][2 * (k + 1)] for k in range(3)])
    assert np.all(np.abs(estimate["x1"] - at_end) < 5 * estimate["sd_x1"])
    code, out, _ = run("compare", path, "--out", tmp_path / "c", "--json")
    rows = {r["method"]: r for r in json.loads(out)["methods"]}
    assert abs(rows["barrier"]["cost"] - rows["clarabel"]["cost"]) < 1e-6 * rows["barrier"]["cost"]
    assert rows["uniform"]["cost"] > rows["barrier"]["cost"]


@pytest.mark.parametrize("extra", ["prune: true", "prune: {sensors: 2}", "prune: {exact: true}", "prune: {by: sensor}"])
def test_pruning_from_a_file(tmp_path, extra):
    problem = load(tmp_path, BASE.replace("batch: 2", "batch: 2\n" + extra))
    solution = precision.solve(problem)
    assert solution.status is Status.CERTIFIED
    assert solution.result["objective"] >= solution.result["lower_bound"]
    assert solution.result["pruning"]["reason"] and solution.result["relative_margin"] >= -1e-8
    assert solution.result["active"] <= 2 or extra != "prune: {sensors: 2}"


def test_no_set_small_enough_is_infeasible(tmp_path):
    text = (PROBLEMS / "moments_small.yaml").read_text() + "prune: {exact: true, sensors: 2}\n"
    found = precision.solve(load(tmp_path, text))
    assert found.status is Status.INFEASIBLE and "No 2 sensors can meet the bound" in found.message


def test_pruning_keeps_the_only_sensor_of_an_unstable_mode(tmp_path):
    text = """\
family: precision
plant: {f: ["1.2*x1", "0.5*x2"]}
measurement: {h: ["x1", "x2"]}
initial: {covariance: {identity: 2}}
filter: {name: ukf}
bound: {matrix: {diag: [1.43999, 0.05]}}
prune: true
"""
    found = precision.solve(load(tmp_path, text))
    assert found.result["precisions"][0] > 0 and found.result["pruning"]["refused"] == ["y1"]


def test_template_solves_as_it_stands(run, tmp_path):
    path = tmp_path / "precision.yaml"
    assert run("init", "precision", path)[0] == 0
    assert run("check", path)[0] == 0
    code, out, _ = run("solve", path, "--out", tmp_path / "r", "--json")
    assert code == 0 and json.loads(out)["status"] == "certified"
    assert (tmp_path / "r" / "figures" / "overview.png").exists()


def test_unstable_ensemble_is_a_failure_with_a_reason(run, tmp_path):
    text = BASE.replace('"-sin(x1)"', '"exp(40*x1**2)"').replace("mean: [0.5, 0]", "mean: [9, 9]")
    path = tmp_path / "p.yaml"
    path.write_text(text, encoding="utf-8")
    code, _, err = run("solve", path, "--out", tmp_path / "r")
    assert code == 6 and "is not finite at t = " in err and "more substeps" in err


def test_an_interrupt_keeps_the_batches_so_far(tmp_path):
    from occontrol.core.monitor import Monitor

    problem = load(tmp_path, BASE + "batches: 4\n")

    def stop_in_the_second(record):
        if record["stage"].startswith("batch 2") and record["iteration"] >= 4:
            monitor.interrupted = 2

    monitor = Monitor(show=stop_in_the_second)
    solution = precision.solve(problem, monitor=monitor)
    assert solution.status is Status.INTERRUPTED and "2 of 4 batches" in solution.message
    assert solution.arrays["precisions"].shape == (2, 4) and solution.result["relative_margin"] >= -1e-8


@pytest.mark.parametrize("extra", ["", "batches: 3\n", "prune: true\n", "prices: [1, 2]\n"])
def test_every_picture_is_drawn(tmp_path, extra):
    problem = load(tmp_path, BASE + extra)
    solution = precision.solve(problem)
    figures = precision.figures(problem, solution)
    wanted = {"batches: 3\n": {"overview", "sequence"}, "prune: true\n": {"overview", "pruning"}}.get(
        extra, {"overview"}
    )
    assert wanted >= set(figures) >= {"overview"}
    for figure in figures.values():
        figure.canvas.draw()
    assert precision.compare_figure(problem, {"barrier": solution}) is not None


def test_pictures_of_what_cannot_be_met(tmp_path):
    problem = load(tmp_path, BASE.replace("caps: 50", "caps: 0.1"))
    solution = precision.solve(problem)
    assert precision.figures(problem, solution) == {}
    assert precision.compare_figure(problem, {"barrier": solution}) is not None


@pytest.mark.parametrize("batches", [1, 2])
def test_a_bound_above_the_cost_is_shown_and_not_cut_to_the_cost(tmp_path, monkeypatch, batches):
    """Of one batch or, where the other batches' bounds would hide it in the sum, of the second."""
    problem, calls = load(tmp_path, BASE + f"batches: {batches}\n"), []
    honest = methods_module.solve_program

    def spoilt(*words, **more):
        found = honest(*words, **more)
        calls.append(found)
        factor = 1.01 if len(calls) == batches else 0.5
        return replace(found, lower_bound=factor * found.objective)

    monkeypatch.setattr(methods_module, "solve_program", spoilt)
    solution = precision.solve(problem)
    assert solution.status is Status.DISAGREES and solution.status.exit_code == 7 and len(calls) == batches
    wrong = calls[-1].objective
    words = f"the lower bound {1.01 * wrong:.10g} lies above the cost {wrong:.10g}"
    assert words in solution.message and ("batch 2: " in solution.message) == (batches == 2)
    if batches == 1:
        assert solution.numbers.lower_bound > solution.numbers.objective
    else:
        assert [r.status for r in solution.numbers.batches] == ["certified", "disagrees"]
