"""Figures of filter runs and trade-offs: what must be on them is on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import occontrol
from occontrol.families.athans import figures_tradeoff as tradeoff
from occontrol.files.figures import estimates, save


@pytest.fixture(scope="module")
def filtered(small_solution):
    problem = small_solution.problem
    measurements, truth = occontrol.simulate(problem, small_solution, 11)
    return problem, small_solution, occontrol.run_filter(problem, small_solution, measurements), truth


def lines(axes):
    return [line for line in axes.get_lines() if len(line.get_xdata()) > 2]


def test_estimates_show_the_error_when_the_truth_is_known_and_the_estimate_otherwise(filtered):
    problem, solution, estimate, truth = filtered
    with_truth = estimates.draw(problem, solution, estimate, truth)["estimates"]
    without = estimates.draw(problem, solution, estimate)["estimates"]
    for i in range(2):
        error = lines(with_truth.axes[i])[0].get_ydata()
        np.testing.assert_allclose(error, estimate.mean[:, i] - truth.values[:, i])
        np.testing.assert_allclose(lines(without.axes[i])[0].get_ydata(), estimate.mean[:, i])
    assert with_truth.axes[0].get_ylabel() == "error of x1" and without.axes[1].get_ylabel() == "x2"
    assert with_truth.axes[1].get_xlabel() == "time t, in the problem's unit"
    assert any("grey: a sensor is available" in text.get_text() for text in with_truth.texts)  # windows are marked


def test_the_prediction_ends_at_its_last_value(filtered):
    problem, solution, estimate, truth = filtered
    figure = estimates.draw(problem, solution, estimate, truth)["prediction"]
    left, right = figure.axes[:2]
    assert lines(left)[0].get_ydata()[-1] == 0
    np.testing.assert_allclose(lines(right)[0].get_ydata(), estimate.predicted_deviation[:, 0])
    assert f"last: {estimate.predicted[-1, 0]:.4g} ± " in left.texts[0].get_text()


def test_consistency_has_nis_and_with_truth_nees(filtered, tmp_path):
    problem, solution, estimate, truth = filtered
    assert len(estimates.draw(problem, solution, estimate)["consistency"].axes) == 1
    figures = estimates.draw(problem, solution, estimate, truth)
    assert [axes.get_ylabel() for axes in figures["consistency"].axes] == ["NIS per value", "NEES per state"]
    for name, figure in figures.items():
        save(figure, tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000


def test_nothing_measured_and_many_states_can_be_drawn(filtered, tmp_path):
    problem, solution, estimate, _ = filtered
    silent = replace(estimate, nis=np.full(41, np.nan), dimension=np.zeros(41, dtype=int))
    save(estimates.draw(problem, solution, silent)["consistency"], tmp_path / "silent.png")
    for times, shown, said in ((6, 12, ""), (26, 48, "; the first 48 of 52 states")):
        deviation = np.tile(estimate.standard_deviation, times)
        wide = replace(estimate, mean=np.tile(estimate.mean, times), standard_deviation=deviation)
        figure = estimates.draw(problem, solution, wide)["estimates"]
        drawn = [axes.get_ylabel() for axes in figure.axes if axes.get_visible()]
        assert sorted(drawn) == sorted(f"x{i + 1}" for i in range(shown))
        assert any(text.get_text().endswith(f"±2σ band{said}") or said in text.get_text() for text in figure.texts)
    known = replace(estimate, predicted_deviation=0 * estimate.predicted_deviation)
    assert "prediction" not in estimates.draw(problem, solution, known)


def test_the_front_lies_above_its_shaded_bound(small_solution, tmp_path):
    front = occontrol.tradeoff(small_solution.problem, [0.01, 0.1, 1.0])
    figures = tradeoff.draw(front)
    axes = figures["front"].axes[0]
    points = next(line for line in axes.get_lines() if line.get_label() == "schedules")
    bound = next(line for line in axes.get_lines() if line.get_label() == "lower bound")
    q, e = points.get_data()
    np.testing.assert_array_equal(q, front.schedules.observation_cost)
    assert np.all(e >= np.interp(q, *bound.get_data()) - 1e-3 * e)
    assert len(figures["schedules"].axes[0].get_yticks()) == 3
    for name, figure in figures.items():
        save(figure, tmp_path / f"{name}.png")
