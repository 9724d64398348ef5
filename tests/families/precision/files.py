"""Small problem files of the family, and how to read one."""

from occontrol import read_problem

BASE = """\
family: precision
plant: {f: ["x2", "-sin(x1)"], step: 0.1, substeps: 2}
measurement: {h: ["x1", "x1 + x2"], names: [a, b]}
initial: {mean: [0.5, 0], covariance: {diag: [0.3, 0.2]}}
noise: {diag: [0, 0.01]}
filter: {name: ukf}
batch: 2
bound: {factor: 0.5}
caps: 50
"""
MOMENTS = """\
family: precision
moments: {state: [[2.0]], cross: [[0.8]], measurement: [[0.5]]}
bound: {matrix: [[1.2]]}
"""


def load(tmp_path, text):
    path = tmp_path / "p.yaml"
    path.write_text(text, encoding="utf-8")
    return read_problem(path)
