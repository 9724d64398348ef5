"""Problems without an end from a file to a run folder: cycles, bounds, proofs, filters, and what is refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import document, family_of
from occontrol.core.solution import Status
from occontrol.families.athans.periodic.fill import fill, flow
from occontrol.families.athans.periodic.transient import transient
from occontrol.files.export.flight.content import Options, make_content
from occontrol.files.export.flight.reference import ReferenceFilter

VEHICLE = """family: athans
name: vehicle
horizon: {infinite: true}
plant:
  F: [[1, 0, 0.2, 0], [0, 1, 0, 0.2], [0, 0, 1, 0], [0, 0, 0, 1]]
  G: [[0.02, 0], [0, 0.02], [0.2, 0], [0, 0.2]]
  Q: [[1, 0.25], [0.25, 1]]
  initial: {covariance: {identity: 4, scale: 9}}
sensors:
  - {name: one, H: [[1, 0, 0, 0], [0, 1, 0, 0]], R: {diag: [2.4, 0.4]}}
  - {name: two, H: [[1, 0, 0, 0], [0, 1, 0, 0]], R: {diag: [0.7, 1.4]}}
objective: {running: {identity: 4}, running_at: prior}
method: {name: periodic, max_period: 8, relative_gap: 2.0e-4, time_limit: null}
"""
RADARS = """family: athans
name: two radars
horizon: {infinite: true, step: 0.5}
plant:
  A: [[0, 1], [-1, -0.4]]
  noise: [[0.05, 0], [0, 0.5]]
  initial: {covariance: {diag: [5, 5]}}
sensors:
  - {name: range, C: [[1, 0]], noise: [[0.1]], cost: 0.6}
  - {name: doppler, C: [[0, 1]], noise: [[0.4]], cost: 0.2}
  - idle
objective: {cost_weight: 0.5, running: {identity: 2}}
method: {name: periodic, max_period: 5, relative_gap: 1.0e-3, time_limit: null}
"""
SAMPLES = RADARS.replace("step: 0.5}", "step: 0.5}\nsensing: samples")
SAMPLES = SAMPLES.replace("periodic, max", "periodic, max_nodes: 600, max")


def problem_of(text: str, folder: Path, name: str = "problem.yaml") -> oc.athans.PeriodicProblem:
    """The problem in a text."""
    (folder / name).write_text(text, encoding="utf-8")
    return oc.read_problem(folder / name)


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory):
    """(problem, solution) by the name of the text, found once."""
    folder, found = tmp_path_factory.mktemp("endless"), {}
    for name, text in (("vehicle", VEHICLE), ("radars", RADARS), ("samples", SAMPLES)):
        problem = problem_of(text, folder, f"{name}.yaml")
        found[name] = problem, oc.solve(problem)
    return found


def test_the_vehicle_is_solved_and_proven_for_all_schedules(solved) -> None:
    _problem, solution = solved["vehicle"]
    result = solution.as_dict()
    assert result["word"] == ["one", "two", "one", "two", "two"] and result["period"] == 5
    assert result["cost"] == pytest.approx(1.1562896, abs=5e-8)
    assert result["bounds"]["averaged"] == pytest.approx(1.1488996, abs=5e-8)
    assert 1.15605 < result["lower_bound"] == result["bounds"]["tree"] <= result["cost"]
    assert result["shares"] == pytest.approx({"one": 0.41087, "two": 0.58913}, abs=5e-6)
    assert result["status"] == "certified" and result["leaves"] == len(solution.arrays["proof_words"])
    assert result["top"] == {k: result[k] for k in ("cost", "lower_bound", "relative_gap")} | {"of": "problem"}
    assert result["schedule"][:2] == [{"k": 0, "sensors": ["one"]}, {"k": 1, "sensors": ["two"]}]
    assert result["complete_to"] == 8 and result["by_period"]["2"] == pytest.approx(1.1585311, abs=5e-8)


@pytest.mark.parametrize("name", ["vehicle", "radars", "samples"])
def test_a_file_becomes_the_same_problem_again(name: str, solved, tmp_path: Path) -> None:
    problem, _ = solved[name]
    (tmp_path / "again.json").write_text(json.dumps(document(problem)), encoding="utf-8")
    again = oc.read_problem(tmp_path / "again.json")
    assert document(again) == document(problem) and again.sensing == problem.sensing
    assert family_of(problem).describe(problem) == family_of(again).describe(again)


@pytest.mark.parametrize("name", ["vehicle", "radars", "samples"])
def test_a_run_is_certified_anew_and_a_spoilt_one_is_not(name: str, solved, tmp_path: Path) -> None:
    problem, solution = solved[name]
    oc.write_run(tmp_path / "run", problem, solution)
    problem, recorded = oc.read_run(tmp_path / "run")
    family = family_of(problem)
    judged = oc.certify(problem, recorded.schedule, family.claims_of(problem, recorded))
    assert judged.status is solution.status and judged.cost == pytest.approx(solution.cost, rel=1e-12)
    assert judged.certificate.lower_bound == pytest.approx(solution.certificate.lower_bound, rel=1e-9)
    higher = dataclasses.replace(family.claims_of(problem, recorded), relative_gap=None)
    bound = 0.5 * (solution.cost + solution.certificate.lower_bound)
    higher = oc.certify(problem, recorded.schedule, dataclasses.replace(higher, lower_bound=bound))
    assert higher.status is Status.DISAGREES and "the stated lower bound is" in higher.message
    arrays = dict(recorded.arrays)
    arrays |= {key: arrays[key][:-1] for key in ("proof_words", "proof_points", "proof_starts")}
    spoilt = family.claims_of(problem, dataclasses.replace(recorded, arrays=arrays))
    judged = oc.certify(problem, recorded.schedule, spoilt)
    assert judged.status is Status.DISAGREES and "do not stand for all schedules" in judged.message
    # without a proof of its own the bound is one that certify proves
    alone = oc.certify(problem, recorded.schedule)
    assert alone.certificate.lower_bound <= solution.cost and alone.cost == pytest.approx(solution.cost, rel=1e-12)


def test_anybodys_cycle_is_read_and_judged(solved, tmp_path: Path) -> None:
    problem, _solution = solved["vehicle"]
    (tmp_path / "s.csv").write_text("start,end,sensors\n0,0,one\n1,1,two\n", encoding="utf-8")
    judged = oc.certify(problem, oc.read_schedule(tmp_path / "s.csv", problem))
    assert judged.cost == pytest.approx(1.1585311, abs=5e-8) and judged.numbers.word == ["one", "two"]
    problem, _ = solved["radars"]
    (tmp_path / "s.csv").write_text("start,end,sensors\n0,1,range\n1,1.5,idle\n", encoding="utf-8")
    assert oc.certify(problem, oc.read_schedule(tmp_path / "s.csv", problem)).numbers.word == ["range", "range", "idle"]
    (tmp_path / "s.csv").write_text("start,end,sensors\n0,0.7,range\n0.7,1.5,idle\n", encoding="utf-8")
    with pytest.raises(oc.ProblemError, match=r"s.csv:2: the schedule changes at t = 0.7, which is no multiple of"):
        oc.read_schedule(tmp_path / "s.csv", problem)


def test_the_flow_of_continuous_sensing_is_that_of_an_integrator(solved) -> None:
    from scipy.integrate import solve_ivp

    g = np.random.default_rng(2)
    A, L = g.standard_normal((3, 3)), np.diag([4.0, 0.5, 0.0])
    noise = np.diag([0.1, 0.0, 1.0])
    F, Q, gained = flow(A, noise, L, 0.8)
    S0 = np.diag([2.0, 3.0, 0.5])

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        X = y.reshape(3, 3)
        return (A @ X + X @ A.T + noise - X @ L @ X).ravel()

    end = solve_ivp(rate, (0, 0.8), S0.ravel(), "DOP853", rtol=1e-12, atol=1e-13).y[:, -1].reshape(3, 3)
    assert Q + F @ np.linalg.inv(np.linalg.inv(S0) + gained) @ F.T == pytest.approx(end, rel=1e-9, abs=1e-10)
    _problem, solution = solved["radars"]
    r = solution.numbers
    assert r.top.of == "grid" and r.continuous.cost == pytest.approx(r.cost, rel=1e-10)
    assert r.continuous.lower_bound == r.bounds["averaged"] < r.bounds["tree"] <= r.cost


def test_the_rule_of_a_step_never_says_too_much(solved) -> None:
    """From far larger covariances it falls short of the integral: bounds stay bounds."""
    problem, _ = solved["radars"]
    filled = fill(problem)
    from occontrol.families.athans.periodic.check import plain_cycle

    for times in (1.0, 3.0, 30.0, 1e3):
        for a in range(3):
            S = times * filled.smallest
            charge = filled.letters.step(S, a)[1]
            true = plain_cycle(problem, np.array([a]), S).cost
            assert charge <= true * (1 + 1e-9) and (times > 5 or charge == pytest.approx(true, rel=1e-9))


def test_finite_horizons_of_growing_length_come_to_the_cycle(solved, tmp_path: Path) -> None:
    _, solution = solved["vehicle"]
    costs = []
    for steps in (20, 40):
        text = VEHICLE.replace("infinite: true", f"steps: {steps}").split("method:")[0]
        problem = problem_of(text, tmp_path)
        done = oc.solve(problem, oc.RelaxRoundPolish(polish=10))
        costs.append(done.cost)
    mean = (costs[1] - costs[0]) / 20  # what begins and ends cancels
    assert mean == pytest.approx(solution.cost, rel=2e-3) and mean >= solution.certificate.lower_bound * (1 - 1e-3)


def test_the_answer_does_not_depend_on_units_and_order(solved, tmp_path: Path) -> None:
    _, solution = solved["vehicle"]
    lines = VEHICLE.replace("running: {identity: 4}", "running: {diag: [1.0e-6, 1, 1.0e-6, 1]}").splitlines()
    scaled = [  # x1 and x3 in thousandths of their unit
        line.replace("G: [[0.02, 0], [0, 0.02], [0.2, 0], [0, 0.2]]", "G: [[20, 0], [0, 0.02], [200, 0], [0, 0.2]]")
        .replace("H: [[1, 0, 0, 0]", "H: [[0.001, 0, 0, 0]")
        for line in lines
    ]  # fmt: skip
    scaled[9], scaled[10] = scaled[10], scaled[9]
    other = oc.solve(problem_of("\n".join(scaled), tmp_path))
    assert other.cost == pytest.approx(solution.cost, rel=1e-10)
    assert other.certificate.lower_bound == pytest.approx(solution.certificate.lower_bound, rel=1e-4)
    assert sorted(other.numbers.word) == sorted(solution.numbers.word)
    assert other.numbers.shares == pytest.approx(solution.numbers.shares, abs=1e-5)


def test_the_filter_of_a_cycle_repeats_itself_and_runs_on_line(solved) -> None:
    for name in ("vehicle", "radars", "samples"):
        problem, solution = solved[name]
        measurements, truth = oc.simulate(problem, solution, 3)
        estimate = oc.run_filter(problem, solution, measurements)
        period, deviations = solution.numbers.period, estimate.standard_deviation[1:]
        assert deviations[period : 2 * period] == pytest.approx(deviations[:period], rel=1e-9)
        assert len(truth.times) >= 200 and 0.7 < np.nanmean(estimate.nis / np.maximum(estimate.dimension, 1)) < 1.3
        loop, by_time = oc.online(problem, solution), {}
        for m in measurements:
            by_time.setdefault(round(m.time / problem.step), {})[m.sensor] = m.values
        first = 0 if problem.takes_readings else 1
        for k in range(3 * period + 1):
            step = loop.step(by_time.get(k + first, {}))
            assert step.time == pytest.approx(estimate.times[k + 1], abs=1e-9)
            assert step.estimate == pytest.approx(estimate.mean[k + 1], rel=1e-9, abs=1e-9)
        plan = family_of(problem).target_plan(problem, solution)
        again = 1 if problem.takes_readings else 0
        assert plan.again == again and plan.intervals == period + again and plan.model is not None
        assert plan.edges[-1] - plan.edges[again] == pytest.approx(period * problem.step)
        reference = ReferenceFilter(make_content(plan, Options()))
        loop = oc.online(problem, solution)
        for k in range(3 * period + 1):  # what the code for a target does, beside the loop
            z = by_time.get(k + first, {})
            step = loop.step(z)
            assert reference.step(np.concatenate([*z.values(), np.zeros(0)])) == 0
            assert reference.x == pytest.approx(step.estimate, rel=1e-9, abs=1e-9)
            assert reference.variance() == pytest.approx(np.diag(step.covariance), rel=1e-9)
            assert reference.time_after() == pytest.approx(step.time, abs=1e-9)
        S = None
        for _ in range(2):  # a filter of its own along the plan comes back to where the cycle began
            start = S
            S = plan.model.covariance if S is None else S
            parts = (plan.model.transition, plan.model.observe, plan.model.noise_root)
            for F, H, N in list(zip(*parts, strict=True))[0 if start is None else again :]:
                n = len(F)
                joint = np.vstack([F, H]) @ S @ np.vstack([F, H]).T + N @ N.T
                gain = np.linalg.solve(joint[n:, n:], joint[n:, :n]).T if len(H) else np.zeros((n, 0))
                S = joint[:n, :n] - gain @ joint[n:, :n]
            start = plan.model.covariance if not again and start is None else start
            assert start is None or S == pytest.approx(start, rel=1e-9, abs=1e-12)
        tables = family_of(problem).filter_tables(problem, solution)
        assert len(tables["transition"]) == period
        assert tables["covariance"][0] == pytest.approx(tables["covariance"][-1])


def test_the_way_into_the_cycle(solved) -> None:
    problem, solution = solved["vehicle"]
    steps, priors = solution.result["transient_steps"], solution.arrays["transient_covariance"]
    steady = solution.arrays["prior_covariance"]
    assert priors[0] == pytest.approx(9 * np.eye(4))
    off = [np.max(np.abs(np.diag(S) / np.diag(steady[k % 5]) - 1)) for k, S in enumerate(priors)]
    assert off[steps - 1] > 0.01 and all(x <= 0.01 for x in off[steps:])
    letters = fill(problem).letters
    word = np.array([0, 1, 0, 1, 1])
    assert transient(letters, word, steady, steady[0]).steps == 0


def test_an_export_is_one_cycle_without_its_proof(solved, tmp_path: Path) -> None:
    problem, solution = solved["vehicle"]
    oc.write_run(tmp_path / "run", problem, solution)
    for kind in ("csv", "json", "npz", "mat", "c"):
        written = oc.export_run(tmp_path / "run", kind, tmp_path / f"out.{kind}" if kind != "csv" else tmp_path / "csv")
        assert written and not any("proof" in path.name for path in written)
    assert (tmp_path / "csv" / "schedule.csv").read_text(encoding="utf-8").splitlines()[1].startswith("0,0,one")
    with np.load(tmp_path / "out.npz") as arrays:
        assert not [name for name in arrays.files if "proof" in name]
        assert [name for name in arrays.files if name.endswith("gain")]


WRONG = [
    (VEHICLE, "{name: one, H", "{name: one, windows: [[0, 3]], H", "nothing says when they come again"),
    (VEHICLE, "[0, 0, 0, 1]]\n", '[0, 0, 0, "cos(k)"]]\n', r"plant\.F changes with k\n  hint: for ever the"),
    (VEHICLE, "running_at: prior", "output: {identity: 4}", "output belongs to a horizon that ends"),
    (VEHICLE, "running_at: prior", "running_at: integral", "running_at is 'integral'\n  hint: one of: post"),
    (VEHICLE, "objective: {running: {identity: 4}, running_at: prior}", "objective: {}", "objective has no 'running'"),
    (RADARS, ", step: 0.5", "", "horizon has no 'step'"),
    (RADARS, "step: 0.5", "step: -1", "step is -1, it must be a time above 0"),
    (RADARS, "infinite: true", "infinite: false", "infinite"),
    (RADARS, "cost: 0.6", "cost: -1", "cost of sensor 'range' is -1"),
    (RADARS, "C: [[1, 0]]", "C: [[1, 0, 0]]", "C of sensor 'range' is 1x3, but the plant has 2 states"),
    (RADARS, "max_period: 5", "max_period: 0", "max_period of method periodic is 0"),
]


@pytest.mark.parametrize(("text", "old", "new", "said"), WRONG)
def test_what_is_wrong_is_said_with_its_place(text: str, old: str, new: str, said: str, tmp_path: Path) -> None:
    assert text.count(old) == 1
    with pytest.raises(oc.ProblemError, match=said) as error:
        problem_of(text.replace(old, new), tmp_path)
    assert "problem.yaml:" in str(error.value)


def test_other_methods_and_other_horizons_are_refused(solved, tmp_path: Path) -> None:
    problem, _solution = solved["vehicle"]
    said = r"greedy does not do an infinite horizon\n  hint: method: periodic"
    with pytest.raises(oc.UsageError, match=said):
        oc.solve(problem, "greedy")
    finite = problem_of(VEHICLE.replace("infinite: true", "steps: 5").split("method:")[0], tmp_path)
    for method in ("periodic", oc.Periodic()):
        with pytest.raises(oc.UsageError, match="periodic does not do a horizon that ends"):
            oc.solve(finite, method)
    with pytest.raises(oc.UsageError, match="tradeoff does not do an infinite horizon"):
        oc.tradeoff(problem, [1.0])
    assert family_of(problem).compare_names(problem) == ["periodic", "shares"]
    blind = VEHICLE.replace("H: [[1, 0, 0, 0], [0, 1, 0, 0]]", "H: [[0, 0, 1, 0], [0, 0, 0, 1]]")
    with pytest.raises(oc.InfeasibleError, match="no sensor sees a mode of the plant that stays"):
        oc.solve(problem_of(blind, tmp_path))
    both, short = "[[1, 0, 0, 0], [0, 1, 0, 0]], R: {diag: ", VEHICLE.replace("max_period: 8", "max_period: 1")
    short = short.replace(f"{both}[2.4, 0.4]}}", "[[1, 0, 0, 0]], R: [[1]]")
    short = short.replace(f"{both}[0.7, 1.4]}}", "[[0, 1, 0, 0]], R: [[1]]")
    with pytest.raises(oc.SolveFailed, match="no cycle of up to 1 step keeps the covariance bounded"):
        oc.solve(problem_of(short, tmp_path))


def test_a_cycle_keeps_its_rules(tmp_path: Path) -> None:
    cheap = RADARS.replace("cost: 0.6", "cost: 0.2").replace("1.0e-3,", "1.0e-3, max_nodes: 60,")
    text = cheap.replace("[[0.1]], cost: 0.2", "[[0.1]], cost: 0.2, min_on: 1.0, max_uses: 3")
    text = text.replace("objective", "constraints: {max_switches: 2}\nobjective")
    problem = problem_of(text, tmp_path)
    assert document(oc.read_problem(tmp_path / "problem.yaml")) == document(problem)
    solution = oc.solve(problem)
    weights, p = solution.arrays["weights"], solution.numbers.period
    assert np.sum(weights[:, 0]) <= 3 and np.sum(np.any(weights != np.roll(weights, 1, axis=0), axis=1)) <= 2
    free = oc.solve(problem_of(cheap, tmp_path))
    assert free.cost <= solution.cost and "holds without the rules" in solution.message and p <= 5
    short = oc.Schedule(np.array([0.0, 0.5, 1.0]), np.eye(3)[[0, 2]], tuple(problem.sensors.names))
    with pytest.raises(oc.ProblemError, match=r"sensor 'range' is on for 0.5, min_on is 1"):
        oc.certify(problem, short)


@pytest.mark.parametrize("name", ["vehicle", "two_radars"])
def test_a_shipped_problem_meets_what_it_expects(name: str) -> None:
    problem = oc.read_problem(Path(__file__).resolve().parents[4] / "problems" / "endless" / f"{name}.yaml")
    solution, expect = oc.solve(problem), problem.expect
    assert solution.status is Status.CERTIFIED and expect["source"]
    assert solution.cost == pytest.approx(expect["cost"], rel=expect["tolerance"])


def test_pictures(solved) -> None:
    for problem, solution in solved.values():
        figures = family_of(problem).figures(problem, solution)
        assert {"overview", "cycle", "deviations", "periods", "transient"} <= set(figures)
        assert all(figure.axes for figure in figures.values())
