"""What `check` warns of, and plants that grow beyond numbers: the words that the user reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from occontrol.cli import run
from occontrol.core.plant import LinearPlant
from occontrol.families.athans.growth import growth

CASES = [
    ("windows: [[0, 2], [3, 4]]", "windows: [[0, 2], [7, 9]]",
     "9:68: warning: the window [7, 9] of sensor 'range' lies outside the horizon [0, 4]"),
    ("C: [[0, 1]], noise: [[0.4]], cost: 0.5", "C: [[1, 0]], noise: [[0.4]], cost: 2.5, windows: [[0, 1]]",
     "10:5: warning: sensor 'doppler' is never better than 'range': it sees no more and costs no less"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "words"), CASES)
def test_a_warning_has_its_place_and_strict_refuses_it(
    small_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(small_text.replace(old, new))
    assert run(["check", str(file)]) == 0
    assert f"{file}:{words}" in capsys.readouterr().err
    for command in (["check"], ["solve", "--out", str(tmp_path / "run")]):
        assert run([*command, str(file), "--strict"]) == 3
        assert words.replace("warning: ", "") in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_growing_mode_that_nobody_sees(small_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = small_text.replace('[[0, 1], ["-(1+0.2*sin(t))", -0.4]]', "[[0.3, 0], [0, -1]]")
    (tmp_path / "x.yaml").write_text(text.replace("C: [[1, 0]]", "C: [[0, 1]]"))
    assert run(["check", str(tmp_path / "x.yaml")]) == 0
    assert "not observable and unstable: no sensor sees a mode of the plant that grows (rate 0.3)" in (
        capsys.readouterr().err
    )


def test_a_plant_that_grows_beyond_numbers_has_its_line(
    small_text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = small_text.replace('"-(1+0.2*sin(t))"', "200")
    (tmp_path / "x.yaml").write_text(text.replace("end: 4", "end: 40").replace("predict_at: 5", "predict_at: 50"))
    assert run(["solve", str(tmp_path / "x.yaml"), "--out", str(tmp_path / "run")]) == 3
    assert f"{tmp_path}/x.yaml:5:6: the plant grows beyond numbers" in capsys.readouterr().err


def test_growth_of_a_scalar_is_that_of_its_exponential() -> None:
    parts = {"noise": [[0.0]], "mean": [0.0], "covariance": [[1.0]]}
    edges = np.linspace(0.0, 10.0, 5)
    assert growth(LinearPlant(A=[[0.7]], **parts), edges) == pytest.approx(2 * 7.0 / np.log(10))
    varying = growth(LinearPlant(A=[["0.14*t"]], **parts), edges)
    assert varying == pytest.approx(2 * 7.0 / np.log(10), rel=1e-9)
    assert growth(LinearPlant(A=[[-1.0]], **parts), edges) == 0
