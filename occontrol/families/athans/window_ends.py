"""What moving an end of a window is worth: min_w s.w with the sensor less that without it, s = g/h at that time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.core.kinds import PlainDict
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.integration.integrator import Evaluation, Integrator
from occontrol.families.athans.integration.path import parts_of
from occontrol.families.athans.problem import SchedulingProblem


def window_ends(problem: SchedulingProblem, integrator: Integrator, at: Evaluation) -> list[PlainDict]:
    """Every end of a window inside the horizon, with dJ/dt of moving it outwards and inwards.

    Parameters
    ----------
    problem : SchedulingProblem, on the integrator's states
    integrator : Integrator
    at : the relaxed optimum
    """
    path = parts_of(integrator, at).path
    first, last = float(problem.edges[0]), float(problem.edges[-1])
    found: list[PlainDict] = []
    for j, sensor in enumerate(problem.sensors):
        for window in sensor.windows or ():
            for which, t in zip(("start", "end"), window, strict=True):
                if first < t < last:
                    node = int(np.argmin(np.abs(problem.edges - t)))
                    outside, inside = (node, node - 1) if which == "end" else (node - 1, node)
                    s = _switching(problem, path.covariance[node], path.costate[node], float(problem.edges[node]))
                    longer = _least(problem, s, outside, {j: 1.0}) - _least(problem, s, outside, {})
                    shorter = _least(problem, s, inside, {j: 0.0}) - _least(problem, s, inside, {})
                    moved = {"longer": longer, "shorter": shorter}
                    found.append({"sensor": sensor.name, "t": float(t), "end": which, **moved})
    return found


def _switching(problem: SchedulingProblem, covariance: np.ndarray, costate: np.ndarray, t: float) -> np.ndarray:
    """(M,) s_j = alpha q_j - tr(L_j Sigma P Sigma) at one time.

    Parameters
    ----------
    problem : SchedulingProblem
    covariance, costate : (n, n)
    t : time
    """
    moment = covariance @ costate @ covariance
    found = []
    for sensor in problem.sensors:
        price = problem.cost_weight * float(sensor.cost.at(t)[0, 0])
        if sensor.rows:
            C = sensor.C.at(t)
            price -= float(np.trace(np.linalg.solve(sensor.noise.at(t), C @ moment @ C.T)))
        found.append(price)
    return np.array(found)


def _least(problem: SchedulingProblem, s: np.ndarray, interval: int, changed: dict[int, float]) -> float:
    """min s.w over what is allowed on an interval, with other limits for some sensors; inf where nothing is."""
    allowed = feasible_set(problem)
    upper = allowed.upper[interval : interval + 1].copy()
    for j, limit in changed.items():
        upper[0, j] = limit
    if np.sum(np.minimum(upper, allowed.select)) < allowed.select:
        return np.inf
    one = replace(allowed, upper=upper, edges=None)
    return float(np.sum(s * one.vertex(s[None])))
