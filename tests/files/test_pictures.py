"""What all pictures have in common: axes that fit, names for every row, words for those who cannot see."""

from __future__ import annotations

import io
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from occontrol.core.state_labels import state_labels, state_names
from occontrol.files.figures import style
from occontrol.files.figures.axes import SMALLEST, alike, name_rows, share_axis, together, value_axis
from occontrol.files.figures.convergence import convergence_panel
from occontrol.files.figures.panels import curves_panel, map_panel
from occontrol.files.figures.words import small_png, words_of


@pytest.fixture
def figure():
    with style.house_style():
        yield style.new_figure((12, 6), "a name", "a subtitle")


@pytest.mark.parametrize(
    ("values", "log", "bottom"),
    [([1.0, 2.0], False, None), ([0.1, 2.0], False, 0.0), ([0.0, 2.0], False, 0.0), ([0.01, 2.0], True, None),
     ([-1.0, 2.0], False, None), ([9.0, 9.5], False, None), ([0.0, 0.0], False, None), ([np.nan], False, None)],
)  # fmt: skip
def test_an_axis_begins_at_zero_only_where_the_values_come_near_it(figure, values, log: bool, bottom) -> None:
    axes = figure.subplots()
    curves_panel(axes, np.arange(float(len(values))), np.array(values)[:, None], ["a"], "deviation")
    assert (axes.get_yscale() == "log") == log == value_axis(axes, np.array(values))
    low, high = axes.get_ylim()
    finite = [v for v in values if np.isfinite(v)]
    assert not finite or low <= min(finite) <= max(finite) <= high
    assert low == bottom if bottom is not None else not finite or low > 0.5 * min(finite) or min(finite) <= 0
    assert axes.get_ylabel() == "deviation"


def test_shares_end_at_one(figure) -> None:
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1])
    share_axis(axes)
    assert axes.get_ylim() == (0, 1) and not axes.get_lines()[0].get_clip_on()


def test_curves_on_one_another_have_one_name(figure) -> None:
    t = np.linspace(0, 1, 50)
    values = np.column_stack([t, t + 1e-3, 1 - t, t - 1e-3, np.where(t < 0.5, t, np.nan)])
    assert alike(values, log=False) == [[0, 1, 3], [2], [4]]
    assert alike(np.column_stack([np.exp(t), 1e-4 * np.exp(t)]), log=True) == [[0], [1]]
    axes = figure.subplots()
    curves_panel(axes, t, values, list("abcde"), "x")
    assert axes.get_legend_handles_labels()[1] == ["a, b, d (the same)", "c", "e"]
    assert together([str(i) for i in range(9)], range(9)) == "0, 1, 2 and 6 more (the same)"


@pytest.mark.parametrize("rows", [2, 9, 34])
def test_every_row_of_a_map_has_its_name_and_its_last_number(figure, rows: int) -> None:
    axes = figure.subplots()
    names = [f"strain at {i}.45 m" for i in range(rows)]
    map_panel(axes, np.arange(6.0), np.ones((5, rows)) * np.arange(1, rows + 1), names, "deviation", ends=True)
    texts = axes.get_yticklabels()
    assert [text.get_text() for text in texts] == names and min(text.get_fontsize() for text in texts) >= SMALLEST
    assert [text.get_text() for text in axes.texts] == [f" {i:.2g}" for i in range(1, rows + 1)]
    figure.canvas.draw()  # no row reaches into its neighbour
    boxes = [text.get_window_extent() for text in texts]
    assert all(a.y0 >= b.y1 - 1 or b.y0 >= a.y1 - 1 for a, b in pairwise(boxes))


def test_of_very_many_rows_every_few_are_named(figure) -> None:
    axes = figure.subplots()
    assert name_rows(axes, [str(i) for i in range(1000)]) == 0.0
    assert 20 < len(axes.get_yticks()) < 200


def test_iterations_are_whole_numbers(figure) -> None:
    axes = figure.subplots()
    history = [{"iteration": i, "cost": 2.0 + 1 / (i + 1), "lower_bound": 2.0 - 1 / (i + 1)} for i in range(3)]
    assert convergence_panel(axes, history)
    figure.canvas.draw()
    assert all(float(tick).is_integer() for tick in axes.get_xticks())


def test_a_picture_is_told_in_words(figure) -> None:
    axes = figure.subplots()
    axes.set_title("deviations", loc="left")
    curves_panel(axes, np.arange(3.0), np.array([[3.0, 1], [2, 1], [1, 1]]), ["speed $5", "place"], "deviation [m]")
    axes.set_xlabel("time t")
    said = words_of(figure)
    for part in (
        "a name. a subtitle",
        "deviations",
        "deviation [m] over time t",
        "speed $5",
        "from 3 to 1",
        "place from 1",
    ):
        assert part in said
    assert "\\" not in said


def test_the_picture_inside_a_page_is_small_and_of_the_same_shape(figure) -> None:
    from PIL import Image

    figure.subplots().plot(np.random.default_rng(0).normal(size=3000))
    content = io.BytesIO()
    figure.savefig(content, dpi=150)
    small = small_png(content.getvalue())
    assert len(small) < 0.5 * len(content.getvalue())
    with Image.open(io.BytesIO(small)) as image:
        assert image.size == (1100, 550)


def test_names_of_modes_are_no_names_of_states() -> None:
    jumping = SimpleNamespace(names=["straight", "left"], states=2)
    assert state_names(SimpleNamespace(plant=jumping)) == ["x1", "x2"]
    named = SimpleNamespace(names=["x", "v"], units=["m", "m/s"], states=2)
    assert state_labels(SimpleNamespace(plant=named)) == ["x [m]", "v [m/s]"]
