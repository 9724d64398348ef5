"""Problems of many targets for tests: seeded tracking targets as a document, and small files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

FIVE = """\
family: athans
name: five aircraft, one radar
constants: {sharp: 0.1}
horizon: {start: 0, end: 10, intervals: 40, substeps: 1}
resources:
  - {name: radar, capacity: 1, windows: [[0, 4], [5, 10]]}
target_models:
  aircraft:
    A: [[0, 1], [0, -0.2]]
    noise: {diag: [0, q]}
    initial: {mean: [0, 1], covariance: {diag: [4, 1]}}
    running: {diag: [1, 0]}
targets:
  - {table: {name: [a, b, c, d, e], q: [0.1, 0.2, 0.4, 0.6, 1.0], r: [1, 1, 2, 2, 3]}, model: aircraft}
looks:
  - {resource: radar, C: [[1, 0]], noise: [[sharp*r]]}
"""


def tracking(K: int, N: int, capacity: int, end: float, theta: float, seed: int = 5, spread: float = 1.0) -> dict:
    """K targets of three axes with drag and one radar: what to read about them stands in docs/bench.md.

    Noise of a look runs from `theta` to ten times that; plant noise and weights are spread over `spread` decades.
    """
    g = np.random.default_rng(seed)
    targets, models = [], {}
    for i in range(K):
        drag = g.uniform(0.05, 0.3)
        q = g.uniform(0.3, 1, 3) * 10 ** g.uniform(-spread, 0)
        noise = g.uniform(theta, 10 * theta, (1, 3))[0]
        weight = 10 ** g.uniform(-0.5 * spread, 0.5 * spread)
        position = g.uniform(1, 5)
        A = np.zeros((6, 6))
        A[:3, 3:], A[3:, 3:] = np.eye(3), -drag * np.eye(3)
        models[f"m{i}"] = {
            "A": A.tolist(),
            "noise": {"diag": [0, 0, 0, *q]},
            "running": {"diag": [*([weight / end] * 3), 0, 0, 0]},
            "initial": {"mean": [0] * 6, "covariance": {"diag": [position] * 3 + [0.5] * 3}},
        }
        targets.append({"name": f"t{i}", "model": f"m{i}", "noise": {"radar": {"diag": noise.tolist()}}})
    return {
        "family": "athans",
        "name": f"{K} targets",
        "horizon": {"start": 0, "end": end, "intervals": N, "substeps": 1},
        "resources": [{"name": "radar", "capacity": capacity}],
        "target_models": models,
        "targets": targets,
        "looks": [{"resource": "radar", "C": np.eye(3, 6).tolist()}],
        "objective": {"cost_weight": 0},
    }


def five(N: int = 200) -> dict:
    """The five targets of six states that docs/bench.md has as one dense plant, with running and terminal weights."""
    g, K = np.random.default_rng(5), 5
    models, targets = {}, []
    for i in range(K):
        A = np.diag(np.ones(3), 3) + np.diag([0.0] * 3 + [-g.uniform(0.05, 0.3)] * 3)
        q, s0 = g.uniform(0.1, 1, 3), g.uniform(5, 20)
        weight = g.uniform(0.5, 2)
        models[f"m{i}"] = {
            "A": A.tolist(), "noise": {"diag": [0, 0, 0, *q]}, "output": (weight * np.eye(3, 6)).tolist(),
            "running": {"diag": [*[g.uniform(0.25, 4)] * 3, 0, 0, 0]},
            "initial": {"covariance": {"diag": [s0] * 3 + [1] * 3}},
        }  # fmt: skip
    for i in range(K):
        theta = g.uniform(0.01, 0.1, 3).tolist()
        targets.append({"name": f"t{i}", "model": f"m{i}", "noise": {"radar": {"diag": theta}}})
    return {
        "family": "athans", "name": "five targets", "horizon": {"start": 0, "end": 20, "intervals": N, "substeps": 1},
        "resources": [{"name": "radar", "capacity": 1}], "target_models": models, "targets": targets,
        "looks": [{"resource": "radar", "C": np.eye(3, 6).tolist()}], "objective": {"cost_weight": 0},
    }  # fmt: skip


def read(document: dict | str, folder: Path):
    """The problem of a document or of YAML text, through a file."""
    import occontrol
    from occontrol.files.plain_json import to_json

    path = folder / ("problem.yaml" if isinstance(document, str) else "problem.json")
    path.write_text(document if isinstance(document, str) else to_json(document))
    return occontrol.read_problem(path)
