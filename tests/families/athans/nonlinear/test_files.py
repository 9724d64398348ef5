"""Problem files with nonlinear plants: solved, written, read again, simulated, filtered, and refused in plain words."""

import json

import numpy as np
import pytest

from occontrol.api import document, plot, read_problem, read_run, run_filter, simulate, solve
from occontrol.cli import run
from occontrol.core.errors import ProblemError, UsageError
from tests.families.athans.nonlinear.cases import BEARINGS, PENDULUM, SENSED, STEPPED, read

TEXTS = {"bearings": BEARINGS, "pendulum": PENDULUM, "sensed": SENSED, "stepped": STEPPED}


@pytest.mark.parametrize("name", TEXTS)
def test_a_problem_is_written_and_read_again(name, tmp_path):
    problem = read(TEXTS[name], tmp_path)
    (tmp_path / "again.json").write_text(json.dumps(document(problem)))
    again = read_problem(tmp_path / "again.json")
    assert document(again) == document(problem)
    assert np.array_equal(again.upper, problem.upper)
    middle = float(np.mean(problem.edges)) if not problem.discrete else 3.0
    for a, b in zip(problem.sensors, again.sensors, strict=True):
        assert np.array_equal(a.C.at(middle), b.C.at(middle))


@pytest.mark.parametrize("name", TEXTS)
def test_a_run_holds_all_that_its_filter_needs(name, tmp_path, capsys):
    file = tmp_path / "case.yaml"
    file.write_text(TEXTS[name])
    folder, data, out = tmp_path / "run", tmp_path / "z.csv", tmp_path / "e.csv"
    assert run(["check", str(file)]) == 0
    said = capsys.readouterr().out
    assert "nonlinearity" in said and "of the problem linearised along the nominal path" in said
    assert run(["solve", str(file), "--out", str(folder), "--no-figures", "--method", "greedy"]) == 0
    said = capsys.readouterr().out
    assert "they bound nothing of the plant itself" in " ".join(said.split())
    stored = json.loads((folder / "result.json").read_text())
    assert stored["certificate_of"] == "linearised" and set(stored["nonlinearity"]) == {"readings", "predictions"}
    assert run(["simulate", str(file), "--run", str(folder), "--out", str(data), "--seed", "3"]) == 0
    for model in ("ekf", "iterated", "ukf"):
        assert run(["filter", str(folder), str(data), "--out", str(out), "--model", model, "--no-figures"]) == 0
        head = out.read_text().splitlines()[0].split(",")
        assert head[-1] == "nees" and "nis" in head
    if name != "sensed":  # it proves its bound anew, which takes longer than all the rest
        assert run(["certify", str(folder)]) == 0
        assert "linearised" in capsys.readouterr().out
    problem, solution = read_run(folder)
    measurements, truth = simulate(problem, solution, 3)
    estimate = run_filter(problem, solution, measurements)
    assert len(estimate.times) == len(truth.times)


def test_tables_and_pictures_say_whose_bound_they_show(tmp_path, capsys):
    file = tmp_path / "case.yaml"
    file.write_text(BEARINGS)
    assert run(["compare", str(file), "--methods", "greedy,best-single", "--out", str(tmp_path / "c")]) == 0
    assert "costs and bounds are of the problem linearised" in capsys.readouterr().out
    priced = PENDULUM.replace("samples: 30", "samples: 6")
    file.write_text(priced)
    assert run(["tradeoff", str(file), "--weights", "1e-3:1e-2:2", "--out", str(tmp_path / "t")]) == 0
    assert "costs and bounds are of the problem linearised" in capsys.readouterr().out
    assert json.loads((tmp_path / "t" / "tradeoff.json").read_text())["certificate_of"] == "linearised"
    problem = read(BEARINGS, tmp_path)
    figure = plot(solve(problem, "greedy"), figure="overview")
    texts = [*figure.texts, *(text for axes in figure.axes for text in axes.texts)]
    assert any("linearised" in text.get_text() for text in texts)


def test_linear_plants_say_that_their_certificate_is_of_the_problem(small_solution):
    assert small_solution.result["certificate_of"] == "problem"
    assert "nonlinearity" not in small_solution.result


REFUSED = {
    'f: [rate, "-9.81*sin(angle) - 0.1*rate"]': [
        ("f: [rate]", "2 states"),
        ('f: [rate, "-9.81*sin(angel)"]', "did you mean 'angle'?"),
        ("f: [rate, \"__import__('os').system('true')\"]", "calls something that is not a plain function"),
        ('f: [rate, "rate.real"]', "attributes are not allowed"),
        ('f: [rate, "1/(t-3)"]', "the nominal path, or its derivative, is not finite after t ="),
        ('f: [rate, "exp(exp(5*rate + 9))"]', "not finite after t ="),
        ("next: [rate, angle]", "next is the state one step later, and the horizon is of times"),
        ("f: [rate, angle]\n  next: [rate, angle]", "the plant has both 'f' and 'next'"),
        ("f: [rate, angle]\n  parameters: {angle: {mean: 1, sd: 1}}", "the state name 'angle' stands twice"),
        ("f: [rate, angle]\n  parameters: {p: {mean: 1, sd: -1}}", "parameter 'p' has no usable 'sd'"),
        ("f: [rate, angle]\n  stats: [a, b]", "did you mean 'states'?"),
    ],
    "covariance: {diag: [0.04, 0.04]}": [
        ("covariance: none", "covariance is none, and a nonlinear plant is linearised from what is known at the start"),
        ("covariance: {diag: [1]}", "covariance is 1x1, it must be 2x2"),
    ],
    "states: [angle, rate]": [
        ("states: [angle, sin]", "the state name 'sin' is a function of formulas"),
        ("states: [angle, t]", "the state name 't' is time in formulas"),
        ("states: [angle, 'a b']", "the name of state 2 is 'a b'"),
        ("states: [angle]", "uses the unknown name 'rate'"),
    ],
    'visible: "0.7 - abs(angle)"': [
        ('visible: "angle - 9"', "sensor 'camera' never sees the nominal path"),
        ("visible: [1, 2]", "visible of sensor 'camera' has 2 entries"),
        ("angle: [true]", "angle of sensor 'camera' has 1 entries, its h has 2 values"),
        ("every: 2", "every belongs to continuous sensing"),
    ],
    'noise: {diag: ["0.0004*(1 + angle**2)", 0.0004]}': [
        ("noise: [[0.1]]", "noise of sensor 'camera' is 1x1, its h has 2 values"),
        ('noise: {diag: ["angle", 0.0004]}', "not positive definite"),
        ('noise: {diag: ["1/angel", 0.0004]}', "did you mean 'angle'?"),
        ("variance: {diag: [1, 1]}\n    noise: {diag: [1, 1]}", "sensor 'camera' has noise and variance"),
    ],
    "objective: {": [
        ("integrator: {substeps: 0}\nobjective: {", "integrator.substeps is 0"),
        ("integrator: {substeps: 2, accuracy: 1.0e-6}\nobjective: {", "both 'substeps' and 'accuracy'"),
        ("replan: {every: 0}\nobjective: {", "replan.every is 0"),
        ("replan: {estimator: kf}\nobjective: {", "replan.estimator is 'kf'"),
    ],
}


@pytest.mark.parametrize(("old", "new", "words"), [(a, b, c) for a, rest in REFUSED.items() for b, c in rest])
def test_refusals_name_the_place_and_the_cause(old, new, words, tmp_path):
    assert old in PENDULUM
    with pytest.raises(ProblemError) as error:
        read(PENDULUM.replace(old, new, 1), tmp_path)
    assert words in str(error.value)
    assert "case.yaml:" in str(error.value)


def test_a_rate_of_change_does_not_count_steps(tmp_path):
    with pytest.raises(ProblemError, match="f is a rate of change, and the horizon counts steps"):
        read(STEPPED.replace("next:", "f:"), tmp_path)


def test_an_unknown_filter_is_refused(tmp_path):
    problem = read(BEARINGS, tmp_path)
    solution = solve(problem, "greedy")
    with pytest.raises(UsageError, match="there is no filter 'split'"):
        run_filter(problem, solution, [], model="split")
    with pytest.raises(UsageError, match="gate is 2"):
        run_filter(problem, solution, [], gate=2.0)
