"""The check in continuous time part by part against the same on the whole plant, and what counts as a part."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.families.athans.continuous import parts
from occontrol.families.athans.continuous.reintegration import reintegrate
from occontrol.families.athans.problem import SchedulingProblem


def scattered(seed: int, running: bool = True, moving: bool = False) -> tuple[SchedulingProblem, Schedule]:
    """Twelve or more shuffled states of independent parts, weights across them, sensors that see one or several."""
    g = np.random.default_rng(seed)
    sizes = [2, 3, 1, 4, 2]
    n, N = sum(sizes), 5
    ends = np.cumsum([0, *sizes])
    spans = [slice(a, b) for a, b in itertools.pairwise(ends)]
    A, noise, start = np.zeros((3, n, n))
    for span, s in zip(spans, sizes, strict=True):
        A[span, span] = g.standard_normal((s, s)) - 0.5 * np.eye(s)
        root = g.standard_normal((2, s, s))
        noise[span, span], start[span, span] = root[0] @ root[0].T, root[1] @ root[1].T
    order = g.permutation(n)
    sensors = []
    for j, seen in enumerate([[0], [1, 3], [1], [2, 4]]):
        C = np.zeros((len(seen), n))
        for row, b in enumerate(seen):
            C[row, spans[b]] = g.standard_normal(sizes[b])
        windows = [(0.3, 1.5)] if j == 2 else None
        theta = np.diag(g.uniform(0.1, 0.5, len(seen)))
        sensors.append(Sensor(f"s{j}", C[:, order], theta, cost=float(g.random()), windows=windows))
    D, R = g.standard_normal((3, n)), g.standard_normal((2, n))
    rows = [[float(x) for x in row] for row in A[np.ix_(order, order)]]
    if moving:
        i, j = np.argwhere(np.array(rows) != 0)[0]
        rows[i][j] = f"{rows[i][j]}*(1+0.3*sin(2*t))"
    problem = SchedulingProblem(
        "parts",
        LinearPlant(rows, noise[np.ix_(order, order)], start[np.ix_(order, order)]),
        [*sensors, idle_sensor(n)],
        np.linspace(0, 2, N + 1),
        D,
        predict_at=2.2,
        cost_weight=0.7,
        running=R.T @ R if running else None,
        select=2,
    )
    v = problem.upper * g.random((problem.intervals, 5))
    v[:, -1] = 0.0
    v *= np.minimum(1.0, 1.8 / np.maximum(v.sum(axis=1, keepdims=True), 1e-9))
    v[:, -1] = 2.0 - v.sum(axis=1)
    return problem, Schedule(problem.edges, v, tuple(problem.sensors.names))


@pytest.mark.parametrize(("seed", "running", "moving"), [(0, True, False), (1, False, False), (2, True, True)])
def test_parts_say_what_the_whole_says(seed: int, running: bool, moving: bool, monkeypatch) -> None:
    problem, schedule = scattered(seed, running, moving)
    assert sorted(len(part.states) for part in parts.parts_of(problem, schedule)) == [1, 2, 2, 3, 4]
    by_parts = reintegrate(problem, schedule)
    monkeypatch.setattr(parts, "SPLIT", 1000)
    whole = reintegrate(problem, schedule)
    slack = whole.error + by_parts.error
    assert slack < 1e-7 * whole.cost
    for name in ("cost", "lower_bound", "observation_cost", "running_cost", "prediction_error"):
        assert getattr(by_parts, name) == pytest.approx(getattr(whole, name), abs=2 * slack), name
    assert by_parts.predicted_mean_square_error == pytest.approx(whole.predicted_mean_square_error, abs=2 * slack)
    apart = np.abs(by_parts.covariance_at_edges - whole.covariance_at_edges)
    assert np.max(apart) < 1e-8 * np.max(whole.covariance_at_edges)
    assert whole.lower_bound < 0.999 * whole.cost  # there is something to compare


def test_what_couples_is_one_part() -> None:
    problem, schedule = scattered(0)
    assert problem.sensors[1].rows == 2
    joined = [
        Sensor(s.name, s.C, [[0.3, 0.1], [0.1, 0.3]], windows=s.windows) if i == 1 else s
        for i, s in enumerate(problem.sensors)
    ]
    other = SchedulingProblem(
        "joined", problem.plant, joined, problem.edges, problem.output, running=problem.running, select=2
    )
    # the noise of its two rows is correlated: what it sees of a part depends on the other
    assert parts.parts_of(other, schedule) == []
    assert len(parts.parts_of(problem, schedule)) == 5
