"""Maps of many sensors and states show every reading, each step's column centred on its number."""

from __future__ import annotations

import pytest

import occontrol as oc
from scripts.instances import selection


@pytest.mark.parametrize("figure", ["switching", "deviations"])
def test_the_last_step_is_on_the_map(figure: str) -> None:
    problem = selection(12, 12, 4, 2, 0.9, 1)
    axes = oc.plot(oc.solve(problem), figure=figure).axes[0]
    assert axes.get_xlim() == (-0.5, 3.5) and axes.get_xlabel() == "step k"
    mesh = axes.collections[0]
    assert mesh.get_coordinates()[0, :, 0].tolist() == [-0.5, 0.5, 1.5, 2.5, 3.5]
