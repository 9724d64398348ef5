"""The memory that a solve of a scheduling problem will hold, counted array by array from the sizes alone."""

from __future__ import annotations

from occontrol.core.memory import require
from occontrol.core.signal import TableSignal
from occontrol.families.athans.problem import SchedulingProblem

PAIRS = 300_000_000  # bytes of the quasi-Newton memory at most, see scheduling/relaxation.py
BASE = 200_000_000  # the libraries and their compiled code
HALVES = 14  # (n, n) arrays per half interval while transitions of a varying plant are formed: exp of 2n x 2n, F, Q
SWEEP = 12  # (n, n) arrays per interval in a sweep, its gradient, its certificate and the arrays of the run
ROWS = 6  # copies of all scaled rows: sampled, scaled, joined, gains


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
    matrices = SWEEP * N * n * n + (2 * HALVES * N * n * n if plant_varies else 0)
    stacked = ROWS * rows * n * (N if rows_vary else 1) + 2 * N * n * max((s.rows for s in problem.sensors), default=0)
    tables = sum(s.values.nbytes for s in problem.signals.values() if isinstance(s, TableSignal))
    pairs = min(PAIRS, 8 * 2 * 120 * N * M)
    return int(BASE + 8 * (matrices + stacked + 20 * N * M) + 2 * tables + pairs)


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
