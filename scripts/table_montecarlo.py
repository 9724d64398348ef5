"""The tables of docs/montecarlo.md: three nonlinear problems times three priors, every policy, 400 runs each.

    python scripts/table_montecarlo.py [--runs 400] [--jobs 2] [--only bearings]

Prints markdown. Bearings and ranges of three stations to a target in the plane (30 readings, one a sample); an orbit
(two bodies) seen by four ground stations, whose position half an hour after the last reading counts.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path

import occontrol as oc
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.families.athans.replanning.monte_carlo import compare
from occontrol.studies.batches import workers

PLANE = """\
family: athans
name: NAME
horizon: {start: 0, end: 29, samples: 30}
sensing: samples
plant:
  states: [x, y, u, v]
  f: [u, v, 0, 0]
  noise: {diag: [0, 0, 0.02, 0.02]}
  initial: {mean: [15, 45, 2.2, -0.6], covariance: {diag: [PP, PP, VV, VV]}}
sensors:
SENSORS
objective: {output: [[0, 0, 0, 0]], running: {diag: [1, 1, 0, 0]}, running_at: posterior}
replan: {every: 10}
"""
STATIONS = {"west": (0, 0), "east": (100, 0), "north": (50, 90)}
MU, RADIUS, TURN = 398600.4418, 6378.137, 7.2921159e-5  # km^3/s^2, km, rad/s
GROUND = {"Cairo": (30.0, 31.2), "Almaty": (43.2, 76.9), "Guam": (13.4, 144.8), "Auckland": (-36.8, 174.8)}


def plane(kind: str, sd: float) -> str:
    """The target in the plane with bearings or ranges, and a prior deviation of its position."""
    lines = []
    for name, (a, b) in STATIONS.items():
        if kind == "bearings":
            lines.append(f'  - {{name: {name}, h: ["atan2(y-{b}, x-{a})"], angle: true, noise: [[0.0004]]}}')
        else:
            r = f"sqrt((x-{a})**2+(y-{b})**2)"
            lines.append(f'  - {{name: {name}, h: ["{r}"], noise: [["(0.5+((x-{a})**2+(y-{b})**2)/1600)**2"]]}}')
    text = PLANE.replace("NAME", kind).replace("SENSORS", "\n".join(lines))
    return text.replace("PP", str(sd**2)).replace("VV", str((0.3 * sd / 4) ** 2))


def orbit(sd: float) -> str:
    """An orbit of 9,500 km and eccentricity 0.2, 60 samples of two minutes, four stations with range or range rate."""
    a, e, tilt = 9500.0, 0.2, math.radians(50)
    r, speed = a * (1 - e), math.sqrt(MU / a * (1 + e) / (1 - e))
    mean = [r, 0.0, 0.0, 0.0, speed * math.cos(tilt), speed * math.sin(tilt)]
    cube = "(x**2+y**2+z**2)**1.5"
    sensors = []
    for name, (latitude, longitude) in GROUND.items():
        phi, lam = math.radians(latitude), math.radians(longitude)
        flat, up = RADIUS * math.cos(phi), RADIUS * math.sin(phi)
        angle = f"({TURN}*t+{lam:.6f})"
        sx, sy, sz = f"{flat:.4f}*cos{angle}", f"{flat:.4f}*sin{angle}", f"{up:.4f}"
        dx, dy, dz = f"(x-{sx})", f"(y-{sy})", f"(z-{sz})"
        far = f"sqrt({dx}**2+{dy}**2+{dz}**2)"
        seen = f"({dx}*{sx}+{dy}*{sy}+{dz}*{sz})/({RADIUS}*{far})-{math.sin(math.radians(5)):.6f}"
        vx, vy = f"(u+{TURN}*{sy})", f"(v-{TURN}*{sx})"
        rate = f"({dx}*{vx}+{dy}*{vy}+{dz}*w)/{far}"
        sensors.append(f'  - {{name: {name} range, h: ["{far}"], noise: [[4.0e-4]], visible: "{seen}"}}')
        sensors.append(f'  - {{name: {name} rate, h: ["{rate}"], noise: [[4.0e-10]], visible: "{seen}"}}')
    covariance = [sd**2] * 3 + [(1e-3 * sd) ** 2] * 3
    force = ", ".join(f'"-{MU}*{axis}/{cube}"' for axis in "xyz")
    return f"""\
family: athans
name: orbit
horizon: {{start: 0, end: 7080, samples: 60, predict_at: 8880}}
sensing: samples
plant:
  states: [x, y, z, u, v, w]
  f: [u, v, w, {force}]
  noise: {{diag: [0, 0, 0, 1.0e-13, 1.0e-13, 1.0e-13]}}
  initial: {{mean: {mean}, covariance: {{diag: {covariance}}}}}
sensors:
{chr(10).join(sensors)}
  - idle
objective: {{output: [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0]]}}
integrator: {{substeps: 4}}
replan: {{every: 15}}
"""


CASES = {
    "bearings": {f"{sd} m": lambda sd=sd: plane("bearings", sd) for sd in (2, 8, 16)},
    "ranges": {f"{sd} m": lambda sd=sd: plane("ranges", sd) for sd in (2, 8, 16)},
    "orbit": {f"{sd} km": lambda sd=sd: orbit(sd) for sd in (1, 5, 20)},
}


def main() -> None:
    """Run what is asked for and print a table a case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", choices=sorted(CASES))
    options = parser.parse_args()
    for name, cases in CASES.items():
        if options.only in (None, name):
            for prior, text in cases.items():
                _case(name, prior, text(), options)


def _case(name: str, prior: str, text: str, options: argparse.Namespace) -> None:
    with tempfile.TemporaryDirectory() as home:
        path = Path(home) / f"{name}.yaml"
        path.write_text(text, encoding="utf-8")
        problem = oc.read_problem(path)
    began = time.process_time()
    solution = oc.solve(problem)
    with workers(solution.problem, solution, options.jobs) as work:
        found = compare(solution.problem, solution, None, options.runs, 1, Monitor(), work, early=False)
    top = solution.numbers.top
    index = solution.result.get("nonlinearity") or {}
    print(f"\n### {name}, prior deviation {prior}\n")
    print(
        f"Planned {top.cost:.5g}, bound {rounded_down(top.lower_bound, 5)} (of the linearised problem); "
        f"nonlinearity: readings {index.get('readings', 0):.3g}, predictions {index.get('predictions', 0):.3g}. "
        f"{found.runs} runs, {time.process_time() - began:.0f} s.\n"
    )
    print("| policy | mean error | median | to nominal, 95 % | diverged | NEES | NIS | lost | ms a decision |")
    print("|---|---|---|---|---|---|---|---|---|")
    for policy, row in found.policies.items():
        change = "-"
        if row.get("difference_error"):
            change = f"{row['difference']:+.4g} +- {1.96 * row['difference_error']:.2g}"
        mean = "-" if row["standard_error"] is None else f"{row['mean']:.5g} +- {1.96 * row['standard_error']:.2g}"
        cells = [mean, f"{row['median']:.5g}", change]
        rest = [row[key] for key in ("nees", "nis", "lost", "milliseconds")]
        cells += [f"{row['diverged']:.2%}", *("-" if value is None else f"{value:.3g}" for value in rest)]
        print(f"| {policy} | " + " | ".join(cells) + " |", flush=True)
    print(f"\n{found.verdict}", flush=True)


if __name__ == "__main__":
    main()
