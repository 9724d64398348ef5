"""Problems of targets solved with the bound on whole looks: what result.json says, and that it is true."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api.problems import family_of
from occontrol.families.athans.methods import Relaxed
from occontrol.families.athans.targets.text import priced_by
from tests.plain_looks import optimum, small
from tests.target_problems import read, tracking


@pytest.mark.parametrize("seed", [17, 24, 53])
def test_small_problems_end_with_the_optimum_proven(seed: int, tmp_path: Path) -> None:
    document = small(seed)
    best = optimum(document)
    problem = read(document, tmp_path)
    solution = oc.solve(problem)
    r = solution.result
    assert solution.cost == pytest.approx(best, rel=1e-8)
    for bound in (r["bounds"]["relaxed"], r["bounds"]["integer"]):
        assert bound <= best * (1 + 1e-12)
    assert r["lower_bound"] == max(r["bounds"].values()) >= 0.999 * best
    assert r["lower_bound"] <= solution.cost * (1 + 1e-12)
    judged = oc.certify(problem, solution.schedule)
    assert judged.cost == pytest.approx(solution.cost, rel=1e-12)
    assert 0.98 * best <= judged.result["lower_bound"] <= best * (1 + 1e-12)


def test_precise_rare_looks_are_bounded_by_whole_looks(tmp_path: Path) -> None:
    problem = read(tracking(8, 30, 1, 20.0, 0.05), tmp_path)
    solution = oc.solve(problem)
    r = solution.result
    assert r["bounds"]["integer"] > 1.3 * r["bounds"]["relaxed"]
    assert r["lower_bound"] == r["top"]["lower_bound"] == r["bounds"]["integer"]
    assert solution.cost < 1.06 * r["lower_bound"]
    prices = solution.arrays["prices"]
    assert prices.shape == (30, 1) and np.all(prices >= 0) and np.max(prices) > 0
    assert priced_by(solution) == "the bound on whole looks"
    # what one more look on every interval can save at most
    more = oc.solve(read(tracking(8, 30, 2, 20.0, 0.05), tmp_path))
    assert more.cost >= r["bounds"]["integer"] - np.sum(prices)
    lines = dict(family_of(problem).summarise(problem, solution))
    assert "of whole looks" in lines["bounds"] and "relaxed" in lines["bounds"]
    # shares of looks cost less than the bound on whole ones: they get the relaxed bound alone
    shares = oc.solve(problem, Relaxed())
    assert shares.result["bounds"]["integer"] is None
    assert shares.result["lower_bound"] == shares.result["bounds"]["relaxed"] <= shares.cost < r["lower_bound"]


def test_weak_looks_keep_the_relaxed_bound(tmp_path: Path) -> None:
    solution = oc.solve(read(tracking(6, 20, 2, 10.0, 3.0), tmp_path))  # few looks: both bounds are worked out
    bounds = solution.result["bounds"]
    assert bounds["integer"] >= bounds["relaxed"] * (1 - 1e-3)  # tangents stand behind both
    assert solution.result["lower_bound"] == max(bounds.values()) <= solution.cost


def test_lists_dropped_for_want_of_memory_change_no_number(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Two sites: the same relaxation, a schedule whose cost is that of its judge, and no bound from less."""
    from occontrol.families.athans.targets import solve

    document = small(31)
    problem, best = read(document, tmp_path), optimum(document)
    assert len(document["resources"]) == 2
    usual = oc.solve(problem)
    monkeypatch.setattr(solve, "LEAN", 0)
    lean = oc.solve(problem)
    assert lean.result["bounds"]["relaxed"] == pytest.approx(usual.result["bounds"]["relaxed"], rel=1e-12)
    assert lean.result["bounds"]["integer"] is None and not lean.result.get("changes")
    assert lean.result["lower_bound"] <= best * (1 + 1e-12) <= lean.cost * (1 + 2e-12)
    judged = oc.certify(problem, lean.schedule)
    assert judged.cost == pytest.approx(lean.cost, rel=1e-12)
    relaxed = oc.solve(problem, Relaxed())
    assert relaxed.cost == pytest.approx(lean.result["relaxed_cost"], rel=1e-6)
