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


def documents(seed: int, cost: float) -> tuple[dict, dict]:
    """The same problem as targets and as one dense plant, whose states are not in the order of the targets."""
    g = np.random.default_rng(seed)
    looks = small(0)
    looks["horizon"] = {"start": 0, "end": 5.0, "intervals": N, "substeps": 1}
    looks["resources"] = [{"name": "east", "capacity": 1, "windows": [[0, 5.0]]}]
    C = np.eye(2, STATES)
    looks["looks"] = [{"resource": "east", "C": C.tolist(), "cost": cost}]
    looks["objective"]["cost_weight"] = 1.0
    looks["target_models"], looks["targets"] = {}, []
    parts, sensors = [], []
    mixed = g.permutation(TARGETS * STATES)
    for i in range(TARGETS):
        A = np.zeros((STATES, STATES))
        A[:2, 2:], A[2:, 2:] = np.eye(2), -g.uniform(0.05, 0.3) * np.eye(2)
        noise, running = np.diag([0, 0, *g.uniform(0.2, 1, 2)]), np.diag([1.0, 1.0, 0, 0]) * g.uniform(0.5, 2)
        start, output = np.diag([2.0, 2.0, 0.5, 0.5]), np.zeros((1, STATES))
        theta = np.diag(g.uniform(0.02, 0.1, 2))
        looks["target_models"][f"m{i}"] = {
            "A": A.tolist(), "noise": noise.tolist(), "running": running.tolist(), "output": output.tolist(),
            "initial": {"covariance": start.tolist()},
        }  # fmt: skip
        looks["targets"].append({"name": f"t{i}", "model": f"m{i}", "noise": {"east": theta.tolist()}})
        parts.append((A, noise, start, running))
        whole = np.zeros((2, TARGETS * STATES))
        whole[:, i * STATES : (i + 1) * STATES] = C
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
