"""occontrol warm: what a later call needs is compiled, in its own processes."""

from __future__ import annotations

import pytest

from occontrol.cli import run
from occontrol.families import names
from occontrol.studies.warm import warm_piece


@pytest.mark.parametrize("name", names())
def test_every_family_has_pieces(name: str) -> None:
    assert warm_piece(name, planned=False) == ""


def test_one_family(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["warm", "robust"]) == 0
    shown = capsys.readouterr()
    assert "ready" in shown.out and "robust" in shown.out and "compiling robust" in shown.err


def test_an_unknown_family_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["warm", "athena"]) == 2
    assert "athans" in capsys.readouterr().err
