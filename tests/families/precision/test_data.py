"""Measurements of the precision family: simulated with the chosen precisions, and taken in by the filter."""

import numpy as np
import pytest

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.measurement import Measurement
from occontrol.families.precision.family import FAMILY as precision
from tests.families.precision.files import BASE, MOMENTS, load


def test_filtering_what_the_plan_does_not_hold(tmp_path):
    problem = load(tmp_path, BASE)
    solution = precision.solve(problem)
    measurements, _ = precision.simulate(problem, solution, 1)
    estimate = precision.run_filter(problem, solution, measurements[1:])
    assert "missing" in estimate.notes[0]
    for time, name, values, words in (
        (0.83, "a", [0.0], "the sample of sensor 'a' at t = 0.83 lies outside the horizon [0, 0.4]"),
        (0.3, "a", [0.0], "the sample of sensor 'a' at t = 0.3 is not at the end of an interval"),
        (0.4, "c", [0.0], "there is no sensor 'c'\n  hint: "),
        (0.4, "b", [0.0, 1.0], "the sample of sensor 'b' has 2 values, it"),
    ):
        with pytest.raises(ProblemError) as error:
            precision.run_filter(problem, solution, [Measurement(time, name, np.array(values))])
        assert str(error.value).startswith(words)


def test_a_sensor_of_precision_zero_has_no_noise_that_a_filter_could_use(tmp_path):
    problem = load(tmp_path, BASE)
    solution = precision.solve(problem)
    step, sensor = next((k // 2, k % 2) for k, v in enumerate(solution.arrays["precisions"][0]) if v == 0)
    time, name = 0.2 * (step + 1), problem.names[sensor]
    with pytest.raises(ProblemError) as error:
        precision.run_filter(problem, solution, [Measurement(time, name, np.zeros(1))])
    assert str(error.value).startswith(f"sensor '{name}' is not in use over [{0.2 * step:g}, {time:g}]")
    # a line without a value says nothing, and so it is no mistake
    measurements, _ = precision.simulate(problem, solution, 1)
    empty = Measurement(time, name, np.array([np.nan]))
    with_it, without = (precision.run_filter(problem, solution, m) for m in ([empty, *measurements], measurements))
    assert np.array_equal(with_it.mean, without.mean) and with_it.notes == without.notes == ()


def test_plain_moments_have_nothing_to_simulate(tmp_path):
    problem = load(tmp_path, MOMENTS)
    with pytest.raises(UsageError, match="no plant to simulate"):
        precision.simulate(problem, precision.solve(problem), 0)


def test_what_is_said_of_several_batches_is_what_they_say_together(tmp_path):
    problem = load(tmp_path, BASE + "batches: 3\n")
    found = precision.solve(problem)
    r, arrays = found.result, found.arrays
    apart = arrays["estimate"] - arrays["truth"]
    assert r["rms_error"] == pytest.approx(float(np.sqrt(np.mean(apart**2))), rel=1e-12)
    assert r["lower_bound"] == pytest.approx(sum(batch["lower_bound"] for batch in r["batches"]), rel=1e-14)
    assert r["objective"] == pytest.approx(sum(batch["objective"] for batch in r["batches"]), rel=1e-14)
    assert r["objective"] * (1 - 1e-3) < r["lower_bound"] < r["objective"]
