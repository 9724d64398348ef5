"""Many targets: bounds that are known, the same problem as one dense plant, enumeration, files and refusals."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.athans.targets.fill import fill
from occontrol.families.athans.targets.one_target import target_problem, target_schedule
from occontrol.scheduling.blocks.local_search import improve
from occontrol.scheduling.blocks.relaxation import relax
from occontrol.scheduling.blocks.single import all_costs, singles
from tests.target_problems import FIVE, read, tracking


def dense(problem):
    """The same targets as one plant with a sensor for every look, and idle: what the product knew before."""
    from scipy.linalg import block_diag

    parts = [target_problem(problem, i) for i in range(problem.targets)]
    sizes = np.cumsum([0, *(p.states for p in parts)])
    sensors = []
    for i, p in enumerate(parts):
        for s in p.sensors:
            if not s.is_idle:
                C = np.zeros((s.rows, sizes[-1]))
                C[:, sizes[i] : sizes[i + 1]] = s.C.at(0.0)
                sensors.append(oc.Sensor(s.name, C, s.noise.at(0.0), s.cost.at(0.0)[0, 0], windows=s.windows))
    plant = oc.LinearPlant(
        block_diag(*(p.plant.A.at(0.0) for p in parts)),
        block_diag(*(p.plant.noise.at(0.0) for p in parts)),
        block_diag(*(p.plant.covariance for p in parts)),
    )
    return oc.SchedulingProblem(
        name="dense", plant=plant, sensors=[*sensors, oc.idle_sensor(sizes[-1])], edges=problem.edges,
        output=block_diag(*(p.output.at(0.0) for p in parts)), cost_weight=problem.cost_weight,
        running=block_diag(*(p.running.at(0.0) for p in parts)), select=1, integration=parts[0].integration,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "bound", "digits"),
    [
        ((16, 60, 1, 20.0, 0.05), 115.02, 0.02),
        ((40, 120, 2, 20.0, 0.05), 313.2, 0.06),
        ((104, 120, 5, 20.0, 0.05), 922.6, 0.1),
        ((40, 120, 2, 60.0, 0.05), 319.4, 0.06),
        ((40, 120, 2, 20.0, 1.0), 1748.4, 0.2),
    ],
)
def test_relaxed_bounds_that_another_program_found(arguments, bound: float, digits: float, tmp_path: Path) -> None:
    filled = fill(read(tracking(*arguments), tmp_path))
    sweep = filled.sweep()
    found = relax(sweep, filled.allowed, 1e-4, 2000, Monitor())
    assert found.status is Status.CERTIFIED
    assert found.lower_bound == pytest.approx(bound, abs=digits)
    # the axes of independent errors are blocks of their own
    assert sweep.blocks == 3 * arguments[0] and all(lanes.states == 2 for lanes in sweep.lanes)


def test_targets_cost_what_the_dense_plant_costs(tmp_path: Path) -> None:
    document = tracking(4, 12, 1, 6.0, 0.05)
    document["objective"] = {"cost_weight": 1.5}
    document["looks"][0]["cost"] = 0.7
    for model in document["target_models"].values():
        model["output"] = np.eye(2, 6).tolist()
    problem = read(document, tmp_path)
    solution = oc.solve(problem)
    plain = dense(problem)
    other = oc.solve(plain, oc.Relaxed(relative_gap=1e-5))
    relaxed = solution.result["bounds"]["relaxed"]
    assert relaxed <= other.cost * (1 + 1e-9)
    assert relaxed == pytest.approx(other.result["lower_bound"], rel=3e-4)
    weights = np.zeros((problem.intervals, len(plain.sensors)))
    names = plain.sensors.names
    schedule = solution.schedule
    for k, i in zip(schedule.interval, schedule.target, strict=True):
        weights[k, names.index(f"{problem.target_names[i]}@radar")] = 1.0
    weights[:, -1] = 1 - np.sum(weights, axis=1)
    judged = oc.certify(plain, oc.Schedule(plain.edges, weights, tuple(names)))
    assert judged.cost == pytest.approx(solution.cost, rel=1e-11)
    for key in ("observation_cost", "running_cost", "prediction_error"):
        assert judged.result[key] == pytest.approx(solution.result[key], rel=1e-9)
    assert solution.result["continuous"]["cost"] == pytest.approx(judged.result["continuous"]["cost"], rel=1e-7)


def test_five_dense_targets_have_the_bound_that_the_dense_sweep_found() -> None:
    """Five targets of six states written as one plant, with running and terminal weights across nothing."""
    from scipy.linalg import block_diag

    from occontrol.families.athans.discretise import discretise, feasible_set
    from occontrol.families.athans.integration.options import Integration
    from occontrol.scheduling.blocks.components import block_sweep
    from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed

    g, K, n = np.random.default_rng(5), 5, 30
    A, X, R, start, D, sensors = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n), [], []
    for i in range(K):
        o = 6 * i
        A[o : o + 3, o + 3 : o + 6], A[o + 3 : o + 6, o + 3 : o + 6] = np.eye(3), -g.uniform(0.05, 0.3) * np.eye(3)
        X[o + 3 : o + 6, o + 3 : o + 6] = np.diag(g.uniform(0.1, 1, 3))
        start[o : o + 3], start[o + 3 : o + 6] = g.uniform(5, 20), 1
        D.append(np.eye(3, 6) * g.uniform(0.5, 2))
        R[o : o + 3] = g.uniform(0.25, 4)
    for i in range(K):
        C = np.zeros((3, n))
        C[:, 6 * i : 6 * i + 3] = np.eye(3)
        sensors.append(oc.Sensor(f"t{i}", C, np.diag(g.uniform(0.01, 0.1, 3))))
    problem = oc.SchedulingProblem(
        name="dense", plant=oc.LinearPlant(A, X, np.diag(start)), sensors=[*sensors, oc.idle_sensor(n)],
        edges=np.linspace(0, 20, 201), output=block_diag(*D), running=np.diag(R), integration=Integration(substeps=1),
    )  # fmt: skip
    sweep = block_sweep(discretise(problem))
    assert sweep is not None and sweep.blocks == 15
    found = minimise_relaxed(sweep, feasible_set(problem), None, RelaxedOptions(1e-4))
    assert found.lower_bound == pytest.approx(330.51, abs=0.03)


def scalars(seed: int, N: int, weak: bool) -> dict:
    """Two scalar targets and two sites with windows, for enumeration."""
    g = np.random.default_rng(seed)
    noise = g.uniform(5.0, 20.0, (2, 2)) if weak else g.uniform(0.02, 0.2, (2, 2))
    models = {
        f"m{i}": {
            "A": [[g.uniform(-0.3, 0.3)]], "noise": [[g.uniform(0.5, 2)]], "running": [[g.uniform(0.5, 2)]],
            "initial": {"covariance": [[g.uniform(0.5, 4)]]}, "output": [[g.uniform(0, 1)]],
        }
        for i in range(2)
    }  # fmt: skip
    sites = ["east", "west"]
    return {
        "family": "athans",
        "horizon": {"start": 0, "end": 0.5 * N, "intervals": N, "substeps": 1},
        "resources": [{"name": "east"}, {"name": "west", "windows": [[0, 0.5 * (N // 2)]]}],
        "target_models": models,
        "targets": [
            {"name": f"t{i}", "model": f"m{i}", "noise": {s: [[noise[i, j]]] for j, s in enumerate(sites)}}
            for i in range(2)
        ],
        "looks": [{"resource": s, "C": [[1]], "cost": 0.3 * seed} for s in sites],
    }


@pytest.mark.parametrize("weak", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_no_enumerated_schedule_lies_below_the_bound(seed: int, weak: bool, tmp_path: Path) -> None:
    problem = read(scalars(seed, 5, weak), tmp_path)
    filled = fill(problem)
    sweep, looks = filled.sweep(), filled.looks
    choices = []
    for a, b in itertools.pairwise(filled.allowed.starts):
        choices.append([None, *range(a, b - 1)])
    best = np.inf
    for choice in itertools.product(*choices):
        x = np.zeros(filled.allowed.shape)
        x[[e for e in choice if e is not None], 0] = 1.0
        best = min(best, sweep.cost(x))
    solution = oc.solve(problem)
    assert solution.result["lower_bound"] <= best * (1 + 1e-12)
    assert best <= solution.cost * (1 + 1e-12) <= 1.02 * best * (1 + 1e-12)
    assert np.all(looks.target[filled.allowed.rest] == -1)


def test_the_search_never_costs_more_and_knows_what_it_costs(tmp_path: Path) -> None:
    filled = fill(read(tracking(9, 30, 2, 10.0, 0.1), tmp_path))
    sweep = filled.sweep()
    data = singles(filled.groups, filled.owners, 9, filled.steps, filled.charges)
    start = filled.allowed.round(filled.allowed.uniform())
    costs = np.empty(9)
    all_costs(start[:, 0].copy(), data.arrays, costs)
    assert np.sum(costs) == pytest.approx(sweep.cost(start), rel=1e-12)
    looks = filled.looks
    arguments = (filled.allowed, looks.target, looks.resource, looks.price, data, 3e6, Monitor())
    found, made = improve(start, *arguments)
    assert made > 0 and not filled.allowed.check(found)
    assert sweep.cost(found) < sweep.cost(start)
    assert np.array_equal(found, improve(start, *arguments)[0])


def test_five_targets_need_no_more_than_thirty_lines(tmp_path: Path) -> None:
    assert len(FIVE.splitlines()) <= 30
    problem = read(FIVE, tmp_path)
    solution = oc.solve(problem)
    result = solution.as_dict()
    assert result["status"] == "certified" and result["top"]["of"] == "grid"
    assert max(result["bounds"].values()) == result["lower_bound"] <= result["cost"]
    assert result["blocks"] == 5 and len(result["per_target"]["cost"]) == 5
    assert sum(result["per_target"]["cost"]) == pytest.approx(result["cost"], rel=1e-12)
    assert set(result["schedule"][0]) == {"start", "end", "resource", "target"}
    assert not any(4 < (r["start"] + r["end"]) / 2 < 5 for r in result["schedule"])
    assert solution.arrays["prices"].shape == (40, 1)


def test_prices_are_what_one_more_look_saves(tmp_path: Path) -> None:
    document = tracking(6, 20, 1, 8.0, 0.1)
    problem = read(document, tmp_path)
    solution = oc.solve(problem, "relaxed")
    filled = fill(problem)
    sweep = filled.sweep()
    base = relax(sweep, filled.allowed, 1e-6, 5000, Monitor())
    gradient = base.gradient[:, 0]
    a, b = filled.allowed.starts[10], filled.allowed.starts[11] - 1
    second = np.sort(gradient[a:b])[1]
    assert solution.arrays["prices"][10, 0] == pytest.approx(-second, rel=0.05)


def test_the_document_gives_the_identical_problem(tmp_path: Path) -> None:
    from occontrol.api import document

    problem = read(FIVE, tmp_path)
    again = read(document(problem), tmp_path)
    assert document(again) == document(problem)
    one, two = fill(problem).sweep(), fill(again).sweep()
    v = fill(problem).allowed.uniform()
    assert one.cost(v) == two.cost(v)


def test_a_schedule_of_one_target_is_that_of_its_row(tmp_path: Path) -> None:
    problem = read(FIVE, tmp_path)
    schedule = oc.solve(problem).schedule
    assert isinstance(schedule, LookSchedule)
    own = target_schedule(problem, schedule, 3)
    assert own.names == ("d@radar", "idle")
    assert np.sum(own.weights[:, 0]) == np.sum(schedule.target == 3)


REFUSED = [
    ("capacity: 1,", "capacity: 1.5,", "the capacity of resource 'radar' is no whole number"),
    ("model: aircraft}", "model: aeroplane}", "there is no target model 'aeroplane'\n  hint: there are: aircraft"),
    ("resource: radar, C", "resource: rader, C", "there is no resource 'rader'\n  hint: did you mean 'radar'"),
    ("noise: [[sharp*r]]", "noise: [[sharp*s]]", "uses the unknown name 's'"),
    ("C: [[1, 0]]", "C: [[1, 0, 0]]", "is 1x3, it must have 2 columns\n  hint: the model has 2 states"),
    ("name: [a, b, c, d, e]", "name: [a, b, c, d, a]", "the name 'a' of a target is used twice"),
    ("q: [0.1, 0.2,", "q: [0.2,", "the column 'q' has 4 rows, others have 5"),
    ("r: [1, 1,", "r: [-1, 1,", "is not positive definite"),
    ("    running: {diag: [1, 0]}\n", "", "target model 'aircraft' has neither 'running' nor 'output'"),
    (", noise: [[sharp*r]]}", "}", "the looks of 'radar' have no 'noise'"),
    ("windows: [[0, 4], [5, 10]]", "windows: [[20, 30]]", "no resource ever sees a target"),
]


@pytest.mark.parametrize(("old", "new", "words"), REFUSED, ids=[w[:30] for *_, w in REFUSED])
def test_what_is_wrong_is_said_with_its_line(old: str, new: str, words: str, tmp_path: Path) -> None:
    assert FIVE.count(old) == 1
    with pytest.raises(oc.ProblemError) as error:
        read(FIVE.replace(old, new), tmp_path)
    assert words in str(error.value)
    assert "problem.yaml:" in str(error.value)


def test_methods_that_do_not_do_targets_say_so(tmp_path: Path) -> None:
    problem = read(FIVE, tmp_path)
    for name in ("hminimal", "collocation", "best-single"):
        with pytest.raises(oc.UsageError, match=f"{name} does not do many targets\n  hint: there are: schedule"):
            oc.solve(problem, name)
    with pytest.raises(oc.UsageError, match="tradeoff does not do many targets"):
        oc.tradeoff(problem, [0.1])
    for name in ("costate-index", "greedy", "information", "largest-trace", "round-robin", "random"):
        solution = oc.solve(problem, name)
        assert solution.cost >= solution.result["lower_bound"] and solution.schedule.is_integer


def test_a_dense_plant_that_falls_apart_is_told_so(tmp_path: Path) -> None:
    from occontrol.api import family_of

    plain = dense(read(tracking(4, 12, 1, 6.0, 0.05), tmp_path))
    said = dict(family_of(plain).describe(plain))["blocks"]
    assert said.startswith("12 parts that nothing couples, the largest of 2 states: swept part by part")


@pytest.mark.slow
def test_a_matrix_of_too_many_states_names_the_way_out(tmp_path: Path) -> None:
    n = 2001
    row = [0.0] * n
    document = {
        "family": "athans", "horizon": {"end": 1, "intervals": 2},
        "plant": {"A": [row] * n, "noise": [[0]], "initial": {"covariance": [[1]]}},
        "sensors": [{"name": "s", "C": [row], "noise": [[1]]}], "objective": {"output": [row]},
    }  # fmt: skip
    with pytest.raises(oc.ProblemError) as error:
        read(document, tmp_path)
    assert "the plant has 2001 states, more than 2000 in one matrix" in str(error.value)
    assert "write what is independent as resources, target_models, targets, looks" in str(error.value)


def test_a_weight_slightly_below_zero_stays_convex() -> None:
    from occontrol.families.athans.targets.matrix_columns import semidefinite

    weights = np.array([np.diag([1.0, -1e-11]), np.diag([2.0, 0.5])])
    found = semidefinite(weights)
    assert np.all(np.linalg.eigvalsh(found) >= 0) and np.array_equal(found[1], weights[1])
    assert np.max(np.abs(found - weights)) <= 1.1e-11
