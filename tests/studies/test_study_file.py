"""What a study file may say, what its points are, and what is refused with which words."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest

from occontrol.core.errors import ProblemError
from occontrol.studies import read_study
from occontrol.studies.tasks import plan
from tests.studies.study_texts import BASE, VARY, write_study


def said(folder: Path, text: str, base: str = BASE) -> str:
    """The words with which a study is refused, its path left out."""
    with pytest.raises(ProblemError) as caught:
        plan(read_study(write_study(folder, text, base)))
    return str(caught.value).replace(f"{folder}/", "")


def test_a_product_has_every_combination_in_the_order_of_the_file(tmp_path: Path) -> None:
    study = read_study(write_study(tmp_path))
    assert list(study.axes) == ["sensors.fine.noise", "objective.cost_weight"]
    assert [list(p.values()) for p in study.points] == [[n, w] for n in ([[0.1]], [[0.2]]) for w in (0.01, 0.1, 1)]
    assert study.folder == tmp_path / "study"


def test_spread_values_are_those_of_their_scale(tmp_path: Path) -> None:
    text = "base: base.yaml\nvary: {objective.cost_weight: {from: 1, to: 3, points: 5}}\n"
    study = read_study(write_study(tmp_path, text))
    assert study.axes["objective.cost_weight"] == (1.0, 1.5, 2.0, 2.5, 3.0)
    text = "base: base.yaml\nvary: {objective.cost_weight: {from: 2, to: 0.5, points: 7, scale: log}}\n"
    values = read_study(write_study(tmp_path, text)).axes["objective.cost_weight"]
    assert values[0] == 2 and values[-1] == 0.5
    ratios = [math.log(b / a) for a, b in pairwise(values)]
    assert max(ratios) - min(ratios) < 1e-10


def test_zip_takes_values_side_by_side_and_list_takes_whole_points(tmp_path: Path) -> None:
    text = "base: base.yaml\ncombine: zip\nvary: {objective.cost_weight: [1, 2], sensors.fine.cost: [3, 4]}\n"
    points = read_study(write_study(tmp_path, text)).points
    assert [list(p.values()) for p in points] == [[1, 3], [2, 4]]
    text = "base: base.yaml\ncombine: list\nvary:\n  - {objective.cost_weight: 1}\n  - {objective.cost_weight: 5}\n"
    assert [list(p.values()) for p in read_study(write_study(tmp_path, text)).points] == [[1], [5]]


def test_every_task_is_the_problem_with_its_value(tmp_path: Path) -> None:
    tasks = plan(read_study(write_study(tmp_path)))
    found = {(t.document["sensors"][0]["noise"][0][0], t.document["objective"]["cost_weight"]) for t in tasks}
    assert found == {(n, w) for n in (0.1, 0.2) for w in (0.01, 0.1, 1.0)}
    assert len({t.identity for t in tasks}) == 6


def test_a_task_is_known_by_what_it_asks_and_not_by_its_name(tmp_path: Path) -> None:
    first = plan(read_study(write_study(tmp_path)))
    renamed = plan(read_study(write_study(tmp_path, base=BASE.replace("thermometer", "oven"))))
    changed = plan(read_study(write_study(tmp_path, base=BASE.replace("end: 4", "end: 4.5"))))
    solved_otherwise = plan(read_study(write_study(tmp_path, base=BASE.replace("polish: 20", "polish: 21"))))
    identities = [t.identity for t in first]
    assert [t.identity for t in renamed] == identities
    assert not {t.identity for t in changed} & set(identities)
    assert not {t.identity for t in solved_otherwise} & set(identities)


def test_options_that_another_method_lacks_are_dropped_and_others_kept(tmp_path: Path) -> None:
    text = "base: base.yaml\nvary: {method.name: [schedule, greedy, hminimal, best-single]}\n"
    methods = [t.document["method"] for t in plan(read_study(write_study(tmp_path, text)))]
    assert [m["name"] for m in methods] == ["schedule", "greedy", "hminimal", "best-single"]
    assert [m.get("polish") for m in methods] == [20, None, None, None]
    assert all(m["relative_gap"] == 1e-3 for m in methods)


def test_an_option_that_the_study_itself_gives_a_method_that_lacks_it_is_refused(tmp_path: Path) -> None:
    text = "base: base.yaml\nvary: {method.name: [schedule, greedy], method.polish: [3]}\n"
    assert "unknown option 'polish' of method 'greedy'" in said(tmp_path, text)


def test_what_the_base_leaves_out_can_vary_too(tmp_path: Path) -> None:
    text = "base: base.yaml\nvary: {constraints.max_switches: [2, 4], sensors.coarse.windows: [[[0, 2]]]}\n"
    tasks = plan(read_study(write_study(tmp_path, text, BASE.replace("method:", "# method:"))))
    assert [t.document["constraints"]["max_switches"] for t in tasks] == [2, 4]
    assert all(t.document["sensors"][1]["windows"] == [[0, 2]] for t in tasks)


def test_an_entry_of_a_matrix_is_reached_by_numbers(tmp_path: Path) -> None:
    text = "base: base.yaml\nvary: {'plant.A[0][0]': [-1, -2], sensors.0.cost: [7]}\n"
    tasks = plan(read_study(write_study(tmp_path, text)))
    assert [t.document["plant"]["A"] for t in tasks] == [[[-1]], [[-2]]]
    assert all(t.document["sensors"][0]["cost"] in (7, [[7]]) for t in tasks)


def test_seeds_make_tasks_where_something_is_random_and_are_refused_elsewhere(tmp_path: Path) -> None:
    text = "base: base.yaml\nvary: {method.name: [random]}\nseeds: [1, 2, 3]\n"
    tasks = plan(read_study(write_study(tmp_path, text)))
    assert [(t.seed, t.document["method"]["seed"]) for t in tasks] == [(1, 1), (2, 2), (3, 3)]
    words = said(tmp_path, "base: base.yaml\nseeds: [1, 2]\n")
    assert "study.yaml:2:8: nothing in this problem of family athans is random: a seed changes no number" in words


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vary: {a: [1]}\n", "study.yaml:1:1: the problem has no 'base'"),
        (VARY + "jobs: 3\n", "study.yaml:5:1: unknown key 'jobs'"),
        (VARY.replace("sensors.fine", "sensors.fin"), "study.yaml:3:3: sensors of the base problem has nothing"),
        (VARY.replace("sensors.fine", "sensors.fin"), "did you mean 'fine'?"),
        (VARY.replace("objective.cost", "objektive.cost"), "study.yaml:4:3: the base problem has no 'objektive'"),
        (VARY.replace("cost_weight", "cost_wait"), "unknown key 'cost_wait'"),
        (VARY.replace("scale: log", "scale: cubic"), "scale is the text 'cubic', it must be 'linear' or 'log'"),
        (VARY.replace("from: 0.01", "from: 0"), "scale: log needs 'from' and 'to' above 0"),
        (VARY.replace("points: 3", "points: 0"), "points is 0, it must be >= 1"),
        (VARY.replace("[[[0.1]], [[0.2]]]", "[]"), "study.yaml:3:23: sensors.fine.noise has no values"),
        (VARY.replace("[[[0.1]], [[0.2]]]", "3"), "it must be a list of values"),
        (VARY.replace("[[[0.1]], [[0.2]]]", "[[[-0.1]]]"), "study.yaml:3:24: sensors.fine.noise = [[-0.1]]"),
        (VARY + "combine: zip\n", "combine: zip needs as many values of each: sensors.fine.noise has 2"),
        (VARY + "combine: list\n", "combine: list needs a list of points"),
        (VARY + "seeds: [1, 1]\n", "a seed stands twice"),
        (VARY.replace("[[[0.1]], [[0.2]]]", "[[[0.1]], [[0.1]]]"), "is the same problem as another"),
        (VARY.replace("points: 3", "points: 9999").replace("]]]", "]], " + "[[0.3]], " * 20 + "]"), "than 100000"),
        (BASE, "this is a problem file, not a study"),
        (VARY.replace("sensors.fine.noise", "'sensors..noise'"), "'sensors..noise' is not a path"),
        (VARY.replace("sensors.fine.noise", "horizon.end.far"), "'horizon.end' of the base problem holds"),
    ],
)
def test_mistakes_are_named_with_their_line_and_a_hint(tmp_path: Path, text: str, words: str) -> None:
    assert words in said(tmp_path, text)


def test_what_is_wrong_in_the_base_is_said_at_its_place_there(tmp_path: Path) -> None:
    words = said(tmp_path, VARY, BASE.replace("0.2]], cost: 0.4", "-0.2]], cost: 0.4"))
    assert words.startswith("base.yaml:6:35: noise of sensor 'fine' is not positive definite")
