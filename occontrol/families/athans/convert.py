"""A problem of continuous sensing as a selection in discrete time, or as switching against the worst uncertainty.

Selection: F and Q of the plant over a step h, one reading a step with R = Theta/h, the same information per time.
Uncertainty: B B' = Xi, rows Theta^{-1/2} C, X0 = Sigma0^-1 and K = 0: the equation of the set's shape is then that of
the covariance, and the set is larger the more energy d there is.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.conversion import Asked
from occontrol.core.errors import UsageError
from occontrol.core.kinds import Plain, PlainDict
from occontrol.core.sensor import IDLE
from occontrol.families.athans.discretise import scaled_rows
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.linalg import square_root
from occontrol.numerics.transition import transitions

MOST_STEPS = 100_000
SAMPLES = 400  # of what varies with time, in a table joined by straight lines


def as_selection(problem: SchedulingProblem, asked: Asked) -> tuple[PlainDict, list[str]]:
    """The problem as a document of family vlambda, with readings every `asked.step`.

    Parameters
    ----------
    problem : without windows
    asked : Asked

    Returns the document, and sentences on what is left behind. Raises UsageError without a step and for windows.
    """
    remarks = _left_behind(problem, "vlambda")
    start, end = float(problem.edges[0]), float(problem.edges[-1])
    if asked.step is None or not asked.step > 0:
        raise UsageError("family vlambda is in discrete time\n  hint: --step H, the time between two readings")
    steps = round((end - start) / asked.step)
    if not 1 <= steps <= MOST_STEPS or abs(steps * asked.step - (end - start)) > 1e-6 * (end - start):
        what = f"the horizon of {end - start:g} is not a whole number of steps of {asked.step:g}"
        raise UsageError(f"{what}\n  hint: --step {(end - start) / max(1, min(steps, MOST_STEPS)):.10g}")
    nodes = (end - start) * np.arange(steps + 1) / steps
    plant, times = problem.plant, start + nodes[:-1]
    F, Q = transitions(plant.A, plant.noise, nodes[:-1], nodes[1:], start)
    sensors = [
        {
            "name": sensor.name,
            "H": _over_steps(sensor.C.sample(times)),
            "R": _over_steps(sensor.noise.sample(times) / asked.step),
        }
        for sensor in problem.sensors
        if sensor.rows
    ]
    document: PlainDict = {
        "family": "vlambda",
        "name": problem.name,
        "horizon": {"steps": steps},
        "plant": {"F": _over_steps(F), "Q": _over_steps(Q), "initial": _initial(problem)},
        "sensors": sensors,
        "select": int(problem.select),
        "criterion": {"name": "trace"},
    }
    if any(not sensor.rows for sensor in problem.sensors):
        remarks.append(f"{IDLE} is left behind: in family vlambda {problem.select} are read at every step")
    return document, remarks


def as_uncertain(problem: SchedulingProblem, asked: Asked) -> tuple[PlainDict, list[str]]:
    """The problem as a document of family robust, with `asked.level` and `asked.slots` slots of equal length.

    Parameters
    ----------
    problem : without windows, one sensor at a time, with a positive definite initial covariance
    asked : Asked

    Returns the document, and sentences on what is left behind. Raises UsageError for what the family has no words for.
    """
    remarks = _left_behind(problem, "robust")
    if problem.select != 1:
        raise UsageError(f"family robust uses one sensor at a time, this problem {problem.select}")
    if asked.level is None or asked.slots is None or not asked.level > 0 or not asked.slots >= 1:
        hint = "--level D, the energy of the unknown inputs (with unit weights), and --slots N"
        raise UsageError(f"family robust needs a budget of uncertainty and slots\n  hint: {hint}")
    covariance = problem.plant.covariance
    weight = np.linalg.pinv((covariance + covariance.T) / 2)
    if np.linalg.matrix_rank(covariance) < problem.states:
        raise UsageError("family robust needs an initial covariance that can be inverted")
    start, end = float(problem.edges[0]), float(problem.edges[-1])
    times = np.linspace(start, end, SAMPLES + 1)
    roots = np.array([square_root(Xi) for Xi in problem.plant.noise.sample(times)])
    rows, which, offsets = scaled_rows(problem.sensors, times)
    sensors: list[Plain] = [
        {"name": s.name, "C": _over_time(times, rows[which][:, offsets[j] : offsets[j + 1]])} if s.rows else IDLE
        for j, s in enumerate(problem.sensors)
    ]
    n = problem.states
    document: PlainDict = {
        "family": "robust",
        "name": problem.name,
        "horizon": {"start": start, "end": end, "slots": int(asked.slots)},
        "plant": {
            "A": problem.plant.A.document(),
            "B": _over_time(times, roots),
            "K": np.zeros((1, n)).tolist(),
            "initial": {"center": problem.plant.mean.tolist(), "weight": weight.tolist(), "level": float(asked.level)},
        },
        "sensors": sensors,
        "size": "trace",
    }
    remarks.append("K is zero: the plant itself is taken for known")
    return document, remarks


def _left_behind(problem: SchedulingProblem, family: str) -> list[str]:
    """Sentences on prices and the objective; UsageError for what would make it another problem."""
    if any(sensor.windows is not None for sensor in problem.sensors):
        raise UsageError(f"family {family} has no windows, and this problem has some\n  hint: leave them out")
    if problem.ruled:
        raise UsageError(f"family {family} has no rules and budgets, and this problem has some\n  hint: leave them out")
    remarks = []
    if any(np.any(s.cost.sample(problem.midpoints)) for s in problem.sensors if s.rows):
        remarks.append("the prices of the sensors are left behind")
    remarks.append("the objective is left behind: the whole state counts, each component in its own unit")
    return remarks


def _initial(problem: SchedulingProblem) -> PlainDict:
    return {"mean": problem.plant.mean.tolist(), "covariance": problem.plant.covariance.tolist()}


def _over_steps(values: np.ndarray) -> Plain:
    """A matrix, or a table over k = 0 .. K-1; `values` (K, ..)."""
    if np.all(values == values[0]):
        return values[0].tolist()
    return {"times": list(range(len(values))), "values": values.tolist(), "interpolation": "previous"}


def _over_time(times: np.ndarray, values: np.ndarray) -> Plain:
    """A matrix, or a table over time joined by straight lines; `times` (K,), `values` (K, ..)."""
    if np.all(values == values[0]):
        return values[0].tolist()
    return {"times": times.tolist(), "values": values.tolist(), "interpolation": "linear"}
