"""A short form of scripts/campaign_callers.py: library and command line say the same of anybody's schedule."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import occontrol as oc

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "campaign_callers.py"


@pytest.fixture(scope="module")
def campaign() -> ModuleType:
    spec = importlib.util.spec_from_file_location("campaign_callers", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("family", ["athans", "vlambda", "robust"])
def test_library_and_command_line_say_the_same(campaign: ModuleType, family: str) -> None:
    ended, differences = campaign.compare(family, 16, seed=2)
    assert differences == []
    assert ended["refused"] >= 4 and sum(ended.values()) - ended["refused"] >= 2


def test_a_difference_is_found(campaign: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    certify = oc.certify

    def stretched(problem: object, schedule: oc.Schedule) -> oc.Solution:
        edges = np.linspace(0.0, 4.0, len(schedule.edges))
        return certify(problem, oc.Schedule(edges, schedule.weights, schedule.names))

    monkeypatch.setattr(oc, "certify", stretched)
    _, differences = campaign.compare("robust", 16, seed=2)
    assert differences and "nothing is scheduled between t = " in "".join(differences)
