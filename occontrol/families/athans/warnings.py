"""What a scheduling problem says that is allowed and hardly meant: lost modes, useless windows and sensors, size."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import Mistake
from occontrol.core.memory import size
from occontrol.core.signal import Signal
from occontrol.families.athans.integration.edges import missed_windows
from occontrol.families.athans.need import need
from occontrol.families.athans.problem import SchedulingProblem

LARGE_BYTES = 2 * 2**30  # bytes
SAMPLES = 9
MOST_COMPARED = 60  # sensors; among more, each is not compared with every other
RANK = 1e-9


def warnings_of(problem: SchedulingProblem) -> list[Mistake]:
    """Warnings with their paths.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    return [*lost_modes(problem), *_windows(problem), *_never_better(problem), *_size(problem)]


def lost_modes(problem: SchedulingProblem, counted: bool = False) -> list[Mistake]:
    """Growing modes of A that no sensor ever sees: rank [s I - A; C] < n for an eigenvalue s with Re s > 0.

    Parameters
    ----------
    problem : SchedulingProblem
    counted : only those that the cost counts: D v or the running weight times v is not 0 for a lost direction v
    """
    plant, n = problem.plant, problem.states
    middle = problem.midpoints[len(problem.midpoints) // 2]
    A = plant.A.at(float(middle))
    seeing = [s for j, s in enumerate(problem.sensors) if s.rows and np.any(problem.upper[:, j] > 0)]
    rows = [C / max(float(np.abs(C).max()), 1e-300) for s in seeing for C in _samples(s.C, problem)]
    C = np.vstack(rows) if rows else np.zeros((0, n))
    scale = max(float(np.linalg.norm(A, 2)), 1e-300)
    lost = set()
    for value in np.linalg.eigvals(A):
        if value.real > RANK * scale:
            stacked = np.vstack([(A - value * np.eye(n)) / scale, C])
            _, sizes, directions = np.linalg.svd(stacked)
            hidden = directions[np.append(sizes, np.zeros(n - len(sizes))) < RANK]
            if len(hidden) and (not counted or _counts(problem, hidden.conj().T)):
                lost.add(f"{value.real:.4g}")
    if not lost:
        return []
    rates = ", ".join(sorted(lost))
    what = f"not observable and unstable: no sensor sees a mode of the plant that grows (rate {rates})"
    return [Mistake(("plant", "A"), what, "its variance grows whatever the schedule; add a sensor that sees it")]


def _counts(problem: SchedulingProblem, directions: np.ndarray) -> bool:
    """Whether output or running weight see any of the `directions` (n, K)."""
    weights = [problem.output.at(float(problem.predict_at or 0.0))[None]]
    if problem.running is not None:
        weights.append(_samples(problem.running, problem))
    return any(np.any(np.abs(w @ directions) > RANK * np.abs(w).max()) for group in weights for w in group)


def _windows(problem: SchedulingProblem) -> list[Mistake]:
    """Single windows that miss the horizon, in the words of `problem.warnings`."""
    hint = "windows are in the time of the horizon"
    return [
        Mistake(("sensors", j, "windows"), what, hint)
        for j, sensor in enumerate(problem.sensors)
        for what in missed_windows([sensor], problem.edges)[1]
    ]


def _never_better(problem: SchedulingProblem) -> list[Mistake]:
    """Sensors beside which another one, open whenever they are, tells at least as much and costs no more.

    L_j <= L_i in the order of matrices, q_i <= q_j, at every sampled time.
    """
    count = len(problem.sensors)
    if problem.select != 1 or problem.ruled or not 2 <= count <= MOST_COMPARED:
        return []  # under rules the better one may be used up, or far away
    told = [_information(problem, j) for j in range(count)]
    costs = [np.array([c[0, 0] for c in _samples(s.cost, problem)]) for s in problem.sensors]
    found = []
    for j, sensor in enumerate(problem.sensors):
        for i in range(count) if sensor.rows else ():
            other = problem.sensors[i]
            covers = i != j and bool(np.all(problem.upper[:, i] >= problem.upper[:, j]))
            if not covers or np.any(costs[i] > costs[j]):
                continue
            apart = told[i] - told[j]
            least = np.linalg.eigvalsh((apart + np.swapaxes(apart, 1, 2)) / 2)[:, 0]
            same = np.array_equal(told[i], told[j]) and np.array_equal(costs[i], costs[j])
            if np.all(least >= -RANK * np.abs(told[i]).max()) and not (same and i > j):
                what = f"sensor '{sensor.name}' is never better than '{other.name}': it sees no more and costs no less"
                found.append(Mistake(("sensors", j), what, "leave it out, or mend its noise or cost"))
                break
    return found


def _size(problem: SchedulingProblem) -> list[Mistake]:
    held = need(problem)
    if held < LARGE_BYTES:
        return []
    what = f"a solve will hold about {size(held)} of memory"
    return [Mistake(("horizon",), what, "fewer intervals, or a reduced model of the plant", key=True)]


def _samples(signal: Signal, problem: SchedulingProblem) -> np.ndarray:
    """(K, rows, columns) at a few midpoints; the same number for every signal."""
    picks = np.unique(np.linspace(0, problem.intervals - 1, SAMPLES).astype(int))
    return np.asarray(signal.sample(problem.midpoints[picks]))


def _information(problem: SchedulingProblem, j: int) -> np.ndarray:
    """(K, n, n) C' Theta^-1 C of a sensor at the sampled times."""
    sensor, n = problem.sensors[j], problem.states
    C = _samples(sensor.C, problem)
    if not sensor.rows:
        return np.zeros((len(C), n, n))
    return np.swapaxes(C, 1, 2) @ np.linalg.solve(_samples(sensor.noise, problem), C)
