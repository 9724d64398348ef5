"""Readings of a stated variance and spacing are an intensity, and nobody can say both or neither."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from occontrol.api import family_of, read_problem
from occontrol.core.errors import ProblemError
from occontrol.families.athans.sensor_noise import sample_deviations

TEXT = """\
family: athans
name: looks
horizon: {start: 0, end: 4, intervals: 20}
plant: {A: [[0, 1], [0, 0]], noise: {diag: [0, 1]}, initial: {covariance: {diag: [100, 10]}}}
sensors:
  - {name: look, C: [[1, 0]], NOISE}
objective: {output: [[1, 0]]}
"""


def problem(folder: Path, noise: str):
    path = folder / "looks.yaml"
    path.write_text(TEXT.replace("NOISE", noise), encoding="utf-8")
    return read_problem(path)


@pytest.mark.parametrize("stated", ["variance: 400, every: 0.2", "variance: [[400]], every: 0.2", "noise: 80"])
def test_a_variance_with_its_spacing_is_an_intensity(tmp_path: Path, stated: str) -> None:
    one = problem(tmp_path, stated)
    assert next(iter(one.sensors)).noise.at(0.0).tolist() == [[80.0]]


def test_a_variance_that_changes_with_time_is_scaled_at_every_time(tmp_path: Path) -> None:
    signal = next(iter(problem(tmp_path, 'variance: [["4+t"]], every: 0.5').sensors)).noise
    assert signal.sample(np.array([0.0, 1.0, 4.0]))[:, 0, 0] == pytest.approx([2.0, 2.5, 4.0], rel=1e-15)


def test_check_says_what_one_sample_is_worth(tmp_path: Path) -> None:
    # an interval of 0.2 averages readings of deviation 20 that come every 0.05: four of them, deviation 10
    many = problem(tmp_path, "variance: 400, every: 0.05")
    ((name, length, deviation),) = sample_deviations(many)
    assert name == "look" and length == pytest.approx(0.2) and deviation.tolist() == pytest.approx([10.0])
    lines = dict(family_of(many).describe(many))
    assert lines["sample of look"] == "the average over 0.2 has deviation 10: noise is an intensity"


@pytest.mark.parametrize(("stated", "words"), [
    ("cost: 1", "sensor 'look' has no 'noise'"),
    ("noise: 1, variance: 2", "sensor 'look' has noise and variance"),
    ("variance: 400", "the variance of one reading needs 'every'"),
    ("noise: 1, every: 2", "every belongs to a variance, not to a noise intensity"),
    ("variance: 400, every: 0", "every is 0, it must be a time above 0"),
    ("variance: 400, every: -1", "every is -1, it must be a time above 0"),
])  # fmt: skip
def test_what_does_not_belong_together_is_refused_with_its_line(tmp_path: Path, stated: str, words: str) -> None:
    with pytest.raises(ProblemError) as refused:
        problem(tmp_path, stated)
    assert words in str(refused.value) and "looks.yaml:6:" in str(refused.value)
