"""Designs for nonlinear models: parameters as states, their sensitivities, and the six samples of the compartment."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from occontrol.api import read_problem, solve
from occontrol.families.athans.nonlinear.linearise import linearisation_of

RATES = np.array([0.05884, 4.298, 21.80])


def sensitivity(t: np.ndarray) -> np.ndarray:
    """(K, 3) derivatives of theta3 (exp(-theta1 t) - exp(-theta2 t))."""
    out, into, scale = RATES
    slow, fast = np.exp(-out * t), np.exp(-into * t)
    return np.column_stack([-scale * t * slow, scale * t * fast, slow - fast])


@pytest.fixture(scope="module")
def compartment():
    return read_problem("problems/compartment_ode.yaml")


def test_sensitivities_by_the_linearisation_are_the_closed_form(compartment):
    origin, times = linearisation_of(compartment), compartment.clock.times
    assert origin is not None
    spans, F, found = origin.nominal.spans, np.eye(5), []
    for k, t in enumerate(times):
        F = spans.transition[k] @ F
        found.append((compartment.sensors[0].C.at(float(t)) @ F)[0, 2:])
    exact = sensitivity(times)
    assert np.max(np.abs(np.array(found) - exact) / np.max(np.abs(exact), axis=0)) < 1e-11


def test_the_six_samples_are_the_best_of_all(compartment):
    rows = sensitivity(compartment.clock.times)[1:]
    costs = {
        pick: np.trace(np.linalg.inv(rows[list(pick)].T @ rows[list(pick)] + 1e-6 * np.eye(3)))
        for pick in itertools.combinations(range(18), 6)
    }
    best = min(costs, key=costs.__getitem__)
    solution = solve(compartment)
    used = np.flatnonzero(solution.schedule.weights[:, 0])
    assert compartment.clock.times[used] == pytest.approx([0.166, 0.333, 1, 1.5, 2, 24])
    assert tuple(used - 1) == best
    assert solution.cost == pytest.approx(costs[best], rel=1e-6)
    assert solution.cost == pytest.approx(0.82224029499, rel=1e-6)
    assert solution.result["lower_bound"] <= costs[best]
