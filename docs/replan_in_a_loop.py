"""A loop that reads, steps and plans anew, with its latencies: a target followed by bearings from three stations.

    python docs/replan_in_a_loop.py [RUNS]

`Sky` stands where your sensors are. What the loop does is five lines of `fly`; the rest measures how long they take.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from statistics import median

import numpy as np

import occontrol as oc

STATIONS = {"west": (0.0, 0.0), "east": (100.0, 0.0), "north": (50.0, 90.0)}
PROBLEM = Path(__file__).resolve().parent.parent / "problems" / "bearings_only.yaml"
LOST = 0.1  # of the readings


class Sky:
    """A target that flies as the plant says, and sensors of which one reading in ten is lost."""

    def __init__(self, problem: oc.Problem, seed: int):
        self.draw = np.random.default_rng(seed)
        self.state = self.draw.multivariate_normal(problem.plant.mean, problem.plant.covariance)

    def read(self, name: str) -> np.ndarray | None:
        """The bearing from a station, or None."""
        x, y = self.state[:2] - STATIONS[name]
        bearing = np.arctan2(y, x) + 0.02 * self.draw.standard_normal()
        return None if self.draw.random() < LOST else np.array([bearing])

    def move(self) -> None:
        """A second goes by."""
        push = np.sqrt(0.02) * self.draw.standard_normal((2, 2))  # of speed, and of position beside it
        self.state[:2] += self.state[2:] + push[0] / 2 + push[1] / np.sqrt(12)
        self.state[2:] += push[0]


def fly(loop: oc.athans.ReplanningLoop, sky: Sky) -> tuple[list[float], list[float], int]:
    """Milliseconds of plain steps and of steps that plan, and how many plans came too late."""
    plain, planned, late = [], [], 0
    loop.restart()
    while not loop.finished:
        readings = {name: z for name in loop.next_sensors if (z := sky.read(name)) is not None}
        began = time.perf_counter()
        step = loop.step(readings)
        took = 1e3 * (time.perf_counter() - began)
        if step.replan is None:
            plain.append(took)
        else:
            planned.append(took)
            late += step.replan.late
        sky.move()
    return plain, planned, late


def main() -> None:
    """Fly a few targets and print latencies; the first one warms up what is compiled."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    problem = oc.read_problem(PROBLEM)
    solution = oc.solve(problem)
    loop = oc.athans.ReplanningLoop(problem, solution.schedule, oc.athans.Replanning(every=5, deadline=0.5))
    fly(loop, Sky(problem, 0))
    plain, planned, late = [], [], 0
    for seed in range(1, runs + 1):
        steps, plans, dropped = fly(loop, Sky(problem, seed))
        plain, planned, late = plain + steps, planned + plans, late + dropped
    print(f"{runs} runs of {problem.readings} readings, one in ten lost, a plan every 5")
    for name, values in (("a step", plain), ("a step with a plan", planned)):
        print(f"{name:<18}  median {median(values):6.2f} ms   largest {max(values):6.2f} ms   of {len(values)}")
    print(f"late plans          {late} of {len(planned)}")


if __name__ == "__main__":
    main()
