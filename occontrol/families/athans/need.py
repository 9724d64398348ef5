"""The memory that a solve of a scheduling problem will hold, counted array by array from the sizes alone."""

from __future__ import annotations

from occontrol.core.memory import require
from occontrol.core.signal import TableSignal
from occontrol.families.athans.problem import SchedulingProblem

PAIR_BYTES = 300_000_000  # bytes of the quasi-Newton memory at most, see scheduling/relaxation.py
LIBRARY_BYTES = 200_000_000  # the libraries and their compiled code
ARRAYS_PER_HALF = 14  # (n, n) arrays a half interval that transitions of a varying plant need: exp of 2n x 2n, F, Q
ARRAYS_PER_INTERVAL = 12  # (n, n) arrays an interval in a sweep, its gradient, its certificate and the run
COPIES_OF_ROWS = 6  # copies of all scaled rows: sampled, scaled, joined, gains


def need(problem: SchedulingProblem) -> int:
    """Bytes at the peak, libraries included; right within a factor of about two.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    n, N, M = problem.states, problem.intervals, len(problem.sensors)
    rows = sum(sensor.rows for sensor in problem.sensors)
    plant_varies = not (problem.plant.A.constant and problem.plant.noise.constant)
    rows_vary = not all(sensor.C.constant and sensor.noise.constant for sensor in problem.sensors)
    matrices = ARRAYS_PER_INTERVAL * N * n * n + (2 * ARRAYS_PER_HALF * N * n * n if plant_varies else 0)
    gains = 2 * N * n * max((s.rows for s in problem.sensors), default=0)
    stacked = COPIES_OF_ROWS * rows * n * (N if rows_vary else 1) + gains
    tables = sum(s.values.nbytes for s in problem.signals.values() if isinstance(s, TableSignal))
    pairs = min(PAIR_BYTES, 8 * 2 * 120 * N * M)
    return int(LIBRARY_BYTES + 8 * (matrices + stacked + 20 * N * M) + 2 * tables + pairs)


def require_memory(problem: SchedulingProblem) -> None:
    """ProblemError, with the numbers, when a solve needs more memory than this process may have.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    n, N, M = problem.states, problem.intervals, len(problem.sensors)
    what = f"a solve with {n} states, {M} sensors and {N} intervals"
    # the count is right within a factor of about two: refused is only what cannot fit
    require(need(problem) // 2, what, "fewer intervals, fewer states (a reduced model), or a machine with more memory")
