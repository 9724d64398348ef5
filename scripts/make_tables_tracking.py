"""Tables and problem file of tracking_network: a real orbit, real ground stations, and when they see each other.

Unknowns: deviation of the satellite from its reference orbit in the inertial frame TEME, position x, y, z [km] and
velocity [m/s]. The mixed units keep all numbers of the same size; dx/dt = 1e-3 v.

    A(t) = [[0, 1e-3 I], [1e3 dg/dr, 0]],   g(r) = gravity of the Earth with its oblateness J2
    C_j(t): rows range [km] and range rate [m/s], derivatives with respect to the state
    Xi(t) = drag (along the velocity) + everything else (all directions), intensities in (m/s)^2/s

The reference orbit is SGP4 of the two-line elements below; g is differentiated by CasADi. Stations turn with the Earth
(Greenwich mean sidereal time, IAU 1982), heights above the WGS 84 ellipsoid. A station may track while the satellite is
more than 10 degrees above its horizon; the windows are found to the second.

Run from the project's folder (needs sgp4):  python scripts/make_tables_tracking.py
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import casadi
import numpy as np
from sgp4.api import Satrec

# International Space Station, 2 January 2020; the elements stand in the sgp4 package's own tests
ELEMENTS = (
    "1 25544U 98067A   19366.82137887  .00016717  00000-0  10270-3 0  9129",
    "2 25544  51.6392  96.6358 0005156  88.7140 271.4601 15.49497216  6061",
)
MU, J2, RADIUS, FLATTENING = 398600.4418, 1.08262668e-3, 6378.137, 1 / 298.257223563  # km^3/s^2, -, km, -
EARTH_RATE = 7.2921158553e-5  # rad/s
MASK = 10.0  # degrees
START = 26100.0  # s from the epoch of the elements to t = 0: from here all stations get a pass within the six orbits
ORBITS = 6
ACROSS, DRAG = 1e-11, 4e-10  # m^2/s^3 before scaling: all directions, along the velocity
PLANT_STEP, PASS_STEP, INTERVAL, GAP = 20.0, 4.0, 10.0, 300.0  # s


class Station(NamedTuple):
    name: str
    latitude: float  # degrees north
    longitude: float  # degrees east
    height: float  # km
    cost: float


STATIONS = (
    Station("Wallops", 37.9249, -75.4765, 0.01, 1.0),
    Station("White Sands", 32.5007, -106.6086, 1.48, 1.0),
    Station("South Point", 19.0140, -155.6633, 0.37, 1.5),
    Station("Santiago", -33.1515, -70.6664, 0.73, 1.2),
    Station("Maspalomas", 27.7629, -15.6338, 0.21, 0.8),
    Station("Weilheim", 47.8801, 11.0853, 0.66, 0.8),
    Station("Hartebeesthoek", -25.8870, 27.7070, 1.54, 1.2),
    Station("Dongara", -29.0457, 115.3487, 0.25, 1.5),
)


def satellite() -> Satrec:
    return Satrec.twoline2rv(*ELEMENTS)


def orbit(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (K, 3) [km] and velocities (K, 3) [km/s] in TEME, times in seconds of the problem."""
    sat = satellite()
    days = (START + np.asarray(times, dtype=float)) / 86400
    error, position, velocity = sat.sgp4_array(np.full(len(days), sat.jdsatepoch), sat.jdsatepochF + days)
    if np.any(error):
        raise RuntimeError(f"SGP4 error {error[error > 0][0]}")
    return position, velocity


def sidereal_angle(times: np.ndarray) -> np.ndarray:
    """Greenwich mean sidereal time [rad] (IAU 1982), UT1 taken as UTC."""
    sat = satellite()
    days = (sat.jdsatepoch - 2451545.0) + sat.jdsatepochF + (START + np.asarray(times, dtype=float)) / 86400
    century = days / 36525
    seconds = 67310.54841 + (876600 * 3600 + 8640184.812866) * century + 0.093104 * century**2 - 6.2e-6 * century**3
    return np.deg2rad((seconds / 240) % 360)


def station_state(station: Station, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position [km], velocity [km/s] and upward direction of a station in TEME, each (K, 3)."""
    latitude = np.deg2rad(station.latitude)
    angle = sidereal_angle(times) + np.deg2rad(station.longitude)
    squared = FLATTENING * (2 - FLATTENING)
    normal = RADIUS / np.sqrt(1 - squared * np.sin(latitude) ** 2)
    flat = (normal + station.height) * np.cos(latitude)
    z = np.full_like(angle, (normal * (1 - squared) + station.height) * np.sin(latitude))
    position = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)
    velocity = EARTH_RATE * np.stack([-position[:, 1], position[:, 0], np.zeros_like(z)], axis=1)
    up = np.stack(
        [np.cos(latitude) * np.cos(angle), np.cos(latitude) * np.sin(angle), np.full_like(z, np.sin(latitude))], axis=1
    )
    return position, velocity, up


def elevation(station: Station, times: np.ndarray) -> np.ndarray:
    """Elevation of the satellite above the station's horizon, degrees."""
    place, _, up = station_state(station, times)
    sight = orbit(times)[0] - place
    return np.rad2deg(np.arcsin(np.sum(sight * up, axis=1) / np.linalg.norm(sight, axis=1)))


def period() -> float:
    """One orbit, in whole seconds."""
    return float(round(2 * np.pi / satellite().no_kozai * 60))


def windows(station: Station, end: float) -> list[tuple[float, float]]:
    """[start, end] in whole seconds: the first and the last second with an elevation above the mask."""
    times = np.arange(0.0, end + 1)
    above = np.concatenate([[False], elevation(station, times) > MASK, [False]])
    starts, ends = np.flatnonzero(~above[:-1] & above[1:]), np.flatnonzero(above[:-1] & ~above[1:]) - 1
    return [(float(times[a]), float(times[b])) for a, b in zip(starts, ends, strict=True) if b - a >= 60]


def gravity_gradient() -> casadi.Function:
    """dg/dr [1/s^2] of mu/r with its J2 term (Vallado, Fundamentals of Astrodynamics, 8.7)."""
    r = casadi.SX.sym("r", 3)
    radius = casadi.norm_2(r)
    potential = MU / radius * (1 - J2 * (RADIUS / radius) ** 2 * (1.5 * (r[2] / radius) ** 2 - 0.5))
    return casadi.Function("gradient", [r], [casadi.hessian(potential, r)[0]])


def plant_tables(end: float) -> dict[str, np.ndarray]:
    """t, A (K, 6, 6), noise (K, 6, 6), as far as the prediction reaches."""
    times = np.append(np.arange(0.0, end, PLANT_STEP), end)
    position, velocity = orbit(times)
    gradient = gravity_gradient()
    A = np.zeros((len(times), 6, 6))
    A[:, :3, 3:] = 1e-3 * np.eye(3)
    A[:, 3:, :3] = [1e3 * np.array(gradient(r)) for r in position]
    along = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    noise = np.zeros((len(times), 6, 6))
    noise[:, 3:, 3:] = ACROSS * np.eye(3) + DRAG * along[:, :, None] * along[:, None, :]
    return {"t": times, "A": A, "noise": noise}


def observation(station: Station, times: np.ndarray) -> np.ndarray:
    """C (K, 2, 6): range [km] and range rate [m/s] by position [km] and velocity [m/s]."""
    place, place_rate, _ = station_state(station, times)
    position, velocity = orbit(times)
    sight, sight_rate = position - place, velocity - place_rate
    distance = np.linalg.norm(sight, axis=1, keepdims=True)
    direction = sight / distance
    closing = np.sum(direction * sight_rate, axis=1, keepdims=True)
    C = np.zeros((len(times), 2, 6))
    C[:, 0, :3] = C[:, 1, 3:] = direction
    C[:, 1, :3] = 1e3 * (sight_rate - closing * direction) / distance
    return C


def pass_times(passes: list[tuple[float, float]], end: float) -> np.ndarray:
    """A station's table: every 4 s of its passes, and the ends of the horizon (between passes nobody asks)."""
    dense = [np.append(np.arange(a, b, PASS_STEP), b) for a, b in passes]
    return np.unique(np.concatenate([[0.0, end], *dense]))


def grid(all_windows: list[tuple[float, float]], end: float) -> np.ndarray:
    """Edges on every rise and set; steps of at most 10 s while any station sees the satellite, 5 min otherwise."""
    marks = np.unique([0.0, end, *[t for w in all_windows for t in w]])
    edges = [marks[0]]
    for a, b in pairwise(marks):
        seen = any(u <= a and b <= v for u, v in all_windows)
        edges += list(np.round(np.linspace(a, b, int(np.ceil((b - a) / (INTERVAL if seen else GAP))) + 1)[1:], 3))
    return np.array(edges)


def rounded(table: np.ndarray) -> np.ndarray:
    """Nine significant digits: far beyond what the model knows, and it compresses well."""
    scale = 10.0 ** (8 - np.floor(np.log10(np.maximum(np.abs(table), 1e-300))))
    return np.where(table == 0, 0.0, np.round(table * scale) / scale)


def make() -> tuple[dict[str, np.ndarray], dict[str, list[tuple[float, float]]], np.ndarray, float, float]:
    """Tables, windows by station, edges, end of the horizon, and the instant that is predicted."""
    end = ORBITS * period()
    predict_at = end + period()
    tables = {name: value if name == "t" else rounded(value) for name, value in plant_tables(predict_at).items()}
    passes = {station.name: windows(station, end) for station in STATIONS}
    for station in STATIONS:
        key = station.name.lower().replace(" ", "_")
        times = pass_times(passes[station.name], end)
        tables[f"t_{key}"], tables[f"C_{key}"] = times, rounded(observation(station, times))
    edges = grid([w for some in passes.values() for w in some], end)
    return tables, passes, edges, end, predict_at


def main() -> None:
    tables, passes, edges, end, predict_at = make()
    target = Path(__file__).resolve().parent.parent / "problems" / "tracking_network.npz"
    np.savez_compressed(target, **tables)  # type: ignore[arg-type]
    print(f"{target.name}: {target.stat().st_size / 1e3:.0f} kB; the following stands in tracking_network.yaml")
    print(f"horizon: end {end:g}, predict_at {predict_at:g}, {len(edges) - 1} intervals")
    for name, some in passes.items():
        print(f"{name}: windows: [{', '.join(f'[{a:g}, {b:g}]' for a, b in some)}]")
    print("edges: [" + ", ".join(f"{t:g}" if t == round(t) else f"{t:.3f}" for t in edges) + "]")


if __name__ == "__main__":
    main()
