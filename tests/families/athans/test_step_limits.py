"""Where the limits on integration steps bind, the user reads how accurate the cost is."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol import solve
from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.problem import SchedulingProblem


def problem(noise: float, **options) -> SchedulingProblem:
    """A sensor of this noise or none, on three intervals."""
    plant = LinearPlant([[0.1, 1.0], [-1.0, 0.0]], [[1.0, 0.0], [0.0, 0.5]], np.eye(2))
    sensors = [Sensor("precise", [[1.0, 0.3]], [[noise]], 0.2), idle_sensor(2)]
    integration = Integration(refine=False, **options)
    return SchedulingProblem("limit", plant, sensors, [0.0, 1.0, 2.0, 3.0], [[1.0, 0.5]], integration=integration)


def test_the_message_says_that_the_steps_are_too_few_and_how_accurate_the_cost_is():
    found = solve(problem(0.01, accuracy=1e-13))
    r = found.result
    assert "64 steps of integration, which is too few here" in found.message
    assert "where 1e-13 was asked for; use more intervals" in found.message
    assert r["integration_error"] > 1e-13 * r["cost"]
    # what is stated covers the difference to the independent integration
    assert abs(r["cost"] - r["continuous"]["cost"]) <= 5 * r["integration_error"] + 1e-9 * r["cost"]


@pytest.mark.parametrize("options", [{}, {"substeps": 1}])
def test_there_is_no_such_message_where_the_accuracy_is_reached_or_steps_are_stated(options):
    found = solve(problem(0.5, **options))
    assert "steps of integration" not in found.message


def test_a_cost_further_from_the_exact_one_than_its_estimate_is_named() -> None:
    """The estimate of the steps' error is one: where the exact check finds more, the message counts that."""
    from occontrol.families.athans.assembly import _limited
    from occontrol.families.athans.integration.integrator import Evaluation

    none = np.zeros((1, 1))
    fine = Evaluation(none, 2.0, none, 1.9e-5, 10, None)
    assert _limited(fine, 1e-5, 2.0 + 1.9e-5) == _limited(fine, 1e-5) == ""
    assert _limited(fine, 1e-5, 2.0 - 2.6e-5) == (
        " The cost is accurate to 1.3e-05 of itself where 1e-05 was asked for; use more intervals."
    )
    coarse = Evaluation(none, 2.0, none, 4e-5, 10, None)
    assert "64 steps of integration, which is too few here: the cost is accurate to 2e-05 of" in _limited(coarse, 1e-5)
