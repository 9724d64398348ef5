"""What certify refuses, in the words of the reader of schedule files, and what it accepts."""

import numpy as np
import pytest

from occontrol.api import read_schedule
from occontrol.core.claims import Claims
from occontrol.core.errors import ProblemError
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.core.solution import Status
from occontrol.families.robust.certify import claims_of, on_slots
from occontrol.families.robust.family import FAMILY
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.problem import Problem

NAMES = ("one", "two")


def oscillator(end=4.0, slots=4, idle=False):
    plant = UncertainPlant([[0, 1], [-1, -0.4]], [[0], [1]], [[0.2, 0.1]], np.diag([2.0, 1.0]), [1, -0.5], 1.0)
    sensors = [Sensor("one", [[1, 0]], [[1]]), Sensor("two", [[0, 1]], [[1]]), *([idle_sensor(2)] if idle else [])]
    return Problem("osc", plant, sensors, np.linspace(0, end, slots + 1))


def schedule(edges, *rows, names=NAMES):
    return Schedule(np.array(edges, dtype=float), np.array(rows, dtype=float), names)


WRONG = [
    (schedule([1, 3], [1, 0]), "nothing is scheduled between t = 0 and 1"),
    (schedule([0, 3], [1, 0]), "nothing is scheduled between t = 3 and 4"),
    (schedule([0, 2, 5], [1, 0], [0, 1]), "the segment ends at 5, the horizon at 4"),
    (schedule([-1, 2, 4], [1, 0], [0, 1]), "the segment starts at -1, the horizon at 0"),
    (schedule([0, 2, 4], [1, 0], [1, 1]), "2 sensors are named, but select is 1"),
    (schedule([0, 2, 4], [1, 0], [0, 0]), "0 sensors are named, but select is 1"),
    (schedule([0, 2, 4], [1, 0], [0.5, 0.2]), "the weights add up to 0.7, but select is 1"),
    (schedule([0, 2, 4], [1, 0], [2, 0]), "the weight of sensor 'one' is 2, it must lie between 0 and 1"),
    (schedule([0, 4], [1, 0], names=("one", "tow")), None),
    (schedule([0, 4], [0, 1], names=("one", "tow")), "there is no sensor 'tow'\n  hint: did you mean 'two'?"),
]


@pytest.mark.parametrize(("given", "words"), WRONG)
def test_a_schedule_that_does_not_fit_is_refused_by_library_and_file_reader_alike(given, words, tmp_path):
    problem = oscillator()
    if words is None:  # a misspelt sensor that is never used does no harm
        assert FAMILY.certify(problem, given).status is Status.FEASIBLE
        return
    with pytest.raises(ProblemError) as error:
        FAMILY.certify(problem, given)
    place, said = str(error.value).split(": ", 1)
    assert place.startswith("t = ") and said.startswith(words)
    lines = ["start,end,sensors,weights"]
    for k, v in enumerate(given.weights):
        used = [j for j in range(len(v)) if v[j] > 0]
        shares = "" if all(v[j] == 1 for j in used) else ";".join(str(v[j]) for j in used)
        lines.append(f"{given.edges[k]},{given.edges[k + 1]},{';'.join(given.names[j] for j in used)},{shares}")
    path = tmp_path / "s.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ProblemError) as read:
        read_schedule(path, problem)
    assert [line.split(": ", 1)[1] for line in str(read.value).split("\n")[:1]] == [words.split("\n")[0]]


def test_shares_are_no_schedule():
    with pytest.raises(ProblemError, match="exactly one sensor at a time"):
        FAMILY.certify(oscillator(), schedule([0, 4], [0.5, 0.5]))


def test_the_order_of_names_is_the_schedules_own_and_gaps_are_idle_where_that_exists():
    problem = oscillator(idle=True)
    _, sequence = on_slots(problem, schedule([0, 1, 2, 4], [1, 0], [0, 1], [0, 0], names=("two", "one")))
    assert [problem.sensors.names[j] for j in sequence] == ["two", "one", "idle", "idle"]


def test_a_switch_within_a_slot_cuts_it_and_rounding_does_not():
    problem = oscillator()
    cut, sequence = on_slots(problem, schedule([0, 0.5, 4], [1, 0], [0, 1]))
    assert cut.edges.tolist() == [0, 0.5, 1, 2, 3, 4] and sequence == [0, 1, 1, 1, 1]
    same, sequence = on_slots(problem, schedule([1e-10, 1 + 1e-10, 4 - 1e-10], [1, 0], [0, 1]))
    assert same is problem and sequence == [0, 1, 1, 1]


def test_claims_of_a_run_are_checked():
    problem = oscillator()
    found = FAMILY.solve(problem)
    stated = claims_of(found)
    assert stated.cost == found.cost and stated.parts == {"level": found.result["level"]}
    assert FAMILY.certify(problem, found.schedule, stated).status is Status.FEASIBLE
    false = FAMILY.certify(problem, found.schedule, Claims(cost=found.cost * 0.9, parts={"level": 9.0}))
    assert false.status is Status.DISAGREES
    assert "the stated cost is" in false.message and "the stated level is 9, recomputed" in false.message
