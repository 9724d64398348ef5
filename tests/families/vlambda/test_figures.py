"""Figures of step-by-step selection at their extremes: one step, fifty sensors with long names."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.api import compare_figure, estimate_figures, figures_of, run_filter, simulate, solve
from occontrol.core.plant import DiscretePlant
from occontrol.families.hybrid import problem as hybrid_problem
from occontrol.families.hybrid.plant import JumpPlant, Mode
from occontrol.families.hybrid.sensor import JumpSensor
from occontrol.families.vlambda import problem as vlambda_problem
from occontrol.families.vlambda.sensor import DiscreteSensor
from occontrol.files.figures import style

LONG = [f"a rather long name of sensor {i:02d} of the array" for i in range(50)]
ROWS = np.random.default_rng(3).standard_normal((50, 1, 2))


def selection(steps: int, names: list[str]) -> vlambda_problem.Problem:
    plant = DiscretePlant([[1.0, 0.2], [0.0, 0.9]], 0.1 * np.eye(2), np.eye(2))
    sensors = [DiscreteSensor(name, H, 0.3) for name, H in zip(names, ROWS, strict=False)]
    return vlambda_problem.Problem("selection", plant, sensors, steps)


def jumping(steps: int, names: list[str]) -> hybrid_problem.Problem:
    modes = [Mode("a", np.eye(2), 0.1 * np.eye(2)), Mode("b", [[1, 1], [0, 1]], 0.1 * np.eye(2))]
    plant = JumpPlant(modes, np.eye(2), transition_matrix=[[0.9, 0.1], [0.1, 0.9]])
    sensors = [JumpSensor(name, C, 0.3) for name, C in zip(names, ROWS, strict=False)]
    return hybrid_problem.Problem("jumping", plant, sensors, steps, runs=5)


def test_names_that_begin_alike_stay_apart() -> None:
    assert style.labels(["range", "doppler"]) == ["range", "doppler"]
    assert style.labels(LONG)[7] == "…07…"
    assert len(set(style.labels(LONG))) == 50
    assert style.labels(["x" * 30, "x" * 31]) == ["x" * 21 + "…"] * 2
    assert style.labels(["same", "same"]) == ["same", "same"]


@pytest.mark.parametrize("make", [selection, jumping])
def test_one_step_is_a_dot(make) -> None:
    problem = make(1, ["one", "two"])
    solution = solve(problem)
    panels = [axes for figure in figures_of(problem, solution).values() for axes in figure.axes]
    panels += compare_figure(problem, {"eigenspace": solution}).axes
    lines = [line for axes in panels for line in axes.get_lines() if len(line.get_xdata()) == 1]
    assert len(lines) >= 3
    assert all(line.get_marker() in ("o", ".", "|", "_") for line in lines)
    for axes in panels:
        if axes.get_xlabel() == "step k":
            assert [t for t in axes.get_xticks() if 0 <= t <= 1] == [0, 1]


@pytest.mark.parametrize("make", [selection, jumping])
def test_of_many_sensors_those_in_use_have_a_row_and_a_colour(make) -> None:
    problem = make(6, LONG)
    solution = solve(problem)
    weights = solution.schedule.weights
    used = [style.labels(LONG)[j] for j in np.flatnonzero(weights.sum(axis=0) > 0)]
    rows = [
        [t.get_text() for t in axes.get_yticklabels()]
        for figure in figures_of(problem, solution).values()
        for axes in figure.axes
    ]
    assert list(reversed(used)) in rows
    assert all(len(texts) < 50 for texts in rows)
    others = {name: solve(problem, name) for name in ("random", "fixed")}
    figure = compare_figure(problem, others)
    figure.canvas.draw()
    width = figure.bbox.width
    for axes in figure.axes:
        if axes.get_legend() is not None:
            box = axes.get_legend().get_window_extent()
            assert 0 <= box.x0 < box.x1 <= width


@pytest.mark.parametrize("make", [selection, jumping])
@pytest.mark.parametrize("steps", [1, 4])
def test_a_filter_run_is_drawn_over_steps(make, steps: int) -> None:
    problem = make(steps, ["one", "two"])
    solution = solve(problem)
    measurements, truth = simulate(problem, solution, 2)
    estimate = run_filter(problem, solution, measurements)
    for known in (None, truth):
        for figure in estimate_figures(problem, solution, estimate, known).values():
            named = [axes for axes in figure.axes if axes.get_xlabel()]
            assert named and all(axes.get_xlabel() == "step k" for axes in named)
            low, high = named[0].get_xlim()
            assert low == 0 and high >= 1
