"""The tables of the shipped problems: they are what their scripts make, and what the scripts make is true."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.integrate import solve_ivp

ROOT = Path(__file__).resolve().parent.parent


def script(name: str):
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def document(name: str) -> dict:
    return YAML(typ="safe").load((ROOT / "problems" / f"{name}.yaml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def tracking():
    pytest.importorskip("sgp4")
    return script("make_tables_tracking")


@pytest.fixture(scope="module")
def made(tracking):
    return tracking.make()


@pytest.mark.parametrize("name", ["reentry_waveforms", "large_structure"])
def test_committed_tables_are_those_of_the_script(name):
    module = script({"reentry_waveforms": "make_tables_reentry", "large_structure": "make_tables_structure"}[name])
    fresh = module.tables()
    with np.load(ROOT / "problems" / f"{name}.npz") as committed:
        assert set(committed.files) <= set(fresh) and len(committed.files) > 4
        for key in committed.files:
            np.testing.assert_allclose(committed[key], fresh[key], rtol=1e-7, atol=1e-9 * np.max(np.abs(fresh[key])))


def test_tracking_tables_windows_and_grid_are_those_of_the_script(made):
    tables, passes, edges, end, predict_at = made
    with np.load(ROOT / "problems" / "tracking_network.npz") as committed:
        assert set(committed.files) == set(tables)
        for key in committed.files:
            np.testing.assert_allclose(committed[key], tables[key], rtol=1e-7, atol=1e-12)
    file = document("tracking_network")
    assert file["horizon"]["end"] == end and file["horizon"]["predict_at"] == predict_at
    np.testing.assert_allclose(file["horizon"]["edges"], edges, atol=1e-9)
    for sensor in file["sensors"][:-1]:
        assert [tuple(w) for w in sensor["windows"]] == passes[sensor["name"]]
    assert sum(len(p) for p in passes.values()) > 15 and all(passes.values())


def test_windows_lie_where_an_independent_geometry_sees_the_satellite(tracking, made):
    """Earth-fixed geometry with the sgp4 package's own sidereal time, second by second around rise and set."""
    from sgp4.api import Satrec
    from sgp4.propagation import gstime

    sat = Satrec.twoline2rv(*tracking.ELEMENTS)

    def elevation(station, t):
        _, position, _ = sat.sgp4(sat.jdsatepoch, sat.jdsatepochF + (tracking.START + t) / 86400)
        angle = gstime(sat.jdsatepoch + sat.jdsatepochF + (tracking.START + t) / 86400)
        c, s = np.cos(angle), np.sin(angle)
        fixed = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ position
        phi, lam = np.deg2rad([station.latitude, station.longitude])
        # radius of curvature from the ellipsoid's semi-axes a, b
        a, b = 6378.137, 6356.752314245
        n = a**2 / np.hypot(a * np.cos(phi), b * np.sin(phi))
        x = (n + station.height) * np.cos(phi)
        place = np.array([x * np.cos(lam), x * np.sin(lam), (b**2 / a**2 * n + station.height) * np.sin(phi)])
        east = np.array([-np.sin(lam), np.cos(lam), 0])
        up = np.array([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)])
        north = np.cross(up, east)
        e, nn, u = np.array([east, north, up]) @ (fixed - place)
        return np.rad2deg(np.arctan2(u, np.hypot(e, nn)))

    passes = made[1]
    for station in tracking.STATIONS:
        for start, end in passes[station.name]:
            assert elevation(station, start - 2) < 10 < elevation(station, start + 2)
            assert elevation(station, end + 2) < 10 < elevation(station, end - 2)
            assert elevation(station, (start + end) / 2) > 10


def test_variational_equations_follow_a_disturbed_orbit(tracking, made):
    """Phi over one orbit from the table, against two integrations of the nonlinear motion with J2 written out."""
    tables = made[0]

    def motion(_, s):
        x, y, z = s[:3]
        r = np.sqrt(x * x + y * y + z * z)
        k = 1.5 * 1.08262668e-3 * (6378.137 / r) ** 2
        g = (
            -398600.4418
            / r**3
            * np.array(
                [
                    x * (1 + k * (1 - 5 * z * z / r**2)),
                    y * (1 + k * (1 - 5 * z * z / r**2)),
                    z * (1 + k * (3 - 5 * z * z / r**2)),
                ]
            )
        )
        return np.concatenate([s[3:], g])

    span = tracking.period()
    position, velocity = tracking.orbit(np.array([0.0]))
    start = np.concatenate([position[0], velocity[0]])
    offset = np.array([0.03, -0.02, 0.04, 5e-5, 3e-5, -4e-5])  # km, km/s
    run = [solve_ivp(motion, (0, span), start + sign * offset, rtol=1e-11, atol=1e-12).y[:, -1] for sign in (1, -1)]
    wanted = (run[0] - run[1]) / 2 * np.array([1, 1, 1, 1e3, 1e3, 1e3])

    def deviation(t, x):
        k = min(np.searchsorted(tables["t"], t, side="right") - 1, len(tables["t"]) - 2)
        share = (t - tables["t"][k]) / (tables["t"][k + 1] - tables["t"][k])
        return ((1 - share) * tables["A"][k] + share * tables["A"][k + 1]) @ x

    got = solve_ivp(
        deviation, (0, span), offset * np.array([1, 1, 1, 1e3, 1e3, 1e3]), rtol=1e-9, atol=1e-12, max_step=20
    ).y[:, -1]
    assert np.linalg.norm(got - wanted) < 5e-3 * np.linalg.norm(wanted)


def test_station_rows_are_derivatives_of_range_and_range_rate(tracking, made):
    tables, passes = made[0], made[1]
    station = tracking.STATIONS[5]
    t = sum(passes[station.name][0]) / 2
    k = int(np.argmin(np.abs(tables["t_weilheim"] - t)))
    t = tables["t_weilheim"][k]
    place, place_rate, _ = tracking.station_state(station, np.array([t]))
    position, velocity = tracking.orbit(np.array([t]))

    def measure(x):  # x: km and m/s
        sight = position[0] + x[:3] - place[0]
        rate = velocity[0] + x[3:] * 1e-3 - place_rate[0]
        return np.array([np.linalg.norm(sight), 1e3 * rate @ sight / np.linalg.norm(sight)])

    slopes = np.stack([(measure(e * 1e-3) - measure(-e * 1e-3)) / 2e-3 for e in np.eye(6)], axis=1)
    np.testing.assert_allclose(tables["C_weilheim"][k], slopes, rtol=1e-5, atol=1e-6)


def test_reentry_jacobians_predict_the_impact_of_a_disturbed_body():
    module = script("make_tables_reentry")
    times, _, impact = module.reference()
    made, end = module.tables(), float(times[-1])

    def ground(state):
        path = solve_ivp(lambda _, s: module.rate(s), (0, end), state, rtol=1e-11, atol=1e-13)
        return path.y[:, -1]

    def linear(x):
        def rate(t, y):
            k = min(int(t / 0.05), len(times) - 2)
            share = (t - times[k]) / (times[k + 1] - times[k])
            return ((1 - share) * made["A"][k] + share * made["A"][k + 1]) @ y

        return solve_ivp(rate, (0, end), x, rtol=1e-9, atol=1e-13, max_step=0.1).y[:, -1]

    offset = np.array([0.01, -0.01, 1e-4, 1e-4, 1e-3])
    wanted = (ground(module.START + offset) - ground(module.START - offset)) / 2
    np.testing.assert_allclose(linear(offset), wanted, rtol=2e-3, atol=2e-6)

    # and D turns that into the shift of the point where the body meets the ground
    def meets(state):
        def hit(_, s):
            return s[1]

        hit.terminal = True
        path = solve_ivp(lambda _, s: module.rate(s), (0, 60), state, rtol=1e-11, atol=1e-13, events=hit)
        return path.y_events[0][0][0]

    shift = (meets(module.START + offset) - meets(module.START - offset)) / 2
    assert made["D"][0] @ linear(offset) == pytest.approx(shift, rel=5e-3)
    assert document("reentry_waveforms")["horizon"]["predict_at"] <= impact
    np.testing.assert_allclose(document("reentry_waveforms")["objective"]["output"][0], made["D"][0], atol=1e-5)


def test_structure_without_payload_and_damper_vibrates_at_the_textbook_frequencies(monkeypatch):
    module = script("make_tables_structure")
    coupled = module.tables()["A"][0]
    monkeypatch.setattr(module, "PAYLOAD", 0.0)
    monkeypatch.setattr(module, "DAMPER", 0.0)
    bare = module.tables()["A"][0]
    k = np.arange(1, module.MODES + 1) * np.pi / module.LENGTH
    wanted = np.sqrt((module.STIFFNESS * k**4 + module.TENSION * k**2) / module.LINE_MASS)
    np.testing.assert_allclose(np.sort(np.abs(np.linalg.eigvals(bare)))[::2], wanted, rtol=1e-9)
    below = coupled[module.MODES :, : module.MODES]
    assert np.max(np.abs(below - np.diag(np.diag(below)))) > 0.1  # payload and damper do couple the modes
    assert np.max(np.linalg.eigvals(coupled).real) < 0


def test_attitude_coefficients_follow_from_the_inertias_in_the_comment():
    A = np.array(document("attitude_telemetry")["plant"]["A"], dtype=float)
    rate, x, y, z, h = 2 * np.pi / 95, 90.0, 100.0, 60.0, 0.25 * 60
    g = h - rate * (x - y + z)
    wanted = np.zeros((3, 6))
    wanted[0, [0, 4]] = -(4 * rate**2 * (y - z) + rate * h) / x, -g / x
    wanted[1, [1, 3]] = -(rate**2 * (y - x) + rate * h) / z, g / z
    wanted[2, 2] = -3 * rate**2 * (x - z) / y
    np.testing.assert_allclose(A[3:], wanted, atol=1e-7)


@pytest.mark.parametrize("name", ["radar_fifty", "catalogue_1000"])
def test_tables_of_many_targets_are_those_of_the_script(name):
    if name == "catalogue_1000":
        pytest.importorskip("sgp4")
    module = script("make_tables_targets")
    fresh = module.aircraft() if name == "radar_fifty" else module.catalogue()
    for table, file in zip(fresh, (name, f"{name}_passes"), strict=True):
        with np.load(ROOT / "problems" / f"{file}.npz") as committed:
            assert set(committed.files) == set(table)
            for key in committed.files:
                if committed[key].dtype.kind == "U":
                    assert np.array_equal(committed[key], table[key])
                else:
                    np.testing.assert_allclose(committed[key], table[key], rtol=1e-5, atol=1e-6)


def test_lines_of_sight_stand_across_and_passes_lie_inside():
    with np.load(ROOT / "problems" / "catalogue_1000_passes.npz") as passes:
        one, two = (np.column_stack([passes[f"{x}{i}"] for i in (1, 2, 3)]) for x in "ab")
        np.testing.assert_allclose(np.sum(one * two, axis=1), 0, atol=1e-6)
        np.testing.assert_allclose([np.sum(one**2, axis=1), np.sum(two**2, axis=1)], 1, atol=1e-6)
        assert np.all(passes["start"] < passes["end"]) and passes["end"].max() <= 360
        # two arc seconds at 300 km and at 42,000 km
        assert 0.003 < passes["sd"].min() and passes["sd"].max() < 0.42
