"""The selection family: the paper's numbers, every chooser against the optimum, scales, locations, certificates."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from occontrol.core.discrete_sensor import DiscreteSensor, Region
from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.plant import DiscretePlant
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Status
from occontrol.families import vlambda
from occontrol.families.vlambda import Problem, solve
from occontrol.files.problem_file import read_problem
from occontrol.library import choose_method
from occontrol.solvers.choosers import Eigenspace, Fixed, Lookahead, Optimal, Random, RoundRobin, Trace

PROBLEMS = Path(__file__).parents[2] / "problems"
CHOICES = [3, 2, 2, 2, 3, 2, 1, 2, 1, 2, 2, 2]


def joseph(P, H, R):
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    A = np.eye(len(P)) - K @ H
    return A @ P @ A.T + K @ R @ K.T


class Plain:
    """The paper's example again, in plain numpy: matrices typed a second time, a Joseph-form Kalman filter, eigh."""

    H = (
        np.array([[1.0, 0, 0], [0, 0.001, 0]]),
        np.array([[0, 0, 1.0], [0.001, 0, 0]]),
        np.array([[0, 1.05, 0], [0, 0, 0.001]]),
    )
    R = (0.1 * np.eye(2), 0.1 * np.eye(2), 0.05 * np.eye(2))
    Q = np.array([[0.01, 0.0001, 0.0001], [0.0001, 0.01, 0], [0.0001, 0, 0.015]])
    F = np.array([[0.95, 0.10, 0], [0, 0.95, 0], [0.001, 0, 0.975]])

    def run(self, epoch=25, fixed=None):
        P, chosen, posterior = 250 * np.eye(3), [], []
        for k in range(300):
            if k % epoch == 0:
                w, V = np.linalg.eigh(P)
                E = V[:, w >= w[-1] * (1 - 1e-9)]
                rho = [np.trace(E.T @ H.T @ np.linalg.inv(R) @ H @ E) for H, R in zip(self.H, self.R, strict=True)]
                j = fixed if fixed is not None else int(np.flatnonzero(rho >= np.max(rho) * (1 - 1e-10))[0])
                chosen.append(j + 1)
            P = joseph(P, self.H[j], self.R[j])
            posterior.append(P)
            F = self.F * (np.sin(0.01 * k) + 0.1)
            P = F @ P @ F.T + self.Q
        return chosen, np.array(posterior)


@pytest.fixture(scope="module")
def oshman():
    return read_problem(PROBLEMS / "oshman_example.yaml")


@pytest.fixture(scope="module")
def solutions(oshman):
    return {name: solve(oshman, choose_method(oshman, name)) for name in vlambda.compare_names(oshman)}


def numbers(problem, solution):
    return [problem.sensors.index(entry["sensors"][0]) + 1 for entry in solution.result["schedule"]]


def test_the_papers_choices_scores_and_deviations(oshman):
    solution = solve(oshman)
    assert solution.method == "eigenspace"
    assert numbers(oshman, solution) == CHOICES
    assert solution.result["schedule"][0]["scores"] == pytest.approx([10.00001, 10.00001, 22.05002], rel=1e-9)
    deviations = solution.arrays["standard_deviations"]
    assert deviations[24] == pytest.approx([0.1052658286, 0.09355758172, 0.1292135546], rel=1e-9)
    assert deviations[174] == pytest.approx([0.1960251067, 0.4331344812, 1.955156781], rel=1e-9)
    alone = solve(oshman, Fixed("one")).arrays["standard_deviations"][174]
    assert alone == pytest.approx([0.1957441669, 0.4313637579, 12.17167981], rel=1e-9)


@pytest.mark.parametrize(("file", "epoch"), [("oshman_example", 25), ("oshman_every_step", 1)])
def test_the_whole_run_equals_a_joseph_form_filter_with_the_same_rule(file, epoch):
    problem = read_problem(PROBLEMS / f"{file}.yaml")
    solution = solve(problem)
    chosen, posterior = Plain().run(epoch)
    assert numbers(problem, solution) == chosen
    expected = np.sqrt(np.einsum("kii->ki", posterior))
    assert np.max(np.abs(solution.arrays["standard_deviations"] / expected - 1)) < 1e-9
    assert np.max(np.abs(solution.arrays["covariance"] - posterior)) < 1e-10
    largest = np.linalg.eigvalsh(posterior)[:, -1]
    r = solution.result
    assert r["sum_largest_eigenvalue"] == pytest.approx(largest.sum(), rel=1e-11)
    assert r["sum_trace"] == pytest.approx(np.trace(posterior, axis1=1, axis2=2).sum(), rel=1e-11)
    assert r["peak_largest_eigenvalue"] == pytest.approx(largest[1:].max(), rel=1e-11)
    assert r["cost"] == r["sum_largest_eigenvalue"]
    assert r["standard_deviations"] == pytest.approx(expected[-1], rel=1e-10)
    expect = problem.expect
    assert r["cost"] == pytest.approx(expect["cost"], rel=expect["tolerance"])
    assert r["sum_trace"] == pytest.approx(expect["sum_trace"], rel=expect["tolerance"])
    if "sensors" in expect:
        assert [e["sensors"][0] for e in r["schedule"]] == expect["sensors"]


def test_choosing_at_every_step_lowers_the_largest_eigenvalue_after_25():
    peaks = [
        solve(read_problem(PROBLEMS / f"{name}.yaml")).arrays["largest_eigenvalue"][26:].max()
        for name in ("oshman_example", "oshman_every_step")
    ]
    assert peaks == pytest.approx([3.82, 0.10], abs=5e-3)


def test_the_optimum_is_proven_and_no_chooser_beats_it(oshman, solutions):
    best = solutions["optimal"]
    assert best.status is Status.CERTIFIED
    assert best.result["relative_gap"] <= 1e-9
    assert numbers(oshman, best) == CHOICES  # the paper's rule happens to be optimal here
    assert best.result["nodes"] < 3**12 / 100
    for name, solution in solutions.items():
        assert solution.cost >= best.cost * (1 - 1e-10), name
    assert solutions["fixed:one"].cost > 10 * best.cost
    by_trace = dataclasses.replace(oshman, criterion="trace")
    traces = {name: solve(by_trace, choose_method(by_trace, name)) for name in ("optimal", "eigenspace", "trace")}
    assert traces["optimal"].status is Status.CERTIFIED
    assert traces["optimal"].cost == pytest.approx(626.8439469509, rel=1e-10)
    assert traces["optimal"].cost <= min(traces["trace"].cost, traces["eigenspace"].cost) * (1 + 1e-12)


def test_the_greedy_rule_is_not_optimal_from_105_on():
    """Six epochs from k = 105: the rule costs 1.6 times the optimal sum of largest eigenvalues."""
    plain = Plain()
    P = 250 * np.eye(3)
    chosen, posterior = plain.run()
    del chosen
    F = plain.F * (np.sin(0.01 * 104) + 0.1)
    P = F @ posterior[104] @ F.T + plain.Q
    shape = "*(sin(0.01*(k+105))+0.1)"
    rows = [["0.95" + shape, "0.1" + shape, 0], [0, "0.95" + shape, 0], ["0.001" + shape, 0, "0.975" + shape]]
    sensors = [DiscreteSensor(str(j + 1), plain.H[j], plain.R[j]) for j in range(3)]
    problem = Problem("later", DiscretePlant(rows, plain.Q, P), sensors, 150, 25)
    best = solve(problem, Optimal())
    assert best.status is Status.CERTIFIED
    assert solve(problem).cost / best.cost == pytest.approx(1.6, abs=0.1)


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


def test_a_schedule_is_certified_against_the_proven_optimum(oshman, solutions):
    certified = vlambda.certify(oshman, solutions["eigenspace"].schedule)
    assert certified.status is Status.CERTIFIED
    other = vlambda.certify(oshman, solutions["fixed:two"].schedule)
    assert other.status is Status.FEASIBLE
    assert other.cost == pytest.approx(solutions["fixed:two"].cost, rel=1e-12)
    assert other.result["lower_bound"] == pytest.approx(solutions["optimal"].cost, rel=1e-9)
    good = vlambda.claims_of(oshman, solutions["fixed:two"])
    assert vlambda.certify(oshman, solutions["fixed:two"].schedule, good).status is Status.FEASIBLE
    for wrong in ({"cost": good.cost * 0.9}, {"lower_bound": 400.0}):
        claims = dataclasses.replace(good, **wrong)
        assert vlambda.certify(oshman, solutions["fixed:two"].schedule, claims).status is Status.DISAGREES


def test_a_schedule_of_another_kind_is_refused(oshman):
    names = tuple(oshman.sensors.names)
    with pytest.raises(ProblemError, match=r"changes inside of the epoch k = 0 \.\. 24"):
        vlambda.certify(oshman, Schedule(np.array([0.0, 20.0, 300.0]), np.eye(3)[:2], names))
    with pytest.raises(ProblemError, match="says nothing about the epoch k = 275"):
        vlambda.certify(oshman, Schedule(np.array([0.0, 275.0]), np.eye(3)[:1], names))
    with pytest.raises(ProblemError, match="uses 2 sensors at k = 0, select is 1"):
        vlambda.certify(oshman, Schedule(np.array([0.0, 300.0]), np.array([[1.0, 1.0, 0.0]]), names))


def test_names_that_carry_an_argument(oshman):
    assert vlambda.method_named(oshman, "fixed:two") == Fixed("two")
    assert vlambda.method_named(oshman, "lookahead:3") == Lookahead(depth=3)
    assert vlambda.method_named(oshman, "eigenspace") is None
    with pytest.raises(UsageError, match="there is no sensor 'four'"):
        vlambda.method_named(oshman, "fixed:four")
    with pytest.raises(UsageError, match=r"2 sensors are named, select is 1"):
        vlambda.method_named(oshman, "fixed:one+two")


def test_fixed_without_a_name_is_the_best_of_them(oshman, solutions):
    best = solve(oshman, Fixed())
    assert best.cost == min(solutions[f"fixed:{name}"].cost for name in oshman.sensors.names)
    assert "two" in best.message


def test_an_interrupted_run_keeps_the_last_choice(oshman):
    stopped = solve(oshman, None, Monitor(interrupted=2))
    assert stopped.status is Status.INTERRUPTED
    assert numbers(oshman, stopped) == [3] * 12
    assert "from k = 25 on the last choice is kept" in stopped.message
    best = solve(oshman, Optimal(), Monitor(interrupted=2))
    assert best.status is Status.INTERRUPTED
    assert best.result["lower_bound"] <= 352.3566146236 <= best.cost * (1 + 1e-9)


def test_a_singular_transition_is_announced():
    shape = "sin(0.01*k)+0.1"
    plant = DiscretePlant([[shape, 0], [0, f"0.9*({shape})"]], 0.01 * np.eye(2), np.eye(2))
    problem = Problem("through zero", plant, [DiscreteSensor("a", [[1.0, 0.2]], 0.1)], 340, 20)
    quiet = solve(dataclasses.replace(problem, steps=300))
    assert quiet.result["notes"] == []
    table = np.array([[[0.0, 0.0], [0.0, 0.0]] if k == 5 else [[0.9, 0.1], [0.0, 0.8]] for k in range(12)])
    from occontrol.core.signal import TableSignal

    stops = DiscretePlant(TableSignal(np.arange(12.0), table, "previous"), 0.01 * np.eye(2), np.eye(2))
    loud = solve(Problem("stop", stops, [DiscreteSensor("a", [[1.0, 0.2]], 0.1)], 12, 3))
    assert loud.result["notes"] == ["covariance form used at k = 5: F is singular"]
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
    for name in vlambda.METHODS:
        solution = solve(problem, choose_method(problem, name))
        assert solution.cost == pytest.approx(2 / 3)
        assert solution.result["peak_largest_eigenvalue"] == pytest.approx(2 / 3)
