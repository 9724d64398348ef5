"""A study file -> a Study: the base problem, what varies, and every point of it as a problem that was checked.

    base: problem.yaml
    vary:
      sensors.range.noise: [0.1, 0.2]
      objective.cost_weight: {from: 0.001, to: 10, points: 8, scale: log}
    combine: product          # zip: the values side by side; list: the values of `vary` are whole points
    seeds: [1, 2, 3]
    warm_start: objective.cost_weight     # each point begins at its neighbour's result along this axis
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from occontrol.core.errors import Collector, Mistake, ProblemError
from occontrol.core.kinds import Plain, PlainDict
from occontrol.files.positions import Text, at
from occontrol.files.problem_file import MAX_YAML, read_text
from occontrol.files.schema.common import Strict, Whole
from occontrol.files.schema.validation import validate
from occontrol.files.schema.words import shown

MOST_TASKS = 100_000


class Spread(Strict):
    """Numbers from one to another."""

    start: float = Field(alias="from", description="from: 0.001")
    to: float = Field(description="to: 10")
    points: Whole = Field(ge=1, le=10_000, description="points: 8")
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _logarithms_exist(self) -> Spread:
        if self.scale == "log" and not (self.start > 0 and self.to > 0):
            raise ValueError("scale: log needs 'from' and 'to' above 0")
        return self

    def values(self) -> list[float]:
        """The numbers, both ends exact."""
        a, b, n = self.start, self.to, self.points
        if n == 1:
            return [a]
        if self.scale == "log":
            inner = [a * (b / a) ** (i / (n - 1)) for i in range(1, n - 1)]
        else:
            inner = [a + (b - a) * i / (n - 1) for i in range(1, n - 1)]
        return [a, *(float(f"{x:.12g}") for x in inner), b]  # 0.01, not 0.009999999999999998


class StudyDocument(Strict):
    """What a study file may say."""

    base: str = Field(min_length=1, description="base: problem.yaml, a problem file beside the study file")
    vary: PlainDict | list[PlainDict] = Field(
        default_factory=dict, description="vary: {sensors.range.noise: [0.1, 0.2]}"
    )
    combine: Literal["product", "zip", "list"] = "product"
    seeds: list[Whole] = Field(default_factory=list, description="seeds: [1, 2, 3]")
    task_timeout: float | None = Field(default=None, gt=0, description="task_timeout: 600, in seconds")
    warm_start: str | None = Field(default=None, description="warm_start: objective.cost_weight, a path of vary")


@dataclass(frozen=True)
class Study:
    """A study file that was read.

    Parameters
    ----------
    path : of the study file
    base : path of the base problem
    axes : what varies: {path: the values it takes}, in the order of the file
    points : one mapping {path: value} a point of the study, in order
    seeds : of the random numbers; empty where none is asked for
    task_timeout : seconds after which a task is ended, or None
    warm_start : the axis along which a task begins at the result of the one before, or None
    text : the study file with its places
    """

    path: Path
    base: Path
    axes: Mapping[str, tuple[Plain, ...]]
    points: tuple[PlainDict, ...]
    seeds: tuple[int, ...] = ()
    task_timeout: float | None = None
    warm_start: str | None = None
    text: Text | None = field(default=None, repr=False, compare=False)

    @property
    def folder(self) -> Path:
        """Where the study is kept when nobody says: the study file's name without its suffix, beside it."""
        return self.path.with_suffix("")


def read_study(path: str | Path) -> Study:
    """The study in a file; the paths that vary are not yet compared with the base problem (studies/tasks.py does it).

    Parameters
    ----------
    path : a .yaml, .yml or .json file; `base` is relative to its folder

    Raises ProblemError with every mistake as file:line:column, FileAccessError when the file cannot be read.
    """
    from occontrol.files.json_text import read_json
    from occontrol.files.yaml_text import read_yaml

    path = Path(path)
    if path.suffix.lower() not in (".yaml", ".yml", ".json"):
        raise at(str(path), 1, 1, f"the file name ends in '{path.suffix}'", "study files end in .yaml, .yml or .json")
    source = read_text(path, MAX_YAML, "study file")
    text = (read_json if path.suffix.lower() == ".json" else read_yaml)(source, str(path))
    if not isinstance(text.data, dict):
        what = f"the file holds {shown(text.data)}, it must be a mapping"
        raise at(str(path), 1, 1, what, "begin with base: problem.yaml")
    if "family" in text.data and "base" not in text.data:
        raise text.placed([Mistake(("family",), "this is a problem file, not a study", "a study names its base: FILE")])
    found = Collector()
    found.mistakes += text.mistakes
    try:
        document = validate(StudyDocument, text.data, found, set())
        axes, points = _points(document, found)
        if document.warm_start is not None and document.warm_start not in axes and not found.mistakes:
            found.add(("warm_start",), f"{document.warm_start} does not vary", f"one of {', '.join(axes) or 'vary'}")
        found.raise_if_any()
    except ProblemError as error:
        raise text.placed(error.mistakes) from None
    timeout = None if document.task_timeout is None else float(document.task_timeout)
    base, seeds = path.parent / document.base, tuple(document.seeds)
    return Study(path, base, axes, tuple(points), seeds, timeout, document.warm_start, text)


def _points(document: StudyDocument, found: Collector) -> tuple[dict[str, tuple[Plain, ...]], list[PlainDict]]:
    if len(set(document.seeds)) < len(document.seeds):
        found.add(("seeds",), "a seed stands twice", "each seed once: the same seed gives the same numbers")
    if any(seed < 0 for seed in document.seeds):
        found.add(("seeds",), "a seed is negative", "whole numbers from 0")
    if document.combine == "list":
        return _listed(document, found)
    if not isinstance(document.vary, dict):
        found.add(("vary",), "vary is a list", "combine: list takes a list of points; else {PATH: [values]}")
        return {}, []
    axes = {path: tuple(_values(path, given, found)) for path, given in document.vary.items()}
    if found.mistakes:
        return {}, []
    sizes = {path: len(values) for path, values in axes.items()}
    if document.combine == "zip" and len(set(sizes.values())) > 1:
        told = ", ".join(f"{path} has {n}" for path, n in sizes.items())
        found.add(("vary",), f"combine: zip needs as many values of each: {told}")
        return {}, []
    count = 1
    for size in sizes.values() if document.combine == "product" else []:
        count *= size
    if count * max(1, len(document.seeds)) > MOST_TASKS:
        found.add(("vary",), f"the study has more than {MOST_TASKS} tasks", "several studies")
        return {}, []
    rows = zip(*axes.values(), strict=True) if document.combine == "zip" and axes else product(*axes.values())
    return axes, [dict(zip(axes, row, strict=True)) for row in rows]


def _listed(document: StudyDocument, found: Collector) -> tuple[dict[str, tuple[Plain, ...]], list[PlainDict]]:
    """`combine: list`: every entry of `vary` is one point {PATH: value}; all name the same paths."""
    points = document.vary
    if not isinstance(points, list) or not points:
        found.add(("vary",), "combine: list needs a list of points", "vary: [{objective.cost_weight: 1}, ..]")
        return {}, []
    paths = list(points[0])
    for i, point in enumerate(points):
        if set(point) != set(paths):
            names = ", ".join(paths)
            found.add(("vary", i), f"point {i + 1} does not name the same paths as the first", f"each names {names}")
    axes = {path: tuple(point[path] for point in points) for path in paths} if not found.mistakes else {}
    return axes, list(points)


def _values(path: str, given: Plain, found: Collector) -> list[Plain]:
    place = ("vary", path)
    if isinstance(given, dict):
        try:
            return Spread.model_validate(given).values()
        except ValueError as error:
            from pydantic import ValidationError

            from occontrol.files.schema.words import translate

            if isinstance(error, ValidationError):
                found.mistakes += [m.under(*place) for m in translate(error, Spread, given)]
            return []
    if not isinstance(given, list):
        found.add(place, f"{path} is {shown(given)}, it must be a list of values", "[..] or {from, to, points, scale}")
        return []
    if not given:
        found.add(place, f"{path} has no values")
    return given
