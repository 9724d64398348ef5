"""The tables of tracking_network from formulas: gravity with J2, range and range rate, along the tabulated orbit."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc

ROOT = Path(__file__).resolve().parents[4]
END = 600.0  # s of the first pass


@pytest.fixture(scope="module")
def script():
    """scripts/make_tables_tracking.py."""
    pytest.importorskip("sgp4")
    path = ROOT / "scripts" / "make_tables_tracking.py"
    spec = importlib.util.spec_from_file_location("make_tables_tracking", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def problem_of(script, folder: Path) -> oc.ReadingsProblem:
    """The orbit by formulas of position [km] and velocity [m/s], linearised along SGP4's path; one station."""
    times = np.arange(0.0, END + 1, 4.0)
    position, velocity = script.orbit(times)
    station = script.STATIONS[3]  # Santiago sees the first pass
    lat = np.deg2rad(station.latitude)
    squared = script.FLATTENING * (2 - script.FLATTENING)
    normal = script.RADIUS / np.sqrt(1 - squared * np.sin(lat) ** 2)
    flat, up = (normal + station.height) * np.cos(lat), (normal * (1 - squared) + station.height) * np.sin(lat)
    # Greenwich's angle is a straight line over ten minutes, to 1e-13 rad
    angles = np.unwrap(script.sidereal_angle(np.array([0.0, END]))) + np.deg2rad(station.longitude)
    turn = f"({float(angles[0])!r}+{float((angles[1] - angles[0]) / END)!r}*t)"
    rate = script.EARTH_RATE
    r2, mu, k = "(x**2+y**2+z**2)", script.MU, 1.5 * script.J2 * script.RADIUS**2
    pull = [f"-1000*{mu}*{c}/{r2}**1.5*(1+{k}/{r2}*({s}-5*z**2/{r2}))" for c, s in (("x", 1), ("y", 1), ("z", 3))]
    dx, dy, dz = f"(x-{flat}*cos{turn})", f"(y-{flat}*sin{turn})", f"(z-{up})"
    far = f"sqrt({dx}**2+{dy}**2+{dz}**2)"
    closing = f"({dx}*(u+1000*{rate}*{flat}*sin{turn})+{dy}*(v-1000*{rate}*{flat}*cos{turn})+{dz}*w)/{far}"
    speed2 = "(u**2+v**2+w**2)"
    along = [[f"{script.DRAG}*{a}*{b}/{speed2}" + f"+{script.ACROSS}" * (a == b) for b in "uvw"] for a in "uvw"]
    noise = [[0] * 6] * 3 + [[0, 0, 0, *row] for row in along]
    states = np.hstack([position, 1e3 * velocity])
    document = {
        "family": "athans",
        "horizon": {"start": 0, "end": END, "samples": 10},
        "sensing": "samples",
        "plant": {
            "states": list("xyzuvw"),
            "f": ["u/1000", "v/1000", "w/1000", *pull],
            "noise": noise,
            "initial": {"mean": states[0].tolist(), "covariance": {"diag": [1, 1, 1, 1, 1, 1]}},
            "nominal": {"times": times.tolist(), "values": states[:, :, None].tolist(), "interpolation": "linear"},
        },
        "sensors": [{"name": "station", "h": [far, closing], "noise": {"diag": [0.01, 0.04]}}],
        "objective": {"output": [[1, 0, 0, 0, 0, 0]]},
    }
    path = folder / "orbit.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return oc.read_problem(path)


def test_formulas_give_the_tables_of_the_script(script, tmp_path: Path) -> None:
    problem = problem_of(script, tmp_path)
    tables, times = script.plant_tables(END), np.arange(0.0, END + 1, script.PLANT_STEP)
    A, noise = problem.plant.A.sample(times), problem.plant.noise.sample(times)
    np.testing.assert_allclose(A, tables["A"], rtol=1e-11, atol=1e-15)
    np.testing.assert_allclose(noise, tables["noise"], rtol=0, atol=1e-12 * np.max(tables["noise"]))
    C = script.observation(script.STATIONS[3], times)
    found = problem.sensors[0].C.sample(times)
    for row in range(2):
        np.testing.assert_allclose(found[:, row], C[:, row], rtol=0, atol=1e-8 * np.max(np.abs(C[:, row])))


def test_the_maps_between_readings_are_those_of_the_tables(script, tmp_path: Path) -> None:
    """A between the nodes of the table is a straight line, along the path it is what it is: 20 s apart, 1e-5 differ."""
    problem = problem_of(script, tmp_path)
    from scipy.integrate import solve_ivp

    table = np.load(ROOT / "problems" / "tracking_network.npz")

    def right(t: float, flat: np.ndarray) -> np.ndarray:
        i = min(np.searchsorted(table["t"], t, side="right") - 1, len(table["t"]) - 2)
        share = (t - table["t"][i]) / (table["t"][i + 1] - table["t"][i])
        return (((1 - share) * table["A"][i] + share * table["A"][i + 1]) @ flat.reshape(6, 6)).ravel()

    since = problem.clock.times
    for k in (0, 5):
        exact = solve_ivp(right, (since[k], since[k + 1]), np.eye(6).ravel(), rtol=1e-11, atol=1e-13).y[:, -1]
        np.testing.assert_allclose(problem.gaps.transition[k + 1], exact.reshape(6, 6), rtol=0, atol=2e-5)
