"""Constants, names of states, block_diag and kron in problem files: what is built, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag

import occontrol as oc
from occontrol.core.errors import ProblemError
from occontrol.families import find_family
from occontrol.files.plain_json import to_json

TEXT = """
family: athans
constants: {{q: 0.3, drag: "2*q", e1: -2}}
horizon: {{start: 0, end: 2, intervals: 4}}
plant:
  states: [x, y, vx, vy]
  A: {A}
  noise: {noise}
  initial: {{mean: [0, "q/2", 1, 0], covariance: {{identity: 4, scale: drag}}}}
sensors:
  - {{name: a, C: [x, "y - drag*vy"], noise: {{diag: [q, "1e1*q"]}}, cost: "drag*sin(t)**2 + e1**2"}}
objective: {{output: [x, "vx - vy"]}}
"""
GOOD = {
    "A": "{kron: [[[0, 1], [0, -drag]], {identity: 2}]}",
    "noise": "{block_diag: [{diag: [0, 0]}, {kron: [q, [[1, 0], [0, 1]]]}]}",
}


def read(tmp_path: Path, text: str) -> oc.SchedulingProblem:
    path = tmp_path / "p.yaml"
    path.write_text(text)
    return oc.read_problem(path)  # type: ignore[return-value]


def refusal(tmp_path: Path, text: str) -> str:
    with pytest.raises(ProblemError) as caught:
        read(tmp_path, text)
    return str(caught.value)


def test_constants_names_and_blocks_build_the_plain_matrices(tmp_path: Path) -> None:
    problem = read(tmp_path, TEXT.format(**GOOD))
    plant, sensor = problem.plant, problem.sensors[0]
    assert np.array_equal(plant.A.at(0), np.kron([[0, 1], [0, -0.6]], np.eye(2)))
    assert np.array_equal(plant.noise.at(0), block_diag(np.zeros((2, 2)), 0.3 * np.eye(2)))
    assert plant.A.constant and plant.noise.constant and sensor.C.constant
    assert np.array_equal(plant.mean, [0, 0.15, 1, 0]) and np.array_equal(plant.covariance, 0.6 * np.eye(4))
    assert np.array_equal(sensor.C.at(0), [[1, 0, 0, 0], [0, 1, 0, -0.6]])
    assert np.array_equal(problem.output.at(0), [[1, 0, 0, 0], [0, 0, 1, -1]])
    assert sensor.noise.at(0)[1, 1] == 3.0
    assert sensor.cost.at(0.7)[0, 0] == pytest.approx(0.6 * np.sin(0.7) ** 2 + 4, rel=1e-15)


def test_the_written_document_needs_no_constants_and_keeps_names(tmp_path: Path) -> None:
    problem = read(tmp_path, TEXT.format(**GOOD))
    document = find_family("athans").schema().document(problem)
    assert "constants" not in document and document["plant"]["states"] == ["x", "y", "vx", "vy"]
    again = tmp_path / "again.json"
    again.write_text(to_json(document))
    assert find_family("athans").schema().document(oc.read_problem(again)) == document


@pytest.mark.parametrize(
    ("parts", "value"),
    [
        ("{kron: [[[1, 2]], [[3], [4]]]}", np.kron([[1, 2]], [[3], [4]])),
        ("{kron: [{identity: 2}, [[1]], [[0, 5]]]}", np.kron(np.eye(2), [[0, 5]])),
        ("{block_diag: [[[1, 2]], 3, [[4], [5]]]}", block_diag([[1, 2]], 3, [[4], [5]])),
        ("{block_diag: [{block_diag: [1, 2]}, {kron: [2, {diag: [1, 3]}]}]}", np.diag([1, 2, 2, 6])),
    ],
)
def test_blocks_are_those_of_scipy_and_numpy(tmp_path: Path, parts: str, value: np.ndarray) -> None:
    text = f"""
family: athans
horizon: {{end: 1, intervals: 2}}
plant: {{A: {{identity: {value.shape[1]}}}, noise: {{identity: {value.shape[1]}}},
  initial: {{covariance: {{identity: {value.shape[1]}}}}}}}
sensors: [{{name: a, C: {parts}, noise: {{identity: {value.shape[0]}}}}}]
objective: {{output: {{identity: {value.shape[1]}}}}}
"""
    assert np.array_equal(read(tmp_path, text).sensors[0].C.at(0), value)  # type: ignore[attr-defined]


def test_formulas_in_blocks_multiply(tmp_path: Path) -> None:
    A = '{kron: [[["sin(t)", 0], ["1+t", -2]], [["t", 1], [0, "exp(-t)"]]]}'
    problem = read(tmp_path, TEXT.format(A=A, noise=GOOD["noise"]))
    t = 0.83
    expected = np.kron([[np.sin(t), 0], [1 + t, -2]], [[t, 1], [0, np.exp(-t)]])
    assert np.allclose(problem.plant.A.at(t), expected, rtol=1e-15, atol=0)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("q: 0.3", "q: [1]", "3:16: the constant 'q' is a list, it must be a number or a formula"),
        ("q: 0.3", "t: 0.3, q: 1", "3:13: the constant 't' cannot have this name\n  hint: 't' is time in formulas"),
        ("q: 0.3", "x: 1, q: 0.3", "3:13: the constant 'x' cannot have this name\n  hint: 'x' is a state of the plant"),
        ("q: 0.3", 'q: "drag+1"', "uses 'drag', which needs 'q'|uses 'q', which needs 'drag'"),
        ("q: 0.3", "q: 0.3, r: 9e300*9e300", "3:24: the constant 'r' is infinite, it must be finite"),
        ("q: 0.3", "q: 0.3, r: 1+t", "uses the unknown name 't'"),
        ('"vx - vy"', '"vx*vy"', "output row 2: 'vx\\*vy' is not linear in the states"),
        ('"vx - vy"', "vz", "uses the unknown name 'vz'\n  hint: known names: x, y, vx, vy, t, q"),
        ("[x, y, vx, vy]", "[x, y, vx]", "6:11: states has 3 entries, the plant has 4 states"),
        ("{identity: 2}]", "[[1, 2], [3]]]", "A.kron\\[2\\]: row 2 has 1 entries, row 1 has 2"),
        ("{identity: 2}]", "{identity: 999}]", "kron makes a matrix of 1998x1998, the limit is 1000 each way"),
        ("block_diag: [{diag", "block_diag: [{dieg", "unknown|must be a number"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, what: str) -> None:
    text = TEXT.format(**GOOD)
    assert old in text
    message = refusal(tmp_path, text.replace(old, new))
    assert re.search(what, message), message


def test_kron_does_not_fill_the_memory_with_formulas(tmp_path: Path) -> None:
    long = "+".join(["sin(t)"] * 300)
    row = f"[{', '.join(['t+1'] * 50)}]"
    A = f'{{kron: [[["{long}"]], [{", ".join([row] * 50)}]]}}'
    assert "kron makes formulas of" in refusal(tmp_path, TEXT.format(A=A, noise=GOOD["noise"]))
