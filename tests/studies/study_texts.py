"""Small studies for tests: a thermometer with two sensors, solved in some ten milliseconds."""

from __future__ import annotations

from pathlib import Path

BASE = """\
family: athans
name: thermometer
horizon: {start: 0, end: 4, intervals: 20, substeps: 1}
plant: {A: [[-0.3]], noise: [[0.2]], initial: {covariance: [[2]]}}
sensors:
  - {name: fine, C: [[1]], noise: [[0.2]], cost: 0.4}
  - {name: coarse, C: [[1]], noise: [[1]], cost: 0.05}
  - idle
objective: {cost_weight: 0.1, output: [[1]]}
method: {name: schedule, polish: 20, relative_gap: 1.0e-3}
"""
VARY = """\
base: base.yaml
vary:
  sensors.fine.noise: [[[0.1]], [[0.2]]]
  objective.cost_weight: {from: 0.01, to: 1, points: 3, scale: log}
"""


def write_study(folder: Path, text: str = VARY, base: str = BASE, name: str = "study") -> Path:
    """A study file in `folder`, and its base problem beside it."""
    (folder / "base.yaml").write_text(base, encoding="utf-8")
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path
