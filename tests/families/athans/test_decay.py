"""Plants that forget within one interval what a sensor did in its middle: cost, bound and stated error hold."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest

from occontrol import solve
from occontrol.core.solution import Status
from occontrol.families.athans.integration.folded import Extrapolated
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.integration.mesh import Mesh
from tests.decimal_flow import Flows
from tests.decimal_recursion import Data
from tests.invariances import far_problem

INTERVALS = 3


def forgetful(decay: float, states: int, price: float = 0.2) -> Data:
    """A plant that decays by e^-decay over an interval, its slowest state by a third of that in the exponent."""
    rng = np.random.default_rng(states)
    A = -np.diag(decay * np.linspace(1.0, 1 / 3, states)) + 0.1 * np.triu(rng.normal(size=(states, states)), 1)
    G = rng.normal(size=(states, states))
    sensors = [(rng.normal(size=(1, states)), np.eye(1) * 0.1, q) for q in (price, 0.0)]
    sensors.append((np.zeros((0, states)), np.zeros((0, 0)), 0.0))
    edges = np.arange(INTERVALS + 1.0)
    return Data(A, 3.0 * G @ G.T, np.eye(states), sensors, np.ones((1, states)), edges, 1e-3)


@pytest.mark.parametrize("states", [1, 2])
@pytest.mark.parametrize("decay", [5.0, 10.0, 20.0, 50.0, 300.0])
def test_no_bound_above_the_optimum_and_no_cost_that_is_off_by_more_than_stated(decay: float, states: int) -> None:
    data = forgetful(decay, states)
    found = solve(far_problem(data, 0.0, "integrated"))
    r, flows = found.result, Flows(data)
    lengths = [1.0] * INTERVALS
    choice = [int(j) for j in np.argmax(found.schedule.weights, axis=1)]
    true, best = flows.cost(choice, lengths), flows.optimum(lengths)
    stated = r["allowance"] + 5 * r["integration_error"]
    assert found.status is Status.CERTIFIED
    assert abs(float(true - Decimal(r["cost"]))) <= stated <= 1e-4 * float(true)
    assert float(Decimal(r["lower_bound"]) - best) <= stated
    assert float(Decimal(r["top"]["lower_bound"]) - best) <= 1e-9 * float(true)
    assert float(true - best) <= 1e-4 * float(true)


def test_an_estimate_that_shows_no_order_is_not_believed() -> None:
    data = forgetful(12.0, 1)
    problem = far_problem(data, 0.0, "integrated")
    integrator = Integrator(problem)
    spans, v = integrator.spans, np.tile([1.0, 0.0, 0.0], (INTERVALS, 1))
    on = Extrapolated(spans, Mesh.coarsest(problem), integrator.recursion)
    whole, half, quarter = (folded.cost(v) for folded in (on.whole, on.half, on.quarter))
    assert abs(quarter - half) > 2 * abs(half - whole)  # longer steps see less of what the sensor does
    assert on.error(v) >= 4 * abs(quarter - half)
    # where the order is there the estimate is what is left out
    fine = Extrapolated(spans, Mesh.coarsest(problem).divided(np.full(INTERVALS, 5)), integrator.recursion)
    true = float(Flows(data).cost([0] * INTERVALS, [1.0] * INTERVALS))
    assert abs(fine.cost(v) - true) <= 1.5 * fine.error(v) <= 10 * abs(fine.cost(v) - true)


def test_only_intervals_that_matter_at_the_end_get_short_steps() -> None:
    for decay, counts in ((3.0, [1, 1, 1]), (30.0, [1, 5, 5]), (100.0, [1, 1, 7])):
        mesh = Integrator(far_problem(forgetful(decay, 1), 0.0, "integrated")).first
        start = mesh.counts[0]  # the prior has steps of its own at the start
        assert list(mesh.counts[1:]) == counts[1:] and start >= counts[0]
        assert decay * mesh.steps[-1] <= max(2.0, decay if decay < 4 else 0.0)
