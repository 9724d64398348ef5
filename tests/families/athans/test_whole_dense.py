"""Dense plants that fall into targets: the bound on whole looks, against all schedules listed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag

import occontrol as oc
from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.families.athans.whole_dense import apart
from tests.plain_looks import optimum, small
from tests.target_problems import read

TARGETS, STATES, N = 3, 4, 10


def documents(seed: int, cost: float, targets: int = TARGETS, states: int = STATES) -> tuple[dict, dict]:
    """The same problem as targets and as one dense plant, whose states are not in the order of the targets."""
    g = np.random.default_rng(seed)
    looks = small(0)
    looks["horizon"] = {"start": 0, "end": 5.0, "intervals": N, "substeps": 1}
    looks["resources"] = [{"name": "east", "capacity": 1, "windows": [[0, 5.0]]}]
    half = states // 2
    C = np.eye(half, states)
    looks["looks"] = [{"resource": "east", "C": C.tolist(), "cost": cost}]
    looks["objective"]["cost_weight"] = 1.0
    looks["target_models"], looks["targets"] = {}, []
    parts, sensors = [], []
    mixed = g.permutation(targets * states)
    for i in range(targets):
        A = np.zeros((states, states))
        A[:half, half:], A[half:, half:] = np.eye(half), -g.uniform(0.05, 0.3) * np.eye(half)
        none, one = np.zeros(half), np.ones(half)
        noise, running = np.diag([*none, *g.uniform(0.2, 1, half)]), np.diag([*one, *none]) * g.uniform(0.5, 2)
        start, output = np.diag([*(2.0 * one), *(0.5 * one)]), np.zeros((1, states))
        theta = np.diag(g.uniform(0.02, 0.1, half))
        looks["target_models"][f"m{i}"] = {
            "A": A.tolist(), "noise": noise.tolist(), "running": running.tolist(), "output": output.tolist(),
            "initial": {"covariance": start.tolist()},
        }  # fmt: skip
        looks["targets"].append({"name": f"t{i}", "model": f"m{i}", "noise": {"east": theta.tolist()}})
        parts.append((A, noise, start, running))
        whole = np.zeros((half, targets * states))
        whole[:, i * states : (i + 1) * states] = C
        sensors.append({"name": f"s{i}", "C": whole[:, mixed].tolist(), "noise": theta.tolist(), "cost": cost})
    A, noise, start, running = (block_diag(*x)[np.ix_(mixed, mixed)].tolist() for x in zip(*parts, strict=True))
    dense = {
        "family": "athans", "name": "dense", "horizon": looks["horizon"],
        "plant": {"A": A, "noise": noise, "initial": {"mean": [0.0] * len(A), "covariance": start}},
        "sensors": [*sensors, "idle"],
        "objective": {"cost_weight": 1.0, "running": running, "output": [[0.0] * len(A)]},
    }  # fmt: skip
    return looks, dense


@pytest.mark.parametrize(("seed", "cost"), [(1, 0.0), (2, 0.3)])
def test_the_bound_lies_between_the_relaxed_one_and_the_optimum(seed: int, cost: float, tmp_path: Path) -> None:
    looks, dense = documents(seed, cost)
    best = optimum(looks)
    solution = oc.solve(read(dense, tmp_path))
    bounds = solution.result["bounds"]
    assert bounds["relaxed"] * 1.05 < bounds["integer"] <= best * (1 + 1e-9)
    assert solution.result["lower_bound"] == pytest.approx(bounds["integer"], rel=1e-9)
    assert bounds["integer"] > 0.95 * best
    assert best * (1 - 1e-9) <= solution.cost <= 1.02 * best


@pytest.mark.parametrize(("seed", "cost", "states"), [(3, 0.0, 2), (4, 0.2, 2), (5, 0.0, 4)])
def test_two_small_targets_are_proven_optimal_by_the_tree(seed: int, cost: float, states: int, tmp_path: Path) -> None:
    looks, dense = documents(seed, cost, 2, states)  # too few states for their blocks to be swept by themselves
    best = optimum(looks)
    solution = oc.solve(read(dense, tmp_path))
    assert solution.cost == pytest.approx(best, rel=1e-9)
    assert best * (1 - 1e-8) <= solution.result["bounds"]["integer"] <= best * (1 + 1e-9)
    assert solution.result["bounds"]["relaxed"] < 0.95 * best


def test_sensors_become_looks_at_targets(tmp_path: Path) -> None:
    problem = read(documents(1, 0.0)[1], tmp_path)
    recursion = discretise(problem)
    found = apart(recursion, feasible_set(problem))
    assert found is not None and found.targets == TARGETS and found.substeps == 1
    policy = np.zeros((N, TARGETS + 1))
    policy[np.arange(N), np.arange(N) % (TARGETS + 1)] = 1.0
    idle = np.array([False] * TARGETS + [True])
    again = found.policy(found.listed(policy), feasible_set(problem).upper, idle)
    assert again is not None and np.array_equal(again, policy)
