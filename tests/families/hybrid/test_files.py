"""Problem files of the hybrid family: read, written back, refused with a place, and their expected values."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag

from occontrol.api import compare_figure, document, figures_of, read_problem, read_run, write_run
from occontrol.core.errors import ProblemError
from occontrol.families.hybrid.family import FAMILY as hybrid
from occontrol.families.hybrid.methods import Scheduled
from occontrol.files.plain_json import to_json

ROOT = Path(__file__).resolve().parents[3]
NAMES = ("turning_target", "guarded_thermostat", "four_radars")
TARGET = (ROOT / "problems" / "turning_target.yaml").read_text(encoding="utf-8")
ROOM = (ROOT / "problems" / "guarded_thermostat.yaml").read_text(encoding="utf-8")


def _plain():
    spec = importlib.util.spec_from_file_location("plain_jump", Path(__file__).with_name("plain_jump.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


plain = _plain()


def plain_first_scores(problem) -> list[float]:
    """The criterion of every group at k = 1 without the package's numerics."""
    plant = problem.plant
    modes = len(plant.modes)
    means, covariances = [plant.mean] * modes, [plant.covariance] * modes
    transition = plant.transition_matrix
    if plant.guards is not None:
        guards = [(plant.names.index(g.source), plant.names.index(g.target), g.L, g.b) for g in plant.guards]
        transition = plain.guard_matrix(means, covariances, guards, plant.threshold.mean, plant.threshold.covariance)
    A, Q = [m.A.at(1) for m in plant.modes], [m.F.at(1) @ m.W.at(1) @ m.F.at(1).T for m in plant.modes]
    drift = [0.0 if m.B is None else (m.B.at(1) @ m.input.at(1))[:, 0] for m in plant.modes]
    c, xs, Ps = plain.predict(transition, A, Q, drift, means, covariances, plant.probabilities)
    scores = []
    for group in problem.groups:
        sensors = [problem.sensors[problem.sensors.index(name)] for name in group]
        C, R = np.vstack([s.C.at(1) for s in sensors]), block_diag(*[s.R.at(1) for s in sensors])
        variance = plain.position_variance(c, Ps, C, R, problem.position)
        scores.append(plain.bound(c, xs, Ps, C, R) + problem.position_weight * variance)
    return scores


@pytest.mark.parametrize("name", NAMES)
def test_expected_values_by_two_routes(name):
    problem = read_problem(ROOT / "problems" / f"{name}.yaml")
    expect = problem.expect
    found = list(hybrid.solve(problem, Scheduled()).result["first_scores"].values())
    assert found == pytest.approx(expect["first_scores"], abs=expect["tolerance"])
    assert plain_first_scores(problem) == pytest.approx(expect["first_scores"], abs=expect["tolerance"])


@pytest.mark.parametrize("name", NAMES)
def test_documents_read_back_identically(name, tmp_path):
    problem = read_problem(ROOT / "problems" / f"{name}.yaml")
    text = to_json(document(problem))
    (tmp_path / "problem.json").write_text(text, encoding="utf-8")
    again = read_problem(tmp_path / "problem.json")
    assert to_json(document(again)) == text
    one, two = (hybrid.solve(p, Scheduled()).result for p in (problem, again))
    assert one == two


@pytest.mark.parametrize("name", NAMES)
def test_every_method_on_every_problem_with_figures(name, tmp_path):
    problem = read_problem(ROOT / "problems" / f"{name}.yaml")
    solutions = {method: hybrid.solve(problem, kind()) for method, kind in hybrid.methods.items()}
    assert list(figures_of(problem, solutions["scheduled"])) == ["overview", "trajectory", "rms", "modes", "sensors"]
    assert compare_figure(problem, solutions) is not None
    write_run(tmp_path / "run", problem, solutions["fixed"])
    again, solution = read_run(tmp_path / "run")
    assert solution.result["average_rms"] == solutions["fixed"].result["average_rms"]
    measurements, _ = hybrid.simulate(again, solution, 1)
    estimate = hybrid.run_filter(again, solution, measurements)
    assert np.all(np.isfinite(estimate.mean))


def test_the_template_solves_as_it_stands():
    problem = read_problem(ROOT / "occontrol" / "families" / "hybrid" / "template.yaml")
    found = {name: hybrid.solve(problem, kind()).result for name, kind in hybrid.methods.items()}
    assert found["scheduled"]["mode_errors"] < found["alternate"]["mode_errors"]


REFUSALS = [
    (TARGET, "[0.6, 0.2, 0.2], [0.2, 0.6, 0.2]", "[0.6, 0.2, 0.2], [-0.2, 1.0, 0.2]", "negative entry -0.2 for 'LT'"),
    (TARGET, "[0.2, 0.2, 0.6]]", "[0.2, 0.2, 0.5]]", "row 3 of the transition matrix (from 'CV') sums to 0.9"),
    (TARGET, "matrix:", "matrx:", "unknown key 'matrx' in transition"),
    (TARGET, '["1/3", "1/3", "1/3"]', "[0.5, 0.5]", "probabilities has 2 entries, it must have 3"),
    (TARGET, "name: RT", "name: LT", "the name 'LT' is used twice"),
    (TARGET, "position: [0, 2]", "position: [0, 4]", "position names component 4 of the state"),
    (TARGET, "name: scheduled", "name: fixed, sensor: three", "there is no sensor or group 'three'"),
    (TARGET, "name: bhattacharyya", "name: chernoff", "unknown criterion 'chernoff'"),
    (TARGET, "criterion:", "groups: [[one], [tow]]\ncriterion:", "did you mean 'two'?"),
    (TARGET, "C: [[1, 0, 0, 0.1], [0, 1, 0.1, 0]]", "C: [[1, 0, 0], [0, 1, 0]]", "C of sensor 'one' is 2x3"),
    (TARGET, "seed: 1", "seed: 1, truth: {mode: XX}", "the truth begins in the unknown mode 'XX'"),
    (ROOM, "L: [[-1, 0, 0, 1]]", "L: [[-1, 0, 0]]", "has 3 columns, it must have 4"),
    (ROOM, "L: [[-1, 0, 0, 1]], b: [0]", "L: [[-1, 0, 0, 1]], b: [0, 1]", "has length 2, L has 1 row"),
    (ROOM, 'to: "off"', 'to: "of"', "did you mean 'off'?"),
    (ROOM, "guards:", "matrix: {identity: 2}\n  guards:", "transition has both a matrix and guards"),
    (ROOM, '- {from: "off"', '- {form: "off"', "did you mean 'from'?"),
    (ROOM, '5+4*sin(2*pi*k/1440)"]', '5/(k-3)"]', "input of mode 'off' is not finite at k = 3"),
]


@pytest.mark.parametrize(("text", "old", "new", "words"), REFUSALS)
def test_refusals_name_the_place(text, old, new, words, tmp_path):
    assert old in text
    path = tmp_path / "bad.yaml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ProblemError) as caught:
        read_problem(path)
    message = str(caught.value)
    assert words in message
    changed = [i for i, line in enumerate(path.read_text().splitlines(), 1) if line not in text.splitlines()]
    lines = [int(m.place.split(":")[-2]) for m in caught.value.mistakes]
    assert any(abs(line - place) <= 2 for line in changed for place in lines), (changed, lines)


def test_an_unreachable_mode_is_refused_with_its_place(tmp_path):
    text = TARGET.replace("[[0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.2, 0.6]]", "{identity: 3}")
    path = tmp_path / "bad.yaml"
    path.write_text(text.replace('["1/3", "1/3", "1/3"]', "[1, 0, 0]"), encoding="utf-8")
    with pytest.raises(ProblemError) as caught:
        read_problem(path)
    assert [m.path for m in caught.value.mistakes] == [("modes", 1), ("modes", 2)]
    assert "mode 'RT' can never be reached" in str(caught.value)
