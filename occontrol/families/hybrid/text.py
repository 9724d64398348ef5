"""What the command line prints about jumping-mode problems and their solutions."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import plural
from occontrol.core.solution import Solution
from occontrol.families.hybrid.methods import Scheduled
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.result import numbers_of


def plus_minus(error: float | None) -> str:
    """A standard `error` as it stands behind its number, such as " ± 0.12"; nothing where there is none."""
    return f" ± {error:.2g}" if isinstance(error, int | float) and np.isfinite(error) else ""


def summarise(problem: Problem, solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    """
    r = numbers_of(solution)
    share = ", ".join(f"{name} {100 * value:.3g} %" for name, value in r.use.items())
    rms = f"{r.average_rms:.5g}{plus_minus(r.average_rms_standard_error)}"
    errors = f"{r.mode_errors:.5g}{plus_minus(r.mode_errors_standard_error)}"
    nees = f"{r.average_nees:.5g}{plus_minus(r.average_nees_standard_error)}"
    lines = [
        ("method", solution.method + (f", {r.sensor}" if r.sensor else "")),
        ("average RMS", f"{rms} (position error, mean over the steps)"),
        ("peak RMS", f"{r.peak_rms:.5g}{plus_minus(r.peak_rms_standard_error)}"),
        ("mode errors", f"{errors} of {problem.steps} steps"),
        ("use", share),
        ("NEES", f"{nees} ({r.states} where the covariance is honest)"),
        ("seconds", f"{solution.seconds:.2f}"),
    ]
    for other in r.candidates or ():
        text = f"average RMS {other.average_rms:.5g}{plus_minus(other.average_rms_standard_error)}"
        lines.append((f"only {other.sensor}", f"{text}, mode errors {other.mode_errors:.4g}"))
    return lines


def describe(problem: Problem) -> list[tuple[str, str]]:
    """The lines that `check` prints.

    Parameters
    ----------
    problem : Problem
    """
    plant = problem.plant
    how = "Markov transitions" if plant.guards is None else f"{len(plant.guards)} guards on the state"
    groups = ", ".join("+".join(group) for group in problem.groups or ())
    sensors = ", ".join(f"{s.name} ({plural(s.rows, 'value')})" for s in problem.sensors)
    position = ", ".join(f"x{i + 1}" for i in problem.position or ())
    weight = f" + {problem.position_weight:g} × position variance" if problem.position_weight else ""
    method = problem.method or Scheduled()
    return [
        ("plant", f"{plant.states} states, {len(plant.modes)} modes ({', '.join(plant.names)}), {how}"),
        ("sensors", sensors),
        ("groups", f"{groups}; one at a time"),
        ("criterion", f"bound on a wrong mode{weight}"),
        ("position", position),
        ("method", method.name),
        ("simulation", f"{problem.runs} runs of {problem.steps} steps, seed {problem.seed}"),
        ("observability", _observability(problem)),
        ("work", f"{problem.runs * problem.steps} estimator steps of {len(plant.modes)} modes, about {_work(problem)}"),
    ]


def _observability(problem: Problem) -> str:
    """Rank of the observability matrix of every mode with all sensors together, at k = 1."""
    n, low = problem.plant.states, []
    C = np.vstack([sensor.C.at(1.0) for sensor in problem.sensors])
    for mode in problem.plant.modes:
        blocks, A = [C], mode.A.at(1.0)
        for _ in range(n - 1):
            blocks.append(blocks[-1] @ A)
        rank = int(np.linalg.matrix_rank(np.vstack(blocks)))
        if rank < n:
            low.append(f"{mode.name} has rank {rank} of {n}")
    return "every mode is observable with all sensors" if not low else "with all sensors: " + "; ".join(low)


def _work(problem: Problem) -> str:
    """A rough time on one core: the operations of mixing, prediction, scores and update, two nanoseconds each."""
    n, modes, groups = problem.plant.states, len(problem.plant.modes), len(problem.groups or ())
    p = max(sensor.rows for sensor in problem.sensors)
    each = modes * modes * n * n + modes * (4 * n**3 + 4 * n * n * p) + groups * modes * (n * n * p + modes * p**3)
    seconds = 2e-9 * each * problem.runs * problem.steps
    return "a second or less" if seconds < 1 else f"{seconds:.0f} s"
