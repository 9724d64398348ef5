"""Known answers: bearings of a target from three stations, and a satellite's orbit."""

import numpy as np
import pytest

from occontrol.api import certify, online, read_schedule, run_filter, solve
from occontrol.core.measurement import Measurement
from occontrol.families.athans.nonlinear.nominal import IntegratorOptions, make_nominal
from occontrol.families.athans.nonlinear.plant import FormulaPlant
from tests.families.athans.nonlinear.cases import BEARINGS, STATIONS, read

SEQUENCE = "west east west east north west east west".split()


@pytest.fixture
def bearings(tmp_path):
    return read(BEARINGS, tmp_path)


def test_the_optimum_of_the_bearings(bearings):
    solution = solve(bearings)
    assert solution.cost == pytest.approx(19.56003191260454, rel=1e-12)
    chosen = [entry["sensors"][0] for entry in solution.result["schedule"]]
    assert chosen == "west east east west east west east west".split()
    assert solution.result["relaxed_cost"] == pytest.approx(18.1794884, rel=2e-4)
    assert solution.result["lower_bound"] <= solution.cost
    assert solution.result["certificate_of"] == "linearised"
    assert "of the problem linearised along its nominal path" in solution.message


def test_no_other_schedule_of_the_bearings_is_cheaper(bearings):
    """Every schedule, by a covariance filter of its own along the straight path."""
    import itertools

    plant = np.array([15, 45, 2.2, -0.6])
    F = np.eye(4) + np.diag([1.0, 1.0], 2)
    Q = 0.02 * np.block([[np.eye(2) / 3, np.eye(2) / 2], [np.eye(2) / 2, np.eye(2)]])

    def row(name, k):
        x, y = plant[:2] + k * plant[2:] - STATIONS[name]
        return np.array([-y, x, 0, 0]) / (x * x + y * y)

    rows = {(name, k): row(name, k) for name in STATIONS for k in range(8)}
    costs = []
    for names in itertools.product(STATIONS, repeat=8):
        P, total = np.diag([4, 4, 0.0225, 0.0225]), 0.0
        for k, name in enumerate(names):
            b = P @ rows[name, k]
            P = P - np.outer(b, b) / (rows[name, k] @ b + 0.0004)
            total += P[0, 0] + P[1, 1]
            P = F @ P @ F.T + Q
        costs.append(total)
    best = np.sort(costs)[:2]
    assert best == pytest.approx([19.56003191260454, 19.56540471], rel=1e-9)


def measured(seen):
    start = np.array([15, 45, 2.2, -0.6]) + np.array([1, -1, 0.1, 0.05])
    found = []
    for k, name in enumerate(seen):
        x, y = start[:2] + k * start[2:] - STATIONS[name]
        found.append(Measurement(float(k), name, np.array([np.arctan2(y, x)])))
    return found


def test_the_extended_filter_on_exact_bearings(bearings, tmp_path):
    path = tmp_path / "plan.csv"
    path.write_text("start,end,sensors\n" + "".join(f"{k},{k},{name}\n" for k, name in enumerate(SEQUENCE)))
    solution = certify(bearings, read_schedule(path, bearings))
    estimate = run_filter(bearings, solution, measured(SEQUENCE))
    assert estimate.mean[-1] == pytest.approx([31.93299247, 39.98119211, 2.27580925, -0.61833666], abs=5e-9)
    assert np.trace(estimate.covariance[-1]) == pytest.approx(2.608196985, abs=1e-9)
    loop = online(bearings, solution)
    for one in measured(SEQUENCE):
        assert loop.next_sensors == (one.sensor,)
        step = loop.step({one.sensor: one.values})
    assert step.estimate == pytest.approx(estimate.mean[-1], abs=1e-13)
    assert not step.diverging and loop.finished


ORBIT = ["vx", "vy", "-398600.4418*x/hypot(x, y)**3", "-398600.4418*y/hypot(x, y)**3"]
ORBIT_END = [-1929.722095623, -9308.015466961, 6.473412682091, -0.019843892155]
ORBIT_TRANSITION = [
    [-26.6314746441, -1.22780237554, -2349.50946362, -32913.6621072],
    [-2.68056918836, 1.25454592138, 1445.08612981, -2843.37024902],
    [-0.00445650713501, 0.000664188968213, 0.633784897669, -5.28451563107],
    [-0.0163410127716, -0.000992136595729, -1.76643872425, -19.5514727866],
]


def orbit() -> FormulaPlant:
    a, e, mu = 9500.0, 0.2, 398600.4418
    nearest = a * (1 - e)
    speed = np.sqrt(mu * (2 / nearest - 1 / a))
    return FormulaPlant(
        noise=[[0.0] * 4] * 4, covariance=np.eye(4), mean=[nearest, 0, 0, speed], f=ORBIT, states=["x", "y", "vx", "vy"]
    )


def kepler() -> np.ndarray:
    """The state after 7200 s from Kepler's equation, in extended precision."""
    kind = np.longdouble
    mu, a, e = kind("398600.4418"), kind(9500), kind(1) / 5
    rate = np.sqrt(mu / a**3)
    E = M = rate * 7200
    for _ in range(50):
        E = E - (E - e * np.sin(E) - M) / (1 - e * np.cos(E))
    b, r = a * np.sqrt(1 - e * e), a * (1 - e * np.cos(E))
    place = [a * (np.cos(E) - e), b * np.sin(E)]
    return np.array([*place, -a * a * rate * np.sin(E) / r, a * b * rate * np.cos(E) / r], dtype=float)


SIZES = np.array([9506.0, 9506.0, 6.5, 6.5])


def test_an_orbit_and_its_transition_matrix_with_substeps_by_accuracy():
    """By Kepler's equation the last digits of ORBIT_END, from another integrator, are off by 1e-12 of the radius."""
    nominal = make_nominal(orbit(), 0.0, np.linspace(0, 7200, 61), IntegratorOptions(accuracy=1e-13))
    F = np.eye(4)
    for each in nominal.spans.transition:
        F = each @ F
    assert np.max(np.abs(nominal.spans.ends[-1] - kepler()) / SIZES) < 5e-13
    assert np.max(np.abs(nominal.spans.ends[-1] - ORBIT_END) / SIZES) < 2e-12
    assert pytest.approx(np.array(ORBIT_TRANSITION), rel=2e-11) == F
    assert nominal.change < 1e-13


def test_the_default_accuracy_is_what_it_says():
    nominal = make_nominal(orbit(), 0.0, np.linspace(0, 7200, 61), IntegratorOptions())
    assert nominal.substeps < 40 and nominal.change < 1e-10
    assert np.max(np.abs(nominal.spans.ends[-1] - kepler()) / SIZES) < 1e-10
    coarse = make_nominal(orbit(), 0.0, np.linspace(0, 7200, 61), IntegratorOptions(substeps=1))
    error = np.max(np.abs(coarse.spans.ends[-1] - kepler()) / SIZES)
    assert error / 3 < coarse.change < 3 * error
