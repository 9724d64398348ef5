"""The pictures of README and docs, made anew: python scripts/docs_figures.py [folder] [name ..].

Without names all of them, docs/figures if no folder is given. The papers' own figures are scripts/reproduce.py,
those of speed scripts/bench.py, and that of studies the command in docs/studies.md.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import occontrol
from occontrol.api import compare_figure, estimate_figures, read_problem, simulate
from occontrol.core.solution import Solution
from occontrol.files.figures import save

ROOT = Path(__file__).parents[1]
FRONT = [1e-4 * 1000 ** (i / 14) for i in range(15)]  # --weights 1e-4:1e-1:15


@cache
def solved(name: str, method: str | None = None) -> Solution:
    """The solution of a shipped problem."""
    return occontrol.solve(read_problem(ROOT / "problems" / f"{name}.yaml"), method)


def one(name: str, figure: str, method: str | None = None) -> dict:
    """One figure of a solution."""
    solution = solved(name, method)
    return {figure: occontrol.plot(solution, figure=figure)}


def estimates() -> dict:
    """The filter over simulated passes of the tracking network, beside the truth."""
    solution = solved("tracking_network")
    measurements, truth = simulate(solution.problem, solution, 1)
    estimate = occontrol.run_filter(solution.problem, solution, measurements)
    return estimate_figures(solution.problem, solution, estimate, truth)


def front() -> dict:
    """The trade-off of the attitude telemetry."""
    from occontrol.families.athans.figures_tradeoff import draw

    return draw(occontrol.tradeoff(read_problem(ROOT / "problems/attitude_telemetry.yaml"), FRONT))


def vehicle() -> dict:
    """Methods side by side on the car."""
    problem = read_problem(ROOT / "problems/robust_vehicle.yaml")
    names = ("optimal", "one-step", "best-single", "round-robin")
    return {"compare": compare_figure(problem, {name: occontrol.solve(problem, name) for name in names})}


# file name: (what makes it, which of the figures that it returns)
PICTURES: dict[str, tuple[Callable[[], dict], str]] = {
    "tracking_network": (lambda: one("tracking_network", "overview"), "overview"),
    "tracking_prediction": (cache(estimates), "prediction"),
    "tracking_estimates": (cache(estimates), "estimates"),
    "attitude_front": (front_once := cache(front), "front"),
    "attitude_front_schedules": (front_once, "schedules"),
    "robust_vehicle_overview": (lambda: one("robust_vehicle", "overview"), "overview"),
    "robust_vehicle_states": (lambda: one("robust_vehicle", "states"), "states"),
    "robust_vehicle_compare": (vehicle, "compare"),
    "robust_oscillator_sequences": (lambda: one("robust_oscillator", "sequences", "all"), "sequences"),
}


def main(words: list[str]) -> int:
    """Draw the pictures that are named, or all of them."""
    folder = Path(words.pop(0)) if words and words[0] not in PICTURES else ROOT / "docs" / "figures"
    unknown = [name for name in words if name not in PICTURES]
    if unknown:
        print(f"no picture {', '.join(unknown)}; there are {', '.join(PICTURES)}", file=sys.stderr)
        return 2
    folder.mkdir(parents=True, exist_ok=True)
    for name in words or PICTURES:
        make, which = PICTURES[name]
        save(make()[which], folder / f"{name}.png")
        print(folder / f"{name}.png", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
