"""A small scheduling problem, its file, and its solution, for tests that need any."""

from __future__ import annotations

import os
from pathlib import Path

# before numpy is there: threads of several workers on the same cores would wait for each other
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import pytest  # noqa: E402

from occontrol.core.solution import Solution  # noqa: E402

SMALL = """\
family: athans
name: two radars
horizon: {start: 0, end: 4, intervals: 40, predict_at: 5}
plant:
  A: [[0, 1], ["-(1+0.2*sin(t))", -0.4]]
  noise: [[0, 0], [0, 0.5]]
  initial: {mean: [1, 0], covariance: {diag: [5, 5]}}
sensors:
  - {name: range, C: [[1, 0]], noise: [[0.1]], cost: 2.0, windows: [[0, 2], [3, 4]]}
  - {name: doppler, C: [[0, 1]], noise: [[0.4]], cost: 0.5}
  - idle
objective: {cost_weight: 0.1, output: [[1, 0]]}
method: {name: schedule, relative_gap: 1.0e-4}
"""


@pytest.fixture
def small_text() -> str:
    """A problem file that solves in a moment."""
    return SMALL


@pytest.fixture
def small_file(tmp_path: Path) -> Path:
    """The same as a file in a folder of its own."""
    path = tmp_path / "radars.yaml"
    path.write_text(SMALL)
    return path


@pytest.fixture(scope="session")
def small_solution(tmp_path_factory: pytest.TempPathFactory) -> Solution:
    """Its solution, which carries its problem."""
    import occontrol

    path = tmp_path_factory.mktemp("small") / "radars.yaml"
    path.write_text(SMALL)
    return occontrol.solve(occontrol.read_problem(path))


@pytest.fixture(scope="session")
def solved():
    """solved("tracking_network"): the solution of a shipped problem by its own method, found once a session."""
    import functools

    import occontrol

    folder = Path(__file__).resolve().parent.parent / "problems"

    @functools.cache
    def solve(name: str) -> Solution:
        return occontrol.solve(occontrol.read_problem(folder / f"{name}.yaml"))

    return solve
