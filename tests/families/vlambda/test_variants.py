"""Selection beyond the paper's example: scales, locations, looking ahead, singular matrices, the smallest cases."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from occontrol.api import read_problem
from occontrol.core.plant import DiscretePlant
from occontrol.core.solution import Status
from occontrol.families.vlambda.family import FAMILY as vlambda
from occontrol.families.vlambda.methods import Eigenspace, Fixed, Lookahead, Optimal, Random, RoundRobin, Trace
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.sensor import DiscreteSensor, Region

PROBLEMS = Path(__file__).parents[3] / "problems"
solve = vlambda.solve


def joseph(P, H, R):
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    A = np.eye(len(P)) - K @ H
    return A @ P @ A.T + K @ R @ K.T


def random_problem(seed, criterion="trace", select=1, epochs=4, sensors=3):
    g = np.random.default_rng(seed)
    n = int(g.integers(2, 4))
    rotation = np.linalg.qr(g.standard_normal((n, n)))[0]
    plant = DiscretePlant(1.05 * rotation, 0.1 * np.eye(n), 5 * np.eye(n))
    suite = [DiscreteSensor(f"s{j}", g.standard_normal((1, n)), [[g.uniform(0.2, 2)]]) for j in range(sensors)]
    return Problem("random", plant, suite, 3 * epochs - 1, 3, select, criterion)


@pytest.mark.parametrize("criterion", ["trace", "largest-eigenvalue"])
@pytest.mark.parametrize("select", [1, 2])
def test_looking_ahead_to_the_end_is_optimal_and_optimal_beats_every_chooser(criterion, select):
    for seed in range(6):
        problem = random_problem(seed, criterion, select)
        best = solve(problem, Optimal())
        assert best.status is Status.CERTIFIED
        assert solve(problem, Lookahead(depth=4)).cost == pytest.approx(best.cost, rel=1e-9)
        assert solve(problem, Lookahead(depth=99)).cost == pytest.approx(best.cost, rel=1e-9)
        for method in (Eigenspace(), Trace(), Fixed(), RoundRobin(), Random(3), Lookahead(depth=1)):
            assert solve(problem, method).cost >= best.cost * (1 - 1e-10)


def test_scales_are_the_same_as_other_units():
    """Remark 1: with scales the eigenvalues are those of the states in those units."""
    g = np.random.default_rng(4)
    s = np.array([1.0, 100.0, 0.01])
    F, H = 0.9 * np.linalg.qr(g.standard_normal((3, 3)))[0], [g.standard_normal((1, 3)) for _ in range(3)]
    base = Problem(
        "base",
        DiscretePlant(F, 0.1 * np.eye(3), np.eye(3)),
        [DiscreteSensor(f"s{j}", h, 0.3) for j, h in enumerate(H)],
        20,
        4,
    )
    # the same system written in units that are s times smaller
    plant = DiscretePlant(F * s[:, None] / s, 0.1 * np.diag(s**2), np.diag(s**2))
    sensors = [DiscreteSensor(f"s{j}", h / s, 0.3) for j, h in enumerate(H)]
    scaled = Problem("scaled", plant, sensors, 20, 4, scales=s)
    a, b = solve(base), solve(scaled)
    assert a.result["cost"] == pytest.approx(b.result["cost"], rel=1e-9)
    assert [e["sensors"] for e in a.result["schedule"]] == [e["sensors"] for e in b.result["schedule"]]
    assert b.arrays["standard_deviations"] == pytest.approx(a.arrays["standard_deviations"] * s, rel=1e-9)
    assert np.allclose(b.arrays["covariance"], a.arrays["covariance"] * np.outer(s, s))
    # without the scales the largest unit hides the others
    blind = solve(Problem("blind", plant, sensors, 20, 4))
    assert [e["sensors"] for e in blind.result["schedule"]] != [e["sensors"] for e in a.result["schedule"]]


def test_the_beam_equals_an_independent_filter_that_tries_20001_places():
    problem = read_problem(PROBLEMS / "beam_distributed_sensor.yaml")
    solution = solve(problem)
    F = np.zeros((6, 6))
    for i, (decay, turn) in enumerate(((0.00063, 0.04), (0.00251, 0.16), (0.00565, 0.36))):
        c, s = np.cos(turn * np.pi), np.sin(turn * np.pi)
        F[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = np.exp(-decay) * np.array([[c, s], [-s, c]])
    places = np.linspace(0.05, 0.95, 20001)
    piezo = np.zeros((len(places), 6))
    for i in range(3):
        piezo[:, 2 * i] = (i + 1) ** 2 * np.sin((i + 1) * np.pi * places)
    midspan = np.array([[1.0, 0, 0, 0, -1, 0]])
    P, cost = np.diag([1, 1, 0.25, 0.25, 0.1, 0.1]), 0.0
    for k in range(200):
        if k % 10 == 0:
            entry = solution.result["schedule"][k // 10]
            w, V = np.linalg.eigh(P)
            worst = V[:, w >= w[-1] * (1 - 1e-9)]
            along = np.sum((piezo @ worst) ** 2, axis=1) / 0.25
            still = np.sum((midspan @ worst) ** 2) / 0.04
            moved = along.max() > still
            assert entry["sensors"] == (["piezo"] if moved else ["midspan"])
            assert entry["scores"][0] >= along.max() * (1 - 1e-12)  # as good as the best of all the places
            assert entry["scores"] == pytest.approx([along.max(), still], rel=1e-6)
            if moved:
                (p,) = entry["location"]
                assert p == pytest.approx(places[along.argmax()], abs=1e-4)
                assert 0.05 <= p <= 0.95
                modes = [(i + 1) ** 2 * np.sin((i + 1) * np.pi * p) for i in range(3)]
                H, R = np.array([[modes[0], 0, modes[1], 0, modes[2], 0]]), [[0.25]]
            else:
                assert entry["location"] is None
                H, R = midspan, [[0.04]]
        P = joseph(P, H, np.array(R))
        cost += np.linalg.eigvalsh(P)[-1]
        x = np.pi * k / 200
        G = np.array([[0], [np.sin(x)], [0], [np.sin(2 * x) / 4], [0], [np.sin(3 * x) / 9]])
        P = F @ P @ F.T + 0.04 * G @ G.T
    assert solution.cost == pytest.approx(cost, rel=1e-10)
    assert solution.cost == pytest.approx(problem.expect["cost"], rel=problem.expect["tolerance"])


def movable_problem(**more):
    plant = DiscretePlant([[1.0, 0.1], [-0.1, 0.98]], 0.05 * np.eye(2), np.diag([4.0, 1.0]))
    arm = DiscreteSensor("arm", [["cos(p1)", "sin(p1)"]], [["0.3+0.1*p1"]], Region([[0.0, 3.0]]))
    return Problem("movable", plant, [arm, DiscreteSensor("still", [[1.0, 0.3]], 0.4)], 12, 3, **more)


def test_optimal_with_a_movable_sensor_is_never_above_a_rule():
    problem = movable_problem()
    best = solve(problem, Optimal(grid=5))
    assert best.status is Status.FEASIBLE  # exact over a grid only
    assert best.certificate is None
    assert best.result["lower_bound"] <= best.cost
    for method in (Eigenspace(), Trace(), RoundRobin(), Fixed("arm"), Fixed("still")):
        assert solve(problem, method).cost >= best.cost * (1 - 1e-9)


def test_two_movable_sensors_at_once_say_who_is_where():
    plant = DiscretePlant(np.eye(2), 0.1 * np.eye(2), np.diag([4.0, 1.0]))
    arms = [DiscreteSensor(n, [["cos(p1)", "sin(p2)"]], 0.3, Region([[0.0, 3.0], [-1.0, 1.0]])) for n in "ab"]
    problem = Problem("two arms", plant, [*arms, DiscreteSensor("c", [[0.1, 0.1]], 1.0)], 6, 2, 2)
    entry = solve(problem).result["schedule"][0]
    assert entry["sensors"] == ["a", "b"]
    assert set(entry["locations"]) == {"a", "b"}
    assert entry["location"] == [*entry["locations"]["a"], *entry["locations"]["b"]]


def test_a_singular_transition_loses_nothing():
    shape = "sin(0.01*k)+0.1"
    plant = DiscretePlant([[shape, 0], [0, f"0.9*({shape})"]], 0.01 * np.eye(2), np.eye(2))
    problem = Problem("through zero", plant, [DiscreteSensor("a", [[1.0, 0.2]], 0.1)], 340, 20)
    quiet = solve(dataclasses.replace(problem, steps=300))
    assert quiet.result["notes"] == []
    table = np.array([[[0.0, 0.0], [0.0, 0.0]] if k == 5 else [[0.9, 0.1], [0.0, 0.8]] for k in range(12)])
    from occontrol.core.signal import TableSignal

    stops = DiscretePlant(TableSignal(np.arange(12.0), table, "previous"), 0.01 * np.eye(2), np.eye(2))
    loud = solve(Problem("stop", stops, [DiscreteSensor("a", [[1.0, 0.2]], 0.1)], 12, 3))
    assert loud.result["notes"] == []  # a root needs no inverse of F: nothing is lost, nothing to announce
    P = np.eye(2)
    for k in range(12):
        P = joseph(P, np.array([[1.0, 0.2]]), np.array([[0.1]]))
        assert np.allclose(loud.arrays["covariance"][k], P, rtol=1e-11, atol=1e-14)
        P = table[k] @ P @ table[k].T + 0.01 * np.eye(2)


def test_a_perfectly_known_state_is_no_trouble():
    """P0 = 0 and fewer noises than states: the covariance stays singular for a while, which is announced."""
    plant = DiscretePlant([[1.0, 1.0], [0.0, 1.0]], 0.1, np.zeros((2, 2)), G=[[0.5], [1.0]])
    problem = Problem("known", plant, [DiscreteSensor("a", [[1.0, 0.0]], 0.1)], 6, 2)
    solution = solve(problem)
    assert any("the covariance is singular" in note for note in solution.result["notes"])
    P = np.zeros((2, 2))
    for k in range(6):
        P = joseph(P, np.array([[1.0, 0.0]]), np.array([[0.1]]))
        assert np.allclose(solution.arrays["covariance"][k], P, atol=1e-14)
        P = np.array([[1.0, 1.0], [0.0, 1.0]]) @ P @ np.array([[1.0, 0.0], [1.0, 1.0]]) + 0.1 * np.outer(
            [0.5, 1], [0.5, 1]
        )


def test_a_single_step_and_a_single_sensor():
    problem = Problem("one", DiscretePlant(0.5, 1.0, 2.0), [DiscreteSensor("a", 1.0, 1.0)], 1, 7)
    for name in vlambda.methods:
        solution = solve(problem, vlambda.choose(problem, name))
        assert solution.cost == pytest.approx(2 / 3)
        assert solution.result["peak_largest_eigenvalue"] == pytest.approx(2 / 3)
