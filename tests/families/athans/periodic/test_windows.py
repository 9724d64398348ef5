"""Windows that come again and again, from a file to a filter; and what of them is refused."""

from __future__ import annotations

import dataclasses
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import document, family_of
from occontrol.families.athans.periodic.check import plain_cycle
from occontrol.families.athans.periodic.prove import setting_of
from occontrol.scheduling.periodic.potential import cycle_of
from tests.families.athans.periodic.test_periodic import RADARS, VEHICLE, problem_of

PROOF = "relative_gap: 3.0e-3, max_nodes: 2500"
SIGHT = RADARS.replace("relative_gap: 1.0e-3", PROOF).replace("step: 0.5}", "step: 0.5, repeat: 2}")
SIGHT = SIGHT.replace("cost: 0.6}", "cost: 0.6, windows: [[0.5, 1.5]]}")
TURNS = VEHICLE.replace("infinite: true", "infinite: true, repeat: 3").replace("relative_gap: 2.0e-4", PROOF)
TURNS = TURNS.replace("{diag: [2.4, 0.4]}}", "{diag: [2.4, 0.4]}, windows: [[1, 1]]}")


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory):
    """(problem, solution) by the name of the text, found once."""
    folder, found = tmp_path_factory.mktemp("windows"), {}
    for name, text in (("sight", SIGHT), ("turns", TURNS)):
        problem = problem_of(text, folder, f"{name}.yaml")
        found[name] = problem, oc.solve(problem)
    return found


@pytest.mark.parametrize("name", ["sight", "turns"])
def test_the_best_cycle_of_a_file_with_windows_is_found_and_proven(name: str, solved) -> None:
    problem, solution = solved[name]
    P, best = problem.phases, np.inf
    setting, root = setting_of(problem), setting_of(problem).root
    for word in product(*(np.flatnonzero(problem.opened[k % P]) for k in range({"sight": 4, "turns": 6}[name]))):
        cycle = cycle_of(setting.letters, np.array(word))
        if cycle is not None and cycle.cost < best:
            start = root @ cycle.priors[0] @ root.T  # judged by other code, which knows no letters
            best = plain_cycle(problem, np.array(word), start).cost
    assert solution.certificate.relative_gap < 0.01 and solution.cost == pytest.approx(best, rel=1e-8)
    assert solution.numbers.period % P == 0 and "keep" in family_of(problem).summarise(problem, solution)[3][1]
    free = oc.solve(dataclasses.replace(problem, repeat=None, sensors=[
        dataclasses.replace(s, windows=None) for s in problem.sensors
    ]))  # fmt: skip
    bounds, without = solution.numbers.bounds, free.numbers.bounds
    assert free.cost < solution.cost and without["averaged"] < bounds["averaged"] <= solution.cost
    share = solution.numbers.shares[problem.sensors[0].name]
    assert share <= np.mean(problem.opened[:, 0]) + 1e-9


@pytest.mark.parametrize("name", ["sight", "turns"])
def test_files_runs_and_filters_keep_the_windows(name: str, solved, tmp_path: Path) -> None:
    problem, solution = solved[name]
    oc.write_run(tmp_path / "run", problem, solution)
    again, recorded = oc.read_run(tmp_path / "run")
    assert document(again) == document(problem) and np.array_equal(again.opened, problem.opened)
    judged = oc.certify(again, recorded.schedule, family_of(again).claims_of(again, recorded))
    assert judged.status is solution.status
    assert judged.certificate.lower_bound == pytest.approx(solution.certificate.lower_bound, rel=1e-9)
    measurements, _ = oc.simulate(problem, solution, 1)
    open_ = problem.opened[:, 0]
    first = problem.sensors[0].name
    ends = {"sight": problem.step, "turns": 0.0}[name]  # continuous sensing reports at the ends of steps
    at = [round((m.time - ends) / problem.step) % problem.phases for m in measurements if m.sensor == first]
    assert at and all(open_[k] for k in at)
    estimate = oc.run_filter(problem, solution, measurements)
    period, spread = solution.numbers.period, estimate.standard_deviation[1:]
    assert spread[period : 2 * period] == pytest.approx(spread[:period], rel=1e-9)


def test_a_cycle_that_leaves_the_windows_is_refused(solved, tmp_path: Path) -> None:
    problem, _ = solved["turns"]
    for word, said in (
        ("one two two", "one is not open at k = 0"),
        ("two one", "the cycle has 2 steps, windows come again every 3"),
    ):
        lines = [f"{k},{k},{sensor}" for k, sensor in enumerate(word.split())]
        (tmp_path / "s.csv").write_text("\n".join(["start,end,sensors", *lines]), encoding="utf-8")
        with pytest.raises(oc.ProblemError, match=said):
            oc.certify(problem, oc.read_schedule(tmp_path / "s.csv", problem))


WRONG = [
    (TURNS, ", repeat: 3", "", "sensor 'one' has windows, and nothing says when they come again"),
    (TURNS, ", windows: [[1, 1]]", "", "repeat says when windows come again, and no sensor has any"),
    (SIGHT, "repeat: 2", "repeat: 1.7", r"repeat is 1.7, it must be a multiple of the step 0.5"),
    (SIGHT, "repeat: 2", "repeat: 1000", "repeat is 2000 steps"),
    (SIGHT, "[0.5, 1.5]", "[0.5, 2.5]", r"window \[0.5, 2.5\] of sensor 'range' does not lie in one round"),
    (SIGHT, "[0.5, 1.5]", "[0.5, 1.2]", r"window \[0.5, 1.2\] of sensor 'range' does not begin and end with a step"),
    (TURNS, "[[1, 1]]", "[[0.2, 0.8]]", "no window of sensor 'one' holds a step"),
]


@pytest.mark.parametrize(("text", "old", "new", "said"), WRONG)
def test_what_is_wrong_with_windows_is_said_with_its_place(text, old, new, said, tmp_path: Path) -> None:
    assert text.count(old) == 1
    with pytest.raises(oc.ProblemError, match=said) as error:
        problem_of(text.replace(old, new), tmp_path)
    assert "problem.yaml:" in str(error.value)


def test_a_step_without_an_open_sensor_is_refused(tmp_path: Path) -> None:
    text = TURNS.replace("{diag: [0.7, 1.4]}}", "{diag: [0.7, 1.4]}, windows: [[1, 1]]}")
    with pytest.raises(oc.ProblemError, match="too few sensors are open in the steps from k = 0, 2"):
        problem_of(text, tmp_path)
