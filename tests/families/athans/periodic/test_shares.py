"""Sensors drawn by shares: the mean over draws from above, and one draw as a cycle."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import occontrol as oc
from occontrol.api import family_of
from occontrol.scheduling.periodic.averaged import averaged_steps
from occontrol.scheduling.periodic.drawn import drawn, mean_at_most, shares_of_phases
from occontrol.scheduling.periodic.phases import Phases, always
from occontrol.scheduling.periodic.potential import cycle_of
from tests.families.athans.periodic.test_periodic import VEHICLE, problem_of
from tests.plain_cycles import in_units, on_off, random_plant


def test_the_mean_of_a_scalar_is_that_of_its_modified_riccati_equation() -> None:
    """F 1.1, Q 1, r .5, price 1, read with probability v: S = 1 + F^2 (S - v S^2 / (S + r)), charged before reading."""
    letters, v = on_off(), 0.6
    S = brentq(lambda s: 1 + 1.21 * (s - v * s * s / (s + 0.5)) - s, 0.1, 100)
    scaled, _ = in_units(letters)
    assert mean_at_most(scaled, np.array([[v, 1 - v]])) == pytest.approx(S + v, rel=1e-9)
    assert mean_at_most(scaled, np.array([[0.1, 0.9]])) == np.inf  # 1.21 x .9 > 1: the mean has no limit
    assert mean_at_most(scaled, np.array([[1.0, 0.0]])) == pytest.approx(cycle_of(scaled, np.array([0])).cost, rel=1e-9)


@pytest.mark.parametrize("seed", [0, 3, 5])
def test_draws_cost_less_in_the_mean_than_the_bound_and_more_than_every_bound_from_below(seed: int) -> None:
    letters, _ = in_units(random_plant(seed, 2, 2))
    averaged = averaged_steps(letters)
    shares = shares_of_phases(averaged.shares, always(2))
    costs = [cycle_of(letters, drawn(shares, 400, s)).cost for s in range(12)]
    error = 3 * np.std(costs) / np.sqrt(12)
    assert averaged.lower_bound <= min(costs) and np.mean(costs) <= mean_at_most(letters, shares) + error
    assert np.mean(drawn(shares, 40_000, 1) == 0) == pytest.approx(averaged.shares[0], abs=0.01)


def test_draws_keep_to_windows() -> None:
    phases = Phases(np.array([[1, 1], [1, 0], [0, 1]]))
    shares = shares_of_phases(np.array([0.3, 0.7]), phases)
    assert shares == pytest.approx(np.array([[0.3, 0.7], [1, 0], [0, 1]]))
    word = drawn(shares, 50, 2).reshape(50, 3)
    assert np.all(word[:, 1] == 0) and np.all(word[:, 2] == 1) and 0 < np.sum(word[:, 0]) < 50
    assert shares_of_phases(np.array([0.0, 1.0]), phases)[1] == pytest.approx([1.0, 0.0])


def test_shares_stand_beside_the_cycle_in_a_comparison(tmp_path: Path) -> None:
    problem = problem_of(VEHICLE.replace("max_period: 8", "max_nodes: 100, max_period: 5"), tmp_path)
    family = family_of(problem)
    assert family.compare_names(problem) == ["periodic", "shares"]
    drawn_, best = oc.solve(problem, oc.Shares(steps=200)), oc.solve(problem)
    assert best.cost < drawn_.cost and drawn_.certificate.lower_bound == drawn_.numbers.bounds["averaged"]
    at_most = drawn_.result["mean_at_most"]
    assert at_most > best.cost and f"at most {at_most:.7g} in the mean" in drawn_.message
    assert drawn_.cost == pytest.approx(at_most, rel=0.05) and drawn_.numbers.period == 200
    judged = oc.certify(problem, drawn_.schedule)
    assert judged.cost == pytest.approx(drawn_.cost, rel=1e-10)
    figure = family.compare_figure(problem, {"periodic": best, "shares": drawn_})
    assert figure is not None and "in the mean at most" in "".join(t.get_text() for t in figure.axes[0].texts)
    assert "over all draws" in dict(family.summarise(problem, drawn_))["mean"]
    from occontrol.families.athans.periodic.limits import CycleLimits

    ruled = dataclasses.replace(problem, limits=CycleLimits(max_switches=2))
    with pytest.raises(oc.ProblemError, match="does not keep the rules of a cycle"):
        oc.solve(ruled, "shares")
