"""Figures: what they show is what the arrays hold, for tiny, ordinary and large problems."""

from __future__ import annotations

import dataclasses
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import occontrol as oc
from occontrol.api import compare_figure, figures_of
from occontrol.core.printed import rounded_down
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.families.athans.figures import _switching_title, output_deviation
from occontrol.files.figures.panels import MOST_ROWS


def random_problem(states: int, sensors: int, intervals: int, outputs: int = 1) -> oc.SchedulingProblem:
    """A seeded problem; its sensors beyond the second have windows."""
    g = np.random.default_rng(states)
    A = g.normal(size=(states, states)) / np.sqrt(states) - np.eye(states) / 2
    suite = [
        oc.Sensor(
            f"a station with a long name {j}", g.normal(size=(1, states)), 0.2, 0.1 * j, [(0, 6)] if j > 2 else None
        )
        for j in range(sensors)
    ]
    plant = oc.LinearPlant(A, np.eye(states), 5 * np.eye(states))
    edges = np.linspace(0, 10, intervals + 1)
    return oc.SchedulingProblem("costs $5 & <more>", plant, suite, edges, g.normal(size=(outputs, states)), 12.0, 0.1)


def even_solution(problem: oc.SchedulingProblem) -> Solution:
    """The available sensors in equal shares: quick at any size, and fractional."""
    from occontrol.families.athans.discretise import discretise, half_predicts
    from occontrol.families.athans.node_path import node_path
    from occontrol.families.athans.result import AthansResult

    weights = np.minimum(problem.upper, 1) / np.sum(problem.upper, axis=1, keepdims=True)
    path = node_path(discretise(problem), half_predicts(problem), weights)
    arrays = {"times": problem.edges, "covariance": path.covariance, "switching": path.switching}
    schedule = Schedule(problem.edges, weights, tuple(problem.sensors.names))
    numbers = AthansResult.from_dict({"cost": 3.0})
    return Solution("athans", "relaxed", oc.Status.FEASIBLE, "", 0, 0.0, numbers, arrays, schedule)


def words(figure: Figure) -> str:
    texts = [t.get_text() for t in figure.texts]
    for axes in figure.axes:
        texts += [axes.get_title(loc="left"), axes.get_xlabel(), axes.get_ylabel()]
        texts += [t.get_text() for t in [*axes.texts, *axes.get_xticklabels(), *axes.get_yticklabels()]]
        legend = axes.get_legend()
        texts += [t.get_text() for t in legend.get_texts()] if legend is not None else []
    return "\n".join(texts)


def pixels(figure: Figure) -> np.ndarray:
    buffer = BytesIO()
    figure.savefig(buffer, dpi=40, format="rgba")
    return np.frombuffer(buffer.getvalue(), dtype=np.uint8).reshape(-1, 4)


def test_the_overview_states_problem_sensors_and_certificate(small_solution: Solution) -> None:
    figures = figures_of(small_solution.problem, small_solution)
    assert list(figures) == ["overview", "schedule", "deviations", "switching", "convergence"]
    text = words(figures["overview"])
    certificate = small_solution.certificate
    assert certificate is not None
    for word in ("two radars", "range", "doppler", "idle", "time t", "inside a window", "relaxation"):
        assert word in text
    assert f"cost {certificate.cost:.7g}" in text and f"proven bound {rounded_down(certificate.lower_bound, 7)}" in text
    assert f"cost {small_solution.result['continuous']['cost']:.7g}" in text
    assert "prediction for t = 5" in words(figures["deviations"])


def test_bars_stand_where_the_schedule_uses_a_sensor(small_solution: Solution) -> None:
    """The area of a row's bar is the sensor's share of the horizon."""
    schedule = small_solution.schedule
    assert schedule is not None
    axes = figures_of(small_solution.problem, small_solution)["schedule"].axes[0]
    lengths = np.diff(schedule.edges)
    use = lengths @ schedule.weights / np.sum(lengths)
    shown = dict(zip(schedule.names, [t.get_text() for t in axes.texts], strict=True))
    for name, share in zip(schedule.names, use, strict=True):
        assert shown[name] == ("–" if share == 0 else f"{100 * share:.3g} %")


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (3, 4, 50, 2), (9, 9, 30, 9), (60, 50, 12, 3)])
def test_every_size_is_drawn(shape: tuple[int, int, int, int]) -> None:
    problem = random_problem(*shape)
    solution = even_solution(problem)
    figures = figures_of(problem, solution)
    for name, figure in figures.items():
        picture = pixels(figure)
        assert len(np.unique(picture, axis=0)) > 10, name
        assert r"costs \$5 & <more>" in words(figure)
        for axes in figure.axes:
            assert len(axes.get_yticklabels()) <= 60
    if shape[1] > MOST_ROWS:
        assert "10 more" in words(figures["schedule"])


def test_a_solution_without_history_has_no_convergence(small_solution: Solution) -> None:
    bare = dataclasses.replace(small_solution, history=())
    assert "convergence" not in figures_of(bare.problem, bare)


def test_unknown_bounds_and_costs_are_left_out(small_solution: Solution) -> None:
    history = ({"iteration": 0, "cost": None, "lower_bound": None}, *small_solution.history)
    odd = dataclasses.replace(small_solution, history=history)
    assert "convergence" in figures_of(odd.problem, odd)


def test_the_comparison_names_every_method_and_the_bound(small_solution: Solution) -> None:
    problem = small_solution.problem
    greedy = oc.solve(problem, "greedy")
    figure = compare_figure(problem, {"schedule": small_solution, "greedy": greedy})
    assert figure is not None
    text, best = words(figure), max(s.numbers.top.lower_bound for s in (small_solution, greedy))
    assert "greedy" in text and "schedule" in text and rounded_down(best, 6) in text
    assert len(np.unique(pixels(figure), axis=0)) > 10


def test_plot_of_the_library(small_solution: Solution, tmp_path: Path) -> None:
    figure = oc.plot(small_solution, figure="overview")
    assert isinstance(figure, Figure)
    figure.savefig(tmp_path / "overview.png")
    with pytest.raises(oc.UsageError, match="did you mean 'overview'"):
        oc.plot(small_solution, figure="overvew")


def test_the_deviation_of_the_prediction_against_an_adaptive_integrator(small_solution: Solution) -> None:
    """From the covariance at a node the error grows without measurements until Tp: integrate that, second route."""
    problem, covariance = small_solution.problem, small_solution.arrays["covariance"]
    deviation = output_deviation(problem, covariance)
    A, noise = problem.plant.A, problem.plant.noise

    def rate(t: float, flat: np.ndarray) -> np.ndarray:
        S, a = flat.reshape(2, 2), A.at(t)
        return (a @ S + S @ a.T + noise.at(t)).ravel()

    for k in (0, 17, 40):
        span = (problem.edges[k], problem.predict_at)
        end = solve_ivp(rate, span, covariance[k].ravel(), rtol=1e-11, atol=1e-13).y[:, -1].reshape(2, 2)
        assert deviation[k, 0] == pytest.approx(np.sqrt(end[0, 0]), rel=1e-8)
    assert deviation[-1, 0] ** 2 == pytest.approx(small_solution.result["predicted_mean_square_error"], rel=1e-10)


def test_the_caption_of_the_switching_functions_is_true():
    used = np.array([[True, False], [False, True]])
    assert _switching_title(np.array([[1.0, 2.0], [3.0, 2.0]]), used) == (
        "switching functions (thick: in use, always the smallest)"
    )
    # not available is no choice
    assert "always the smallest" in _switching_title(np.array([[1.0, 2.0], [np.nan, 2.0]]), used)
    wrong = _switching_title(np.array([[2.0, 1.5], [3.0, 2.0]]), used)
    assert wrong == "switching functions (thick: in use, at most 0.5 above the smallest)"
    # on a singular arc several are equal but for rounding, and all in use
    assert "always the smallest" in _switching_title(np.array([[1.0, 1.0 + 1e-12]]), np.array([[True, True]]))
    assert "always the smallest" in _switching_title(np.array([[1.0 + 1e-12, 1.0]]), np.array([[True, False]]))
    assert _switching_title(np.ones((1, 2)), None) == "switching functions"
