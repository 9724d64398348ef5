"""Problem files with nonlinear plants that several tests start from."""

from __future__ import annotations

from pathlib import Path

from occontrol.api import read_problem

BEARINGS = """family: athans
name: bearings of a target by one of three stations
horizon: {start: 0, end: 7, sample_times: [0, 1, 2, 3, 4, 5, 6, 7]}
sensing: samples
plant:
  f: [x3, x4, 0, 0]
  noise: {diag: [0, 0, 0.02, 0.02]}
  initial: {mean: [15, 45, 2.2, -0.6], covariance: {diag: [4, 4, 0.0225, 0.0225]}}
sensors:
  - {name: west,  h: ["atan2(x2, x1)"], angle: true, noise: [[0.0004]]}
  - {name: east,  h: ["atan2(x2, x1-100)"], angle: true, noise: [[0.0004]]}
  - {name: north, h: ["atan2(x2-90, x1-50)"], angle: true, noise: [[0.0004]]}
objective: {output: [[0, 0, 0, 0]], running: {diag: [1, 1, 0, 0]}, running_at: posterior}
"""
STATIONS = {"west": (0.0, 0.0), "east": (100.0, 0.0), "north": (50.0, 90.0)}

PENDULUM = """family: athans
name: pendulum
horizon: {start: 0, end: 6, samples: 30}
sensing: samples
plant:
  states: [angle, rate]
  f: [rate, "-9.81*sin(angle) - 0.1*rate"]
  noise: {diag: [0, 0.02]}
  initial: {mean: [1.05, 0], covariance: {diag: [0.04, 0.04]}}
sensors:
  - {name: encoder, h: [angle], noise: [[0.01]], cost: 1}
  - name: camera
    h: ["sin(angle)", "1 - cos(angle)"]
    noise: {diag: ["0.0004*(1 + angle**2)", 0.0004]}
    visible: "0.7 - abs(angle)"
    cost: 3
  - idle
objective: {cost_weight: 0.001, running: {diag: [1, 0.1]}}
"""
SENSED = (
    PENDULUM.replace("end: 6, samples: 30", "end: 2, intervals: 10")
    .replace("sensing: samples\n", "")
    .replace("0.01]]", "0.002]]")
    .replace("0.0004", "8.0e-5")
    .replace("running:", "output: [[0, 0]], running:")
)
STEPPED = """family: athans
name: two species
horizon: {steps: 12}
plant:
  states: [prey, hunters]
  next: ["prey*exp(0.4*(1 - prey/3) - 0.3*hunters)", "0.7*hunters + r*prey*hunters"]
  parameters: {r: {mean: 0.3, sd: 0.05}}
  noise: {diag: ["0.001*prey**2", 0.001]}
  initial: {mean: [1.5, 0.8], covariance: {diag: [0.04, 0.04]}}
sensors:
  - {name: count, h: [prey], noise: [["0.01 + 0.02*prey"]], cost: 0.001}
  - {name: traps, h: ["hunters/(1 + hunters)"], noise: [[0.004]], cost: 0.002, windows: [[2, 9]]}
select: 0..1
objective: {output: [[0, 0, 10]], at: posterior}
"""


def read(text: str, folder: Path, name: str = "case"):
    """The problem of a text."""
    path = folder / f"{name}.yaml"
    path.write_text(text)
    return read_problem(path)
