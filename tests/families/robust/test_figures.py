"""Robust pictures show what they say: sets that hold the sampled truths, every method, every sequence."""

import numpy as np
import pytest

from occontrol.api import compare_figure, estimate_figures, figures_of
from occontrol.core.sensor import Sensor
from occontrol.families.robust.family import METHODS, Problem, run_filter, simulate, solve
from occontrol.families.robust.methods import All
from occontrol.families.robust.plant import UncertainPlant


@pytest.fixture(scope="module")
def problem():
    plant = UncertainPlant([[0, 1], [-1, -0.4]], [[0], [1]], [[0.5, 0.2]], np.diag([2.0, 1.0]), [1, -0.5], 1.0)
    sensors = [Sensor("one", [[1, 0]], [[1]]), Sensor("two", [[0, 1]], [[1]])]
    return Problem("osc", plant, sensors, np.linspace(0, 2, 5), samples=5)


def test_the_overview_draws_sets_around_the_truths(problem):
    found = solve(problem)
    figures = figures_of(problem, found)
    assert {"overview", "states"} <= set(figures)
    sets = figures["overview"].axes[0]
    outlines = [line for line in sets.lines if len(line.get_xdata()) == 181]
    assert len(outlines) == 8
    last = np.array([outlines[-1].get_xdata(), outlines[-1].get_ydata()])
    P = found.arrays["shape"][-1] * found.result["level"]
    assert np.einsum("ik,ij,jk->k", last, np.linalg.inv(P), last) == pytest.approx(np.ones(181))
    titled = {axes.get_title(loc="left"): axes for axes in figures["overview"].axes}
    size = titled["Size of the set, worst case up to t"].lines[0]
    assert size.get_ydata()[-1] == pytest.approx(found.result["cost"])


def test_all_sequences_and_the_comparison(problem):
    ranked = solve(problem, All())
    steps = figures_of(problem, ranked)["sequences"].axes[0].lines[0]
    assert len(steps.get_ydata()) == 16
    solutions = {name: solve(problem, METHODS[name]()) for name in ("optimal", "one-step", "relaxed")}
    figure = compare_figure(problem, solutions)
    assert len(figure.axes) == 3  # the relaxation has shares, no size over time
    assert len(figure.axes[0].lines) == 2
    assert set(figures_of(problem, solutions["relaxed"])) == {"shares"}


def test_estimates_are_drawn_as_sets(problem):
    found = solve(problem)
    measurements, truth = simulate(problem, found, 1)
    drawn = estimate_figures(problem, found, run_filter(problem, found, measurements), truth)
    assert len(drawn["estimates"].axes) == 2


def test_one_state_is_a_band():
    plant = UncertainPlant([[-0.2]], [[1]], [[0.3]], [[1]])
    problem = Problem("scalar", plant, [Sensor("only", [[1]], [[1]])], [0.0, 1.0, 2.0], size="longest-axis")
    assert "overview" in figures_of(problem, solve(problem))
