"""Tables of the problems with many targets: radar_fifty (aircraft and two radars), catalogue_1000 (objects in orbit).

radar_fifty: fifty aircraft fly straight through a square of 400 km; a radar sees them within 180 km. What it measures
along the line of sight is sharper than what it measures across, so every minute of a pass has its own directions.

catalogue_1000: seeded orbital elements of 1,000 objects on nearly circular orbits, written as two-line elements and
propagated by SGP4; six telescopes. A telescope sees an object above 30 degrees, while the sun is 12 degrees below its
horizon and the object stands in sunlight. A pass is cut into pieces that are short enough for one line of sight each.
The state of an object is its deviation from its own orbit in the frame radial, along, across (Clohessy-Wiltshire); a
telescope measures the two directions across the line of sight.

Run from the project's folder (the catalogue needs sgp4):  python scripts/make_tables_targets.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

PROBLEMS = Path(__file__).resolve().parent.parent / "problems"
Table = dict[str, np.ndarray]

# ---- fifty aircraft: kilometres and minutes

SQUARE, REACH, MINUTES, PIECE = 400.0, 180.0, 20.0, 1.0
RADARS = {"north": (190.0, 290.0), "south": (230.0, 110.0)}
ALONG, ACROSS = 0.05, 0.003  # km of one look; rad


def aircraft(count: int = 50, tried: int = 60, seed: int = 7) -> tuple[Table, Table]:
    """Columns of the aircraft, and of the pieces of their passes."""
    g = np.random.default_rng(seed)
    start = g.uniform(0.1 * SQUARE, 0.9 * SQUARE, (tried, 2))
    heading, speed = g.uniform(0, 2 * np.pi, tried), g.uniform(8, 15, tried)
    velocity = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    names = np.array([f"flight_{i + 1:02d}" for i in range(tried)])
    targets = {
        "name": names,
        "x": start[:, 0], "y": start[:, 1], "u": velocity[:, 0], "v": velocity[:, 1],
        "q": 10 ** g.uniform(-2, 0, tried), "p": g.uniform(0.5, 4.0, tried),
        "weight": 10 ** g.uniform(-0.5, 0.5, tried),
    }  # fmt: skip
    rows = []
    for i in range(tried):
        for name, site in RADARS.items():
            for t in np.arange(0.0, MINUTES, PIECE):
                away = start[i] + velocity[i] * (t + PIECE / 2) - np.array(site)
                distance = float(np.hypot(*away))
                if 5.0 < distance <= REACH:
                    rows.append((names[i], name, t, t + PIECE, away[0] / distance, away[1] / distance, distance))
    passes = columns(rows, ("target", "resource", "start", "end", "c", "s", "distance"))
    return first_seen(targets, passes, count)


# ---- a catalogue: kilometres and minutes

EPOCH = (2026, 1, 15, 20, 0, 0)
HOURS, MASK, DARK = 6.0, 30.0, -12.0
RADIUS, FLATTENING, AU, MU = 6378.137, 1 / 298.257223563, 149_597_870.7, 398600.4418
SITES = {  # degrees north and east, kilometres of height
    "la_palma": (28.76, -17.88, 2.3), "calar_alto": (37.22, -2.55, 2.2), "zimmerwald": (46.88, 7.47, 0.95),
    "asiago": (45.87, 11.53, 1.4), "sutherland": (-32.38, 20.81, 1.8), "mount_abu": (24.65, 72.78, 1.7),
}  # fmt: skip
SHELLS = ((900, 500.0, 2000.0, 2), (350, 10_000.0, 22_000.0, 10), (500, 35_700.0, 35_900.0, 30))  # tried, km, min
OBJECTS = 1000
ARC_SECONDS = 2.0


def catalogue(seed: int = 11) -> tuple[Table, Table]:
    """Columns of the objects, and of the pieces of their passes."""
    from sgp4.api import WGS84, Satrec, SatrecArray, jday
    from sgp4.exporter import export_tle

    g = np.random.default_rng(seed)
    day, part = jday(*EPOCH)
    satellites, names, piece, rate, q, p = [], [], [], [], [], []
    for count, low, high, minutes in SHELLS:
        for _ in range(count):
            axis = RADIUS + g.uniform(low, high)
            motion = np.sqrt(MU / axis**3) * 60  # rad/min
            tilt = np.arccos(g.uniform(-0.2, 0.9)) if low < 30_000 else abs(g.normal(0, 0.05))
            made = Satrec()
            made.sgp4init(
                WGS84, "i", len(names) + 10_000, day + part - 2433281.5, 1e-5, 0.0, 0.0, g.uniform(0, 0.005),
                g.uniform(0, 2 * np.pi), tilt, g.uniform(0, 2 * np.pi), motion, g.uniform(0, 2 * np.pi),
            )  # fmt: skip
            satellites.append(Satrec.twoline2rv(*export_tle(made)))
            names.append(f"object_{len(names) + 1:04d}")
            piece.append(minutes)
            rate.append(motion)
            q.append((1e-8 if low < 2000 else 1e-10) * 10 ** g.uniform(-0.5, 0.5))
            p.append(g.uniform(0.3, 3.0))
    N = round(HOURS * 60)
    middle = (np.arange(N) + 0.5) / 1440.0
    _, position, velocity = SatrecArray(satellites).sgp4(np.full(N, day), part + middle)
    sun = sun_direction(day + part + middle)
    lit = sunlit(position, sun)
    rows: list[tuple] = []
    for name, site in SITES.items():
        at, up = station(site, day + part + middle)
        night = np.einsum("ki,ki->k", up, sun) < np.sin(np.radians(DARK))
        away = position - at
        distance = np.linalg.norm(away, axis=2)
        high = np.einsum("ski,ki->sk", away, up) / distance > np.sin(np.radians(MASK))
        for i, k, end in pieces(high & lit & night, piece):
            m = (k + end) // 2
            sight = away[i, m] / distance[i, m]
            one, two = across(sight, position[i, m], velocity[i, m])
            rows.append((names[i], name, k, end, *one, *two, distance[i, m] * np.radians(ARC_SECONDS / 3600)))
    objects = {
        "name": np.array(names), "w": np.array(rate), "q": np.array(q), "p": np.array(p),
        "weight": 10 ** g.uniform(-0.5, 0.5, len(names)),
    }  # fmt: skip
    heads = ("target", "resource", "start", "end", "a1", "a2", "a3", "b1", "b2", "b3", "sd")
    order = g.permutation(len(names))
    objects = {name: column[order] for name, column in objects.items()}
    return first_seen(objects, columns(sorted(rows), heads), OBJECTS)


def first_seen(targets: Table, passes: Table, count: int) -> tuple[Table, Table]:
    """The first `count` targets that are seen at all, and their passes."""
    seen = np.isin(targets["name"], passes["target"])
    kept = np.flatnonzero(seen)[:count]
    targets = {name: column[kept] for name, column in targets.items()}
    mine = np.isin(passes["target"], targets["name"])
    return targets, {name: column[mine] for name, column in passes.items()}


def sun_direction(julian: np.ndarray) -> np.ndarray:
    """(K, 3) unit vectors to the sun, to a hundredth of a degree (Astronomical Almanac, page C5)."""
    n = julian - 2451545.0
    anomaly = np.radians(357.528 + 0.9856003 * n)
    longitude = np.radians(280.46 + 0.9856474 * n + 1.915 * np.sin(anomaly) + 0.02 * np.sin(2 * anomaly))
    tilt = np.radians(23.439 - 4e-7 * n)
    return np.column_stack([np.cos(longitude), np.cos(tilt) * np.sin(longitude), np.sin(tilt) * np.sin(longitude)])


def sunlit(position: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """(S, K) whether positions (S, K, 3) lie outside the Earth's shadow, taken for a cylinder."""
    along = np.einsum("ski,ki->sk", position, sun)
    beside = np.linalg.norm(position - along[:, :, None] * sun, axis=2)
    return (along > 0) | (beside > RADIUS)


def station(site: tuple[float, float, float], julian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(K, 3) place and vertical of a site in TEME; Greenwich mean sidereal time of 1982."""
    latitude, longitude, height = np.radians(site[0]), np.radians(site[1]), site[2]
    centuries = (julian - 2451545.0) / 36525
    seconds = 67310.54841 + (876600 * 3600 + 8640184.812866) * centuries + 0.093104 * centuries**2
    angle = np.radians(seconds / 240) + longitude
    square = FLATTENING * (2 - FLATTENING)
    normal = RADIUS / np.sqrt(1 - square * np.sin(latitude) ** 2)
    flat, high = (normal + height) * np.cos(latitude), (normal * (1 - square) + height) * np.sin(latitude)
    place = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), np.full(len(angle), high)])
    up = np.column_stack(
        [np.cos(latitude) * np.cos(angle), np.cos(latitude) * np.sin(angle), np.full(len(angle), np.sin(latitude))]
    )
    return place, up


def across(sight: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two directions across a line of sight (3,), in radial, along and across components of an orbit."""
    radial = position / np.linalg.norm(position)
    normal = np.cross(position, velocity)
    normal /= np.linalg.norm(normal)
    frame = np.array([radial, np.cross(normal, radial), normal])
    one = np.cross(sight, [0.0, 0.0, 1.0])
    one /= np.linalg.norm(one)
    return frame @ one, frame @ np.cross(sight, one)


def pieces(seen: np.ndarray, longest: list[int]):
    """(object, first, end) of every stretch of minutes in `seen` (S, K), cut to what is allowed for each object."""
    for i, row in enumerate(seen):
        change = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(int), [0]])))
        for begin, end in zip(change[::2], change[1::2], strict=True):
            for k in range(int(begin), int(end), longest[i]):
                yield i, k, min(k + longest[i], int(end))


def columns(rows: list[tuple], names: tuple[str, ...]) -> Table:
    """Rows as columns by name: words as they are, numbers to seven digits."""
    found = {}
    for name, column in zip(names, zip(*rows, strict=True), strict=True):
        words = isinstance(column[0], str | np.str_)
        found[name] = np.array(column) if words else np.array(column, dtype=np.float32)
    return found


def main() -> None:
    """Write the tables beside the problem files."""
    for name, (targets, passes) in {"radar_fifty": aircraft(), "catalogue_1000": catalogue()}.items():
        np.savez_compressed(PROBLEMS / f"{name}.npz", **targets)
        np.savez_compressed(PROBLEMS / f"{name}_passes.npz", **passes)
        print(f"{name}: {len(targets['name'])} targets, {len(passes['target'])} pieces of passes")


if __name__ == "__main__":
    main()
