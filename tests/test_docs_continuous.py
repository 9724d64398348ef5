"""The example of docs/schedule_at_work.md for continuous time does what its text says."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np

import occontrol as oc

TEXT = (Path(__file__).resolve().parents[1] / "docs" / "schedule_at_work.md").read_text(encoding="utf-8")
THETA = 0.5


def example() -> str:
    """The indented lines below the heading."""
    section = TEXT.split("## In continuous time\n", 1)[1].split("\n## ", 1)[0]
    return textwrap.dedent("\n".join(line for line in section.splitlines() if line.startswith("    ")))


def test_the_example_for_continuous_time_runs_and_agrees_with_closed_forms() -> None:
    """A constant that is measured: 1/Sigma grows by t/Theta; the estimate weighs the prior mean against the average."""
    plant = oc.LinearPlant(A=[[0.0]], noise=[[0.0]], covariance=[[2.0]], mean=[1.0])
    sensors = oc.SensorSuite([oc.Sensor("meter", [[1.0]], [[THETA]])])
    problem = oc.SchedulingProblem(name="constant", plant=plant, sensors=sensors, edges=[0.0, 1.0, 3.0], output=[[1.0]])
    names = {
        "problem": problem,
        "solution": type("Solution", (), {"schedule": oc.Schedule(problem.edges, [[1.0], [1.0]], ("meter",))}),
        "readings": lambda t, name: np.array([4.0]),
    }
    exec(compile(example(), "schedule_at_work.md", "exec"), names)  # the text of our own documentation
    times = np.array([0.0, 1.0, 3.0])
    exact = 1 / (1 / 2.0 + times / THETA)
    np.testing.assert_allclose(names["at_edges"][:, 0, 0], exact, rtol=1e-8)
    np.testing.assert_allclose(names["covariance"](2.0), [[1 / (1 / 2.0 + 2.0 / THETA)]], rtol=1e-8)
    estimate = names["estimate"]
    np.testing.assert_allclose(estimate.times, times)
    np.testing.assert_allclose(estimate.values[:, 0], exact * (1.0 / 2.0 + 4.0 * times / THETA), rtol=1e-7)
    assert names["equations"].size_in("weights") == (3, 1)
    assert names["equations"].size_out("covariance_rate") == (2, 2)
