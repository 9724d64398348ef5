"""Pages as files: what stands in them, without a browser."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from occontrol.files.page import Bars, Curves, Group, Page, Picture, Shades, Table, write_page
from occontrol.files.page.document import page_text, panel_words
from occontrol.files.page.drawing import COLOURS, INK, LINE, PAPER, SOFT
from occontrol.files.page.run_page import schedule_table, sentences, short_text, top_numbers
from occontrol.files.page.thin import columns, runs, thinned

HOSTILE = "</script><b>\"x\" & 'y'"
PICTURE = Picture(name="overview", png=b"\x89PNG", words="Who measures when, as bars.")


def page_of(name: str = "page", **more) -> Page:
    edges = np.array([0.0, 1.0, 2.0, 4.0])
    bars = Bars(title="who", edges=edges, weights=np.array([[1.0, 0], [1, 0], [0.5, 0.5]]), names=[name, "idle"])
    values = np.arange(8.0).reshape(4, 2)
    curves = Curves(title="deviation", label="d [m]", times=edges, values=values, names=["a", name])
    shades = Shades(title="map", label="m", edges=edges, values=np.ones((3, 2)), names=["a", name])
    return Page(title=name, kind="a page", groups=[Group(axis="time t", panels=[bars, curves, shades])],
                pictures=[PICTURE], **more)  # fmt: skip


class Outline(HTMLParser):
    """Text and the attributes of every element, scripts apart."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words, self.elements, self.inside = "", list[tuple[str, dict]](), ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs) -> None:
        self.elements.append((tag, dict(attrs)))
        self.inside = tag if tag in ("script", "style") else ""

    def handle_data(self, data: str) -> None:
        self.words += "" if self.inside else data


def test_names_of_users_stay_text() -> None:
    table = Table(title=HOSTILE, columns={HOSTILE: [HOSTILE], "n": [1.5]})
    text = page_text(page_of(HOSTILE, tables=[table], texts=[(HOSTILE, HOSTILE)], facts=[(HOSTILE, HOSTILE)]))
    outline = Outline(text)
    assert outline.words.count(HOSTILE) >= 8 and not any(tag == "b" for tag, _ in outline.elements)
    content = re.findall(r'<script type="application/json" id="(\w+-?\w*)">(.*?)</script>', text, re.S)
    assert [name for name, _ in content] == ["panels0-data", "table0"]
    assert all(json.loads(data) for _, data in content)


def test_nothing_is_asked_of_a_network() -> None:
    for static in (False, True):
        for tag, attributes in Outline(page_text(page_of(), static)).elements:
            for key in ("src", "href", "action", "data"):
                assert attributes.get(key, "data:").startswith("data:"), (tag, attributes)


def test_without_bokeh_or_on_demand_the_page_is_static(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    table = Table(title="schedule", columns={"start": [0.0, 1.0], "sensors": ["a", "b"]})
    page = page_of(tables=[table])
    written = write_page(tmp_path / "p.html", page, static=True).read_text()
    monkeypatch.setattr("occontrol.files.page.document.find_spec", lambda name: None)
    assert page_text(page) == written and len(written) < 20_000 and "Bokeh" not in written.split("<script>")[0]
    outline = Outline(written)
    assert {"tag": "img", **dict(outline.elements)["img"]}["alt"] == "Who measures when, as bars."
    assert not any(a.get("class") in ("panels", "live") and tag == "details" for tag, a in outline.elements)
    assert "0.0" in outline.words and "copy as CSV" in outline.words


def test_what_cannot_be_seen_is_said() -> None:
    bars, curves, shades = page_of().groups[0].panels
    assert panel_words(bars) == "who: page 75 %, idle 25 %"
    assert panel_words(curves) == "deviation, d [m]: a from 0 to 6, page from 1 to 7"
    assert panel_words(shades) == "map: a map of 2 rows, m from 1 to 1"
    instants = Bars(title="read", edges=np.arange(4.0), weights=np.array([[1.0], [0], [1]]), names=["a"], instants=True)
    assert panel_words(instants) == "read: a 2 times"


def test_a_thinned_curve_keeps_its_extremes_ends_and_gaps() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=50_000)
    values[31_234], values[7] = 99.0, -99.0
    values[40_000:40_300] = np.nan
    kept = thinned(values, 800)
    assert len(kept) < 1000 and np.all(np.diff(kept) > 0) and {0, 7, 31_234, 49_999} <= set(kept)
    drawn = np.interp(np.arange(50_000), kept, values[kept])
    assert np.all(np.isnan(drawn[40_100:40_200])) and not np.isnan(drawn[39_800]) and not np.isnan(drawn[40_500])
    assert np.array_equal(thinned(values[:800], 800), np.arange(800))


def test_columns_of_a_map_keep_what_is_narrower_than_they_are() -> None:
    edges = np.sort(np.concatenate([np.linspace(0, 10, 1001), [3.00501]]))
    values = np.ones((len(edges) - 1, 2))
    values[int(np.searchsorted(edges, 3.00501)), 0] = 0.1
    for smallest in (True, False):
        shown = columns(edges, values, smallest, 100)
        assert shown.shape == (100, 2) and np.all(shown[:, 1] == 1)
        assert (shown[30, 0] == 0.1) == smallest  # column 30 is [3, 3.1]
        assert np.sum(shown[:, 0] < 1) == (1 if smallest else 0)
    assert columns(np.arange(5.0), values[:4], True) is not None and len(columns(np.arange(5.0), values[:4], True)) == 4


def test_runs_are_the_stretches_of_equal_weight() -> None:
    weights = np.array([[1.0, 0], [1, 0], [0.5, 0.5], [0, 1], [1, 0]])
    found = [(j, a.tolist(), b.tolist()) for j, a, b in runs(weights)]
    assert found == [(0, [0, 2, 4], [2, 3, 5]), (1, [2, 3], [3, 4])]


def luminance(colour: str) -> float:
    """Relative luminance of '#rrggbb' as the accessibility guidelines define it."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def contrast(one: str, other: str) -> float:
    low, high = sorted([luminance(one), luminance(other)])
    return (high + 0.05) / (low + 0.05)


def test_texts_and_curves_stand_out_from_both_papers() -> None:
    folder = Path(__file__).resolve().parents[2] / "occontrol/files/page"
    css = (folder / "page.css").read_text()
    found = [dict(re.findall(r"--(\w+): (#\w{6})", block)) for block in re.findall(r":root \{([^}]*)\}", css)[:2]]
    for paper in found:
        assert min(contrast(paper[ink], paper[on]) for ink in ("ink", "soft") for on in ("paper", "box")) >= 4.5
        assert min(contrast(colour, paper["paper"]) for colour in COLOURS) >= 3.0
    script = (folder / "page.js").read_text()
    both = re.search(r"DAY = (.*?), NIGHT = (.*?);", script)
    assert both is not None
    day, night = (re.findall(r'"(#\w{6})"', part) for part in both.groups())
    assert day == [INK, SOFT, LINE, PAPER]
    for colours, paper in zip((day, night), found, strict=True):
        assert [colours[i] for i in (0, 1, 3)] == [paper[key] for key in ("ink", "soft", "paper")]
    assert contrast("#000000", "#ffffff") == pytest.approx(21)


def test_the_numbers_at_the_top_are_those_of_the_result_digit_for_digit() -> None:
    top = {"cost": 0.1 + 0.2, "lower_bound": 1e-300, "relative_gap": 1.0, "of": "continuous"}
    content = {"cost": 7.0, "lower_bound": 6.0, "status": "certified", "message": "Done.", "top": top}
    assert top_numbers(content)[:2] == [("cost", json.dumps(0.1 + 0.2)), ("proven lower bound", "1e-300")]
    holds = "The bound holds for every schedule, whenever it switches: at most 100 % of the cost could still be saved."
    assert sentences(content) == ["Certified: Done.", holds]
    assert top_numbers({"cost": 7.0}) == [("cost", "7.0")] and top_numbers({"cost": None, "lower_bound": None}) == []


def test_schedules_of_every_kind_have_a_table() -> None:
    segments = [{"start": 0.0, "end": 1.0, "sensors": ["a", "b"]}, {"start": 1.0, "end": 2.0, "sensors": []}]
    assert schedule_table(segments).columns == {"start": [0.0, 1.0], "end": [1.0, 2.0], "sensors": ["a;b", ""]}
    shared = [{"start": 0.0, "end": 1.0, "sensors": ["a", "b"], "weights": [0.25, 0.75]}]
    assert schedule_table(shared).columns["weights"] == ["0.25;0.75"]
    assert schedule_table([{"k": 3, "sensors": ["a"]}]).columns == {"start": [3], "end": [3], "sensors": ["a"]}
    looks = [{"start": 0.0, "end": 1.0, "resource": "one", "target": "t"}]
    assert list(schedule_table(looks).columns) == ["start", "end", "resource", "target"]
    assert schedule_table([]) is None and schedule_table(None) is None


def test_long_lists_of_a_problem_are_cut_short() -> None:
    text = short_text({"name": "x", "plant": {"A": [[0, 1], [2, 3]]}, "times": list(range(1000))})
    assert text.startswith("name: x\nplant:\n  A: [[0, 1], [2, 3]]\ntimes: [0, 1,")
    assert "… 976 more" in text and len(text) < 300
    sensors = {"sensors": [{"name": "a", "noise": {"diag": [1]}}, "idle"], "rules": {}}
    assert short_text(sensors) == "sensors:\n  - name: a\n    noise:\n      diag: [1]\n  - idle\nrules: {}"
