"""Every block of code in README and docs: problems are read, commands parsed, Python run, names of C looked up."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
import pytest
import typer
from ruamel.yaml import YAML

import occontrol as oc
from occontrol.api import export_run, write_run
from occontrol.cli.application import app
from occontrol.core.signal import as_signal
from occontrol.core.solution import Solution
from occontrol.families import template
from occontrol.studies.study_file import read_study
from tests.doc_blocks import ROOT, Block, blocks

BLOCKS = list(blocks())
READINGS = """\
family: athans
name: line
horizon: {steps: 8}
plant: {F: [[1, 1], [0, 1]], Q: {diag: [0.01, 0.02]}, initial: {mean: [0, 1], covariance: {diag: [4, 1]}}}
sensors:
  - {name: near, H: [[1, 0]], R: [[0.1]], cost: 0.2}
  - {name: far, H: [[1, 0]], R: [[1]], cost: 0.1}
objective: {output: [[1, 0]]}
"""
TARGETS = """\
target_models: {one: {A: [[0]], noise: [[0.1]], initial: {mean: [0], covariance: [[1]]}, running: [[1]]}}
targets: [{name: a, model: one}, {name: b, model: one}]
looks: [{resource: radar, C: [[1]], noise: [[0.1]]}]
"""
# what belongs to a part of a problem file that a page shows; D is the page's word for a matrix
AROUND = {
    "docs/criteria.md: objective: {output: D, crite": (READINGS, {"D": "[[1, 0], [0, 1]]"}),
    "docs/periodic.md: horizon: {infinite: true}": (READINGS, {"; or {infinite: true, step: 0.5}": "", ": 4}": ": 2}"}),
    "docs/periodic.md: horizon: {infinite: true, st": (f"family: athans\n{TARGETS}", {}),
    'docs/writing.md: noise: [["0.1 + 0.2*step(t -': ("", {}),
}
# printed by commands that take too long to be run here; numbers are looked at before a release
PRINTED = ("docs/robust.md", "docs/schedule_at_work.md")


def of_kind(kind: str) -> list:
    return [pytest.param(b, id=f"{b.page}:{b.line}") for b in BLOCKS if b.kind == kind]


def test_every_block_is_of_a_kind_that_is_looked_at() -> None:
    kinds = {block.kind for block in BLOCKS}
    assert kinds == {"python", "problem", "study", "part", "commands", "c", "printed", "formula"}
    assert {block.page for block in BLOCKS if block.kind == "printed"} <= set(PRINTED)
    assert {block.name for block in BLOCKS if block.kind == "part"} == set(AROUND)
    assert all(name in RUN for name in {b.name for b in BLOCKS if b.kind == "python"})
    assert len(BLOCKS) > 40


@pytest.mark.parametrize("block", of_kind("problem"))
def test_problems_are_read(tmp_path: Path, block: Block) -> None:
    (tmp_path / "p.yaml").write_text(block.text, encoding="utf-8")
    oc.read_problem(tmp_path / "p.yaml").require_feasible()


@pytest.mark.parametrize("block", of_kind("study"))
def test_studies_are_read(tmp_path: Path, block: Block) -> None:
    (tmp_path / "s.yaml").write_text(block.text.replace("base: ../", f"base: {ROOT}/problems/"), encoding="utf-8")
    assert len(read_study(tmp_path / "s.yaml").points) == 64  # as the page says


@pytest.mark.parametrize("block", of_kind("part"))
def test_parts_of_problems_are_read(tmp_path: Path, block: Block) -> None:
    base, changes = AROUND[block.name]
    text = block.text
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    yaml = YAML(typ="safe")
    if not base:  # formulas alone
        for formula in re.findall(r'"([^"]+)"', text):
            assert as_signal([[formula]]).at(1.0).shape == (1, 1)
        return
    whole = {**yaml.load(base), **yaml.load(text)}
    if whole["horizon"].get("infinite"):
        whole["sensors"] = [{**s, "cost": 0} for s in whole.get("sensors", [])] or None
        whole["objective"] = {k: v for k, v in (whole.get("objective") or {}).items() if k != "output"} or None
    with (tmp_path / "p.yaml").open("w", encoding="utf-8") as file:
        yaml.dump({key: value for key, value in whole.items() if value is not None}, file)
    assert oc.read_problem(tmp_path / "p.yaml").name


@pytest.mark.parametrize("block", of_kind("commands"))
def test_commands_have_these_options(block: Block) -> None:
    group = typer.main.get_command(app)
    assert isinstance(group, click.Group) or hasattr(group, "commands")
    for line in block.commands:
        words = shlex.split(line.split(" | ")[-1])
        if words[0] != "occontrol":
            named = words[1] if words[0] == "python" else words[0]
            assert words[0] == "sbatch" or (ROOT / named).exists(), line
            continue
        command = vars(group)["commands"][words[1]]
        command.make_context(words[1], list(words[2:]), resilient_parsing=False)
        for word in words[2:]:
            if word.startswith("problems/"):
                assert (ROOT / word).exists(), line


@pytest.mark.parametrize("block", of_kind("c"))
def test_names_of_c_are_in_the_header(tmp_path: Path, block: Block, small_solution: Solution) -> None:
    write_run(tmp_path / "two_radars", small_solution.problem, small_solution)
    header = next(p for p in export_run(tmp_path / "two_radars", "flight") if p.suffix == ".h").read_text()
    names = set(re.findall(r"oc_two_radars_\w+|OC_TWO_RADARS_\w+", block.text))
    assert len(names) > 6 and [name for name in sorted(names) if not re.search(rf"\b{name}\b", header)] == []


def _whole_run(folder: Path, solution: Solution) -> dict[str, object]:
    write_run(folder / "runs" / "tracking", solution.problem, solution)
    return {"read": lambda name: np.zeros(1)}


def _readme(folder: Path, solution: Solution) -> dict[str, object]:
    text = next(b.text for b in BLOCKS if b.page == "README.md" and b.kind == "problem")
    (folder / "two_radars.yaml").write_text(text.replace("intervals: 400", "intervals: 40"), encoding="utf-8")
    return {}


def _loop(folder: Path, solution: Solution) -> dict[str, object]:
    (folder / "problem.yaml").write_text(READINGS, encoding="utf-8")
    return {"read": lambda name: np.zeros(1), "act_on": lambda *what: None}


def _changed(folder: Path, solution: Solution) -> dict[str, object]:
    names = _loop(folder, solution)
    (folder / "without_the_east_station.yaml").write_text(READINGS.replace("0.2}", "0.3}"), encoding="utf-8")
    problem = oc.read_problem(folder / "problem.yaml")
    plan = oc.solve(problem).schedule
    return {**names, "oc": oc, "loop": oc.athans.ReplanningLoop(problem, plan, oc.athans.Replanning(every=5, gap=1e-3))}


def _shipped(folder: Path, solution: Solution) -> dict[str, object]:
    (folder / "problems").mkdir()
    shutil.copy(ROOT / "problems" / "oshman_example.yaml", folder / "problems")
    shutil.copy(template("robust"), folder / "problems" / "robust_vehicle.yaml")  # smaller, and a file of its family
    rows = {s.name: s.rows for s in oc.read_problem(folder / "problems" / "oshman_example.yaml").sensors}
    one = np.zeros(1)
    return {"read": lambda name: np.zeros(rows[name]), "read_sensor": lambda name: one, "print": lambda *what: None}


# what has to be there before the lines of a page run; None: another test runs them
RUN: dict[str, Callable[[Path, Solution], dict[str, object]] | None] = {
    "README.md: import occontrol as oc": _readme,
    "docs/montecarlo.md: import occontrol as oc": _loop,
    'docs/montecarlo.md: changed = oc.read_problem("w': _changed,
    "docs/oshman.md: import occontrol as oc": _shipped,
    "docs/robust.md: import occontrol as oc": _shipped,
    "docs/schedule_at_work.md: from occontrol.families.atha": None,  # test_docs_continuous
    "docs/schedule_at_work.md: import occontrol as oc": _whole_run,
}


@pytest.mark.parametrize("block", of_kind("python"))
def test_python_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: Block, small_solution: Solution
) -> None:
    prepare = RUN[block.name]
    if prepare is None:
        return
    names = prepare(tmp_path, small_solution)
    monkeypatch.chdir(tmp_path)
    exec(compile(block.text, block.page, "exec"), names)  # the text of our own documentation
    loop = names.get("loop") or names.get("filter")
    assert (tmp_path / "overview.png").exists() or loop is not None


def test_the_gallery_shows_what_its_problems_expect() -> None:
    sections = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8").split("\n## ")[1:]
    compared = 0
    for part in sections:
        name = part.split("\n", 1)[0]
        assert (ROOT / "docs" / "figures" / "gallery" / f"{name}.png").exists()
        expect = YAML(typ="safe").load(ROOT / "problems" / f"{name}.yaml").get("expect") or {}
        shown = re.search(r"^    (?:cost|trace|objective) +([0-9.e+-]+)", part, re.M)
        if "cost" in expect and shown:
            assert float(shown[1]) == pytest.approx(expect["cost"], rel=max(1e-3, expect.get("tolerance", 0)))
            compared += 1
    assert len(sections) >= 8 and compared >= 5
