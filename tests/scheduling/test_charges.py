"""Where a running weight is charged: before a reading, after it, or half and half, in every arithmetic."""

from dataclasses import replace

import numpy as np
import pytest

from occontrol.scheduling.baselines import greedy
from occontrol.scheduling.certified import Roots, square_root_pass
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.path import step_path
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.sweep import Sweep

N, STATES, SENSORS = 5, 3, 3


def made(seed: int, charge: np.ndarray | None) -> Recursion:
    rng = np.random.default_rng(seed)

    def definite(count: int) -> np.ndarray:
        roots = rng.standard_normal((count, STATES, STATES))
        return roots @ np.swapaxes(roots, 1, 2)

    return Recursion(
        initial=definite(1)[0], transition=0.7 * rng.standard_normal((N + 1, STATES, STATES)), noise=definite(N + 1),
        predict=np.arange(N + 1), rows=rng.standard_normal((N, 4, STATES)), row_set=np.arange(N),
        offsets=np.array([0, 1, 3, 4]), steps=np.ones(N), cost=rng.random((N, SENSORS)), running=definite(N),
        running_set=np.arange(N), terminal=definite(1)[0], available=np.ones((N, SENSORS)), charge=charge,
    )  # fmt: skip


def plainly(r: Recursion, v: np.ndarray) -> float:
    """J by inverses, no code of the product."""
    S, total = r.initial, float(np.sum(r.cost * v))
    for k in range(N):
        S = r.transition[k] @ S @ r.transition[k].T + r.noise[k]
        a, b = (0.5, 0.5) if r.charge is None else r.charge[k]
        total += a * np.trace(r.running[k] @ S)
        per_row = np.repeat(v[k], [1, 2, 1])
        S = np.linalg.inv(np.linalg.inv(S) + r.rows[k].T @ (per_row[:, None] * r.rows[k]))
        total += b * np.trace(r.running[k] @ S)
    S = r.transition[N] @ S @ r.transition[N].T + r.noise[N]
    return total + float(np.trace(r.terminal @ S))


CHARGES = {"half": None, "before": np.tile([1.0, 0.0], (N, 1)), "after": np.tile([0.0, 1.0], (N, 1)), "mixed": None}


@pytest.mark.parametrize("name", CHARGES)
@pytest.mark.parametrize("small", [56, 0], ids=["loops", "blas"])
def test_cost_and_gradient_charge_what_is_stated(name, small):
    rng = np.random.default_rng(3)
    charge = rng.random((N, 2)) if name == "mixed" else CHARGES[name]
    r, v = made(11, charge), rng.dirichlet(np.ones(SENSORS), N)
    J, g = Sweep(r, small=small).cost_and_gradient(v)
    assert J == pytest.approx(plainly(r, v), rel=1e-12)
    for k in range(N):
        for j in range(SENSORS):
            step = np.zeros_like(v)
            step[k, j] = 1e-5
            slope = (plainly(r, v + step) - plainly(r, v - step)) / 2e-5
            assert g[k, j] == pytest.approx(slope, rel=1e-6, abs=1e-7)
    rooted = square_root_pass(Roots.of(r), v)
    assert rooted.cost == pytest.approx(J, rel=1e-12)
    np.testing.assert_allclose(rooted.gradient, g, rtol=1e-10, atol=1e-10)


def test_the_costate_holds_every_later_charge():
    r, v = made(5, np.random.default_rng(1).random((N, 2))), np.eye(SENSORS)[[0, 1, 2, 1, 0]]
    path = step_path(r, v)
    k, moved = 2, np.zeros((STATES, STATES))
    moved[0, 1] = moved[1, 0] = 1e-6

    def later(change: np.ndarray) -> float:
        S, total = path.after[k] + change, r.charge[k, 1] * np.trace(r.running[k] @ (path.after[k] + change))
        for i in range(k + 1, N):
            S = r.transition[i] @ S @ r.transition[i].T + r.noise[i]
            total += r.charge[i, 0] * np.trace(r.running[i] @ S)
            c = r.rows[i] * np.sqrt(np.repeat(v[i], [1, 2, 1]))[:, None]
            S = np.linalg.inv(np.linalg.inv(S) + c.T @ c)
            total += r.charge[i, 1] * np.trace(r.running[i] @ S)
        return total + np.trace(r.terminal @ (r.transition[N] @ S @ r.transition[N].T + r.noise[N]))

    slope = (later(moved) - later(-moved)) / 2
    assert np.sum(path.costate[k] * moved) == pytest.approx(slope, rel=1e-6)


def test_greedy_looks_one_reading_ahead_at_what_is_charged():
    r = replace(made(8, np.tile([0.0, 1.0], (N, 1))), terminal=np.zeros((STATES, STATES)))
    policy = greedy(r, IntervalPolytopes(np.ones((N, SENSORS)), 1))
    S = r.initial
    for k in range(N):
        S = r.transition[k] @ S @ r.transition[k].T + r.noise[k]
        values, after = [], []
        for j in range(SENSORS):
            c = r.rows[k][r.offsets[j] : r.offsets[j + 1]]
            after.append(np.linalg.inv(np.linalg.inv(S) + c.T @ c))
            later, total = after[j], r.cost[k, j] + np.trace(r.running[k] @ after[j])
            for i in range(k + 1, N):
                later = r.transition[i] @ later @ r.transition[i].T + r.noise[i]
                total += np.trace(r.running[i] @ later)
            values.append(total)
        assert policy[k, int(np.argmin(values))] == 1
        S = after[int(np.argmax(policy[k]))]
