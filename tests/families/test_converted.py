"""One plant in several families: what they share is equal to rounding, the rest is left behind with a word."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

import occontrol as oc
from occontrol.api import converted, problem_of
from occontrol.core.conversion import Asked
from occontrol.core.errors import UsageError

TEXT = """\
family: athans
name: pendulum
horizon: {start: 1, end: 4, intervals: 6, accuracy: 1.0e-8}
plant:
  A: [[0, 1], [-1, -0.4]]
  noise: [[0.05, 0.02], [0.02, 0.5]]
  initial: {mean: [1, 0], covariance: [[2, 0.3], [0.3, 1]]}
sensors:
  - {name: angle, C: [[1, 0]], noise: [[0.1]], cost: 2.0}
  - {name: both, C: [[1, 0], [0, 1]], noise: [[0.4, 0.1], [0.1, 0.3]]}
objective: {output: [[1, 0], [0, 1]], cost_weight: 0}
"""


def problem_in(folder: Path, text: str = TEXT) -> oc.SchedulingProblem:
    """The problem of a text."""
    path = folder / "pendulum.yaml"
    path.write_text(text, encoding="utf-8")
    return oc.read_problem(path)


def test_a_selection_has_the_plant_of_a_step_and_readings_of_the_same_information(tmp_path: Path) -> None:
    document, remarks = converted(problem_in(tmp_path), "vlambda", Asked(step=0.25))
    A, Xi = np.array([[0, 1], [-1, -0.4]]), np.array([[0.05, 0.02], [0.02, 0.5]])
    block = scipy.linalg.expm(0.25 * np.block([[-A, Xi], [np.zeros((2, 2)), A.T]]))  # Van Loan
    F = block[2:, 2:].T
    np.testing.assert_allclose(document["plant"]["F"], F, rtol=1e-12)
    np.testing.assert_allclose(document["plant"]["Q"], F @ block[:2, 2:], rtol=1e-10)
    assert document["horizon"] == {"steps": 12}
    np.testing.assert_allclose(document["sensors"][0]["R"], [[0.4]], rtol=1e-14)
    assert any("prices" in remark for remark in remarks) and problem_of(document).family == "vlambda"


def test_the_worst_set_without_uncertainty_has_the_covariance_as_its_shape(tmp_path: Path) -> None:
    problem = problem_in(tmp_path)
    document, _ = converted(problem, "robust", Asked(level=2.0, slots=6))
    sequence = ["angle", "both", "both", "angle", "angle", "both"]
    other = problem_of(document)
    worst = oc.solve(other, oc.robust.Fixed(tuple(sequence)))
    weights = np.array([[name == s for s in ("angle", "both")] for name in sequence], dtype=float)
    mean_square = oc.certify(problem, oc.Schedule(problem.edges, weights, ("angle", "both")))
    assert worst.result["cost"] == pytest.approx(2.0 * mean_square.result["prediction_error"], rel=1e-6)


def test_the_way_back_is_the_same_problem(tmp_path: Path) -> None:
    problem = problem_in(tmp_path)
    there, _ = converted(problem, "robust", Asked(level=1.0, slots=6))
    back, remarks = converted(problem_of(there), "athans")
    again = problem_of(back)
    np.testing.assert_allclose(again.plant.noise.at(0.0), problem.plant.noise.at(0.0), rtol=1e-12)
    np.testing.assert_allclose(again.plant.covariance, problem.plant.covariance, rtol=1e-12)
    information = [s.C.at(0.0).T @ np.linalg.solve(s.noise.at(0.0), s.C.at(0.0)) for s in problem.sensors]
    for sensor, expected in zip(again.sensors, information, strict=True):
        np.testing.assert_allclose(sensor.C.at(0.0).T @ sensor.C.at(0.0), expected, rtol=1e-12)
    assert any("level" in remark for remark in remarks)


def test_a_plant_that_varies_goes_over_as_tables(tmp_path: Path) -> None:
    text = TEXT.replace("[-1, -0.4]", '["-1-0.2*sin(t)", -0.4]').replace("noise: [[0.1]]", 'noise: [["0.1+0.02*t"]]')
    document, _ = converted(problem_in(tmp_path, text), "vlambda", Asked(step=0.5))
    assert document["plant"]["F"]["times"] == list(range(6))
    noise = (0.1 + 0.02 * (1 + 0.5 * np.arange(6))) / 0.5
    np.testing.assert_allclose(np.ravel(document["sensors"][0]["R"]["values"]), noise)
    assert problem_of(document).steps == 6


def test_robust_becomes_a_selection_by_way_of_athans() -> None:
    problem = oc.read_problem(Path(__file__).resolve().parents[2] / "problems" / "robust_oscillator.yaml")
    end = float(problem.edges[-1])
    document, remarks = converted(problem, "vlambda", Asked(step=end / 20))
    assert document["horizon"]["steps"] == 20
    assert any(remark.startswith("K is left behind") for remark in remarks)


@pytest.mark.parametrize(
    ("family", "asked", "text", "words"),
    [
        ("vlambda", Asked(), TEXT, "--step H, the time between two readings"),
        ("vlambda", Asked(step=0.7), TEXT, "not a whole number of steps of 0.7\n  hint: --step 0.75"),
        ("robust", Asked(), TEXT, "--level D"),
        ("robust", Asked(level=1, slots=3), TEXT.replace("cost: 2.0", "windows: [[1, 2]]"), "has no windows"),
        ("robust", Asked(level=1, slots=3), TEXT + "select: 2\n", "one sensor at a time, this problem 2"),
        ("hybrid", Asked(), TEXT, "does not become one of family hybrid"),
        ("athans", Asked(), TEXT, "of family athans already"),
        ("vlamda", Asked(), TEXT, "did you mean 'vlambda'?"),
    ],
)
def test_what_has_no_way_is_refused_with_what_is_missing(
    tmp_path: Path, family: str, asked: Asked, text: str, words: str
) -> None:
    with pytest.raises(UsageError) as caught:
        converted(problem_in(tmp_path, text), family, asked)
    assert words in str(caught.value)
