"""The memory that a solve of a scheduling problem will hold, counted array by array from the sizes alone."""

from __future__ import annotations

from occontrol.core.memory import require
from occontrol.core.signal import TableSignal
from occontrol.families.athans.problem import SchedulingProblem

PAIR_BYTES = 300_000_000  # bytes of the quasi-Newton memory at most, see scheduling/relaxation.py
LIBRARY_BYTES = 200_000_000  # the libraries and their compiled code
FORMING_BYTES = 130_000_000  # while transitions of a varying plant are formed, block by block
# measured peaks of whole solves, as arrays for each step of the finest mesh
ARRAYS_PER_STEP = 15  # (n, n): sweep, gradient, certificate, independent check, the arrays of the run
ARRAYS_PER_SPAN = 24  # (n, n) in addition where the plant varies and no two steps share a transition
COPIES_OF_ROWS = 3  # copies of all scaled rows where they vary: sampled, scaled, joined
STEPS_PER_INTERVAL = 4  # steps of the finest mesh for each interval: two of the mesh, each halved


def need(problem: SchedulingProblem, finest: int = STEPS_PER_INTERVAL) -> int:
    """Bytes at the peak of a solve, libraries included.

    Parameters
    ----------
    problem : SchedulingProblem
    finest : steps of the finest mesh for each interval; 1 gives the least that a solve can do with. How many an
        accurate solve needs is seen only while it is solved
    """
    n, N, M = problem.states, problem.intervals, len(problem.sensors)
    steps = problem.integration.steps(N, finest)
    rows = sum(sensor.rows for sensor in problem.sensors)
    plant_varies = not (problem.plant.A.constant and problem.plant.noise.constant)
    rows_vary = not all(sensor.C.constant and sensor.noise.constant for sensor in problem.sensors)
    matrices = (ARRAYS_PER_STEP + (ARRAYS_PER_SPAN if plant_varies else 0)) * steps * n * n
    widest = max((s.rows for s in problem.sensors), default=0)
    stacked = COPIES_OF_ROWS * rows * n * (steps if rows_vary else 1) + 2 * N * n * widest
    tables = sum(s.values.nbytes for s in problem.signals.values() if isinstance(s, TableSignal))
    pairs = min(PAIR_BYTES, 8 * 2 * 120 * N * M)
    fixed = LIBRARY_BYTES + (FORMING_BYTES if plant_varies else 0)
    return int(fixed + 8 * (matrices + stacked + 20 * N * M) + 2 * tables + pairs)


def require_memory(problem: SchedulingProblem) -> None:
    """ProblemError, with the numbers, when a solve needs more memory than this process may have.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    n, N, M = problem.states, problem.intervals, len(problem.sensors)
    what = f"a solve with {n} states, {M} sensors and {N} intervals"
    # the count is right within a factor of about two: refused is only what cannot fit
    least = need(problem, 1) // 2
    require(least, what, "fewer intervals, fewer states (a reduced model), or a machine with more memory")
