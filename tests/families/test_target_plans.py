"""What every family hands over for a target: its own filter's numbers, its schedule, or why not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import occontrol
from occontrol.api import family_of, run_filter, simulate
from occontrol.core.errors import UsageError
from occontrol.core.measurement import Measurement
from occontrol.core.schedule import Schedule
from occontrol.core.target import TargetPlan, schedule_alone
from occontrol.files.export.flight.content import Options, make_content
from occontrol.files.export.flight.reference import ReferenceFilter, Status
from tests.target_problems import FIVE

PROBLEMS = Path(__file__).parents[2] / "problems"


def replayed(plan: TargetPlan, measurements: list[Measurement]) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and deviations after every interval."""
    samples = [np.full(sum(plan.rows[j] for j in active), np.nan) for active in plan.active]
    for s in measurements:
        j = plan.names.index(s.sensor)
        k = int(np.argmin(np.abs(plan.edges[1:] - s.time)))
        first = sum(plan.rows[i] for i in plan.active[k] if i < j)
        samples[k][first : first + plan.rows[j]] = s.values
    reference = ReferenceFilter(make_content(plan, Options()))
    means, deviations = [], []
    for z in samples:
        assert reference.step(z) == Status.OK
        means.append(reference.x)
        deviations.append(np.sqrt(reference.variance()))
    return np.array(means), np.array(deviations)


@pytest.mark.parametrize("lost", [0, 4])
@pytest.mark.parametrize("name", ["oshman_every_step", "scaled"])
def test_choices_of_vlambda_and_their_filter(name: str, lost: int, solved) -> None:
    if name == "scaled":
        text = (Path(occontrol.__file__).parent / "families" / "vlambda" / "template.yaml").read_text()
        solution = occontrol.solve(problem_of(text + "\nscales: [2.0, 3.0]\n" if "scales" not in text else text))
    else:
        solution = solved(name)
    measurements = list(simulate(solution.problem, solution, 3)[0])
    del measurements[2 : 2 + lost]
    want = run_filter(solution.problem, solution, measurements)
    plan = family_of(solution.problem).target_plan(solution.problem, solution)
    assert plan.variable == "k" and plan.instants and plan.edges[:3].tolist() == [0.0, 0.0, 1.0]
    x, sd = replayed(plan, measurements)
    assert np.max(np.abs(x - want.mean) / want.standard_deviation) < 1e-10
    assert np.max(np.abs(sd / want.standard_deviation - 1)) < 1e-10


def problem_of(text: str):
    import tempfile

    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        file.write(text)
        file.flush()
        return occontrol.read_problem(file.name)


@pytest.mark.parametrize("lost", [0, 1])
def test_one_batch_of_precision_is_one_step(lost: int, solved) -> None:
    solution = solved("space_object")
    problem = solution.problem
    measurements = list(simulate(problem, solution, 3)[0])[lost:]
    want = run_filter(problem, solution, measurements)
    plan = family_of(problem).target_plan(problem, solution)
    assert plan.intervals == 1 and set(plan.rows) == {1}
    every = [Measurement(plan.edges[1], label, s.values) for label, s in labelled(problem, measurements)]
    x, sd = replayed(plan, every)
    assert np.max(np.abs(x[-1] - want.mean[-1]) / want.standard_deviation[-1]) < 1e-8
    assert np.allclose(sd[-1], want.standard_deviation[-1], rtol=1e-8)
    if not lost:
        assert np.allclose(sd[-1] ** 2, np.diag(solution.arrays["posterior"][0]), rtol=1e-8)


def labelled(problem, measurements: list[Measurement]):
    """The label of every measurement of a batch: its sensor and its step."""
    interval = problem.plant.interval
    for s in measurements:
        step = round(s.time / interval)
        yield (s.sensor if problem.batch == 1 else f"{s.sensor}@{step}"), s


def test_several_batches_have_no_gain_beforehand(solved) -> None:
    solution = solved("space_object")
    several = occontrol.read_problem(PROBLEMS / "lorenz96_enkf_batch3.yaml")
    object.__setattr__(several, "batches", 2)
    with pytest.raises(UsageError, match="the gains of several batches follow from the estimates between them"):
        family_of(several).target_plan(several, solution)


def test_robust_and_hybrid_hand_over_schedules_that_do_not_depend_on_data(solved) -> None:
    solution = solved("robust_oscillator")
    plan = family_of(solution.problem).target_plan(solution.problem, solution)
    assert plan.model is None and plan.why == "the estimate of family robust is a set, and no Kalman filter"
    chosen = [plan.names[active[0]] for active in plan.active]
    segments = [entry["sensors"][0] for entry in solution.result["schedule"]]
    merged = [name for i, name in enumerate(chosen) if i == 0 or chosen[i - 1] != name]
    assert merged == segments
    hybrid = occontrol.read_problem(PROBLEMS / "turning_target.yaml")
    object.__setattr__(hybrid, "runs", 2)
    family = family_of(hybrid)
    done = occontrol.solve(hybrid, "alternate")
    plan = family.target_plan(hybrid, done)
    assert plan.model is None and len({tuple(active) for active in plan.active}) > 1
    assert [plan.active[0], plan.active[1]] == [plan.active[2], plan.active[3]]
    chance = occontrol.solve(hybrid, "random")
    with pytest.raises(UsageError, match="with method random the sensors are chosen while it runs"):
        family.target_plan(hybrid, chance)


def test_many_targets_are_refused(tmp_path: Path) -> None:
    (tmp_path / "five.yaml").write_text(FIVE)
    problem = occontrol.read_problem(tmp_path / "five.yaml")
    with pytest.raises(UsageError, match="code on a target does not do many targets at once"):
        family_of(problem).target_plan(problem, occontrol.solve(problem, "greedy"))
    with pytest.raises(UsageError, match="the on-line filter does not do many targets at once"):
        family_of(problem).filter_loop(problem, occontrol.solve(problem, "greedy"))


def test_of_shared_times_the_largest_share_is_taken() -> None:
    schedule = Schedule(np.array([0.0, 1, 2]), np.array([[0.4, 0.3, 0.3], [0.0, 0.8, 0.2]]), ("a", "b", "c"))
    assert [tuple(active) for active in schedule_alone(schedule, "").active] == [(0,), (1,)]
