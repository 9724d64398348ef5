"""Bridges to other tools: equal bits there and back, what is refused, and that the import of the package loads none."""

from __future__ import annotations

import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import control
import numpy as np
import pytest
import scipy.signal
import xarray
from scipy.linalg import expm

import occontrol as oc
from occontrol.cli import run
from occontrol.core.errors import ProblemError, UsageError

RANDOM = np.random.default_rng(11)
A, B, C, Q = RANDOM.normal(size=(3, 3)), RANDOM.normal(size=(3, 1)), RANDOM.normal(size=(2, 3)), np.array([[0.3]])
D = np.zeros((2, 1))


@pytest.fixture(scope="module")
def solution() -> oc.Solution:
    return oc.solve(oc.read_problem(Path(__file__).parents[1] / "problems" / "scalar_on_off.yaml"))


def test_the_package_itself_loads_no_bridge() -> None:
    heavy = "pandas xarray h5netcdf h5py stonesoup control"
    code = f"import sys, occontrol; print([n for n in '{heavy}'.split() if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize(
    "system",
    [control.ss(A, B, C, D), scipy.signal.StateSpace(A, B, C, D), (A, B, C, D), control.ss(A, B, C, D, dt=0)],
    ids=["control", "scipy", "tuple", "control dt=0"],
)
def test_a_state_space_comes_in_and_goes_out_with_every_bit(system: object) -> None:
    plant, rows = oc.plant_from(system, Q, through=B)
    assert np.array_equal(plant.A.at(0), A) and np.array_equal(rows, C)
    assert np.array_equal(plant.noise.at(0), B @ Q @ B.T)
    for make in (control.ss, scipy.signal.StateSpace):
        again = make(*oc.matrices_of(plant, rows))
        assert np.array_equal(again.A, A) and np.array_equal(again.C, C) and not np.any(again.D)


@pytest.mark.parametrize(
    ("system", "noise", "what"),
    [
        (control.ss(A, B, C, D, dt=0.1), Q, "the system is in discrete time, dt = 0.1"),
        (control.ss(A, B, C, D, dt=True), Q, "the system is in discrete time, dt = True"),
        (scipy.signal.StateSpace(A, B, C, D, dt=0.5), Q, "the system is in discrete time, dt = 0.5"),
        (control.ss(A, B, C, D + 1), Q, "D of the system is not zero"),
        ((A, B, C), Q, r"the tuple has 3 entries"),
        (SimpleNamespace(A=A, C=C), Q, "SimpleNamespace has no B, D"),
        (control.ss(A, B, C, D), np.eye(2), "through is 3x1, it must be 3x2"),
    ],
)
def test_what_is_no_such_system_is_refused(system: object, noise: np.ndarray, what: str) -> None:
    with pytest.raises(ProblemError, match=what):
        oc.plant_from(system, noise, through=B)


def test_frames_hold_what_the_objects_hold(solution: oc.Solution) -> None:
    frame = oc.to_frame(solution.schedule)
    assert frame.to_dict("records") == solution.schedule.segments()  # type: ignore[union-attr]
    problem = solution.problem
    estimate = oc.run_filter(problem, solution, oc.simulate(problem, solution, 3)[0])
    table = oc.to_frame(estimate, problem)
    assert list(table)[:3] == ["t", "x1", "sd_x1"]
    assert np.array_equal(table["x1"], estimate.mean[:, 0]) and np.array_equal(
        table["nis"], estimate.nis, equal_nan=True
    )
    with pytest.raises(UsageError, match="int is neither a schedule nor an estimate"):
        oc.to_frame(3)


def test_netcdf_reads_back_identically(solution: oc.Solution, tmp_path: Path) -> None:
    data = oc.to_xarray(solution)
    for name, value in solution.arrays.items():
        assert np.array_equal(data[name].to_numpy(), value, equal_nan=True)
    assert list(data["sensor"].to_numpy()) == list(solution.problem.sensors.names)
    assert data["covariance"].dims == ("node", "state", "state_2") and data["weights"].dims == ("interval", "sensor")
    assert data.attrs["lower_bound"] == solution.certificate.lower_bound  # type: ignore[union-attr]
    data.to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
    assert xarray.load_dataset(tmp_path / "x.nc", engine="h5netcdf").identical(data)
    oc.write_run(tmp_path / "run", solution.problem, solution)
    assert run(["export", str(tmp_path / "run"), "--to", "nc"]) == 0
    written = xarray.load_dataset(tmp_path / "run" / "export.nc", engine="h5netcdf")
    assert all(np.array_equal(written[name], value, equal_nan=True) for name, value in solution.arrays.items())


@pytest.mark.parametrize(("library", "call"), [("pandas", "to_frame"), ("xarray", "to_xarray")])
def test_a_library_that_is_missing_is_named(
    library: str, call: str, solution: oc.Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    given = solution.schedule if call == "to_frame" else solution
    with pytest.raises(UsageError, match=f"{library} is not installed\n  hint: pip install 'occontrol\\[{library}\\]'"):
        getattr(oc, call)(given)


def test_notebooks_and_consoles_see_a_line_and_a_table(solution: oc.Solution) -> None:
    assert repr(solution).startswith("<athans certified cost 1.2123 bound 1.2122 gap ") and "\n" not in repr(solution)
    html = solution._repr_html_()
    assert html.startswith("<table>") and "1.2122746" in html and "<script" not in html


def test_stone_soup_flies_the_plan_and_takes_the_models() -> None:
    from occontrol.adapters.stonesoup import ScheduledSensorManager, models

    plan = oc.Schedule(np.array([0.0, 1.0, 2.5, 4.0]), np.array([[1, 0], [0, 1], [1, 0]]), ("a", "b"))
    start = datetime(2026, 1, 1, 12)

    class Fake:
        def actions(self, timestamp: datetime) -> list:
            return [SimpleNamespace(default_action=("look", timestamp))]

    one, two = Fake(), Fake()
    manager = ScheduledSensorManager(
        sensors={one, two}, schedule=plan, start=start, names={one: "a", two: "b"}, unit="min"
    )
    for t, names in ((0.0, ["a"]), (0.99, ["a"]), (1.0, ["b"]), (2.0, ["b"]), (3.0, ["a"]), (4.0, ["a"]), (4.5, [])):
        at = start + timedelta(minutes=t)
        assert manager.in_use(at) == names and manager.in_use(at.replace(tzinfo=UTC)) == names
        chosen = manager.choose_actions(at)[0]
        assert set(chosen) == {one if name == "a" else two for name in names}
        assert all(actions == [("look", at)] for actions in chosen.values())
    plant = oc.LinearPlant([[0, 1], [0, -0.4]], [[0, 0], [0, 0.5]], [[1, 0], [0, 1]])
    transition, measurement = models(plant, oc.Sensor("a", [[0, 1]], [[0.2]]), 0.1)
    assert transition.matrix() == pytest.approx(expm(0.1 * plant.A.at(0)), rel=1e-13)  # type: ignore[attr-defined]
    assert np.array_equal(measurement.matrix(), [[0, 1]])  # type: ignore[attr-defined]
    assert measurement.covar()[0, 0] == pytest.approx(2.0)  # type: ignore[attr-defined]
    with pytest.raises(UsageError, match="do not vary with time"):
        models(oc.LinearPlant([["t"]], [[1]], [[1]]), oc.Sensor("a", [[1]], [[1]]), 0.1)
