"""A selection problem as a document of another family: the whole horizon planned at once."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.kinds import PlainDict
from occontrol.families.vlambda.problem import Problem


def as_readings(problem: Problem) -> tuple[PlainDict, list[str]]:
    """The problem as a document of family athans in discrete time: minimise the sum over k of tr P(k|k).

    P_ij / (s_i s_j) with the scales s; epochs, sensors and `select` stay.

    Parameters
    ----------
    problem : Problem without movable sensors

    Returns the document, and sentences on what is left behind. Raises UsageError for movable sensors.
    """
    movable = [sensor.name for sensor in problem.sensors if sensor.movable]
    if movable:
        what = f"sensor '{movable[0]}' can be moved, and family athans has no movable sensors"
        raise UsageError(f"{what}\n  hint: give it a fixed H, one sensor for each place")
    remarks = []
    if problem.criterion != "trace":
        remarks.append(f"the criterion {problem.criterion} is left behind: the sum of traces of P(k|k) is minimised")
    if problem.method is not None:
        remarks.append(f"the method {problem.method.name} is left behind: the default plans all choices together")
    plant = problem.plant
    system: PlainDict = {"F": plant.F.document(), "Q": plant.Q.document()}
    if plant.G is not None:
        system["G"] = plant.G.document()
    system["initial"] = {"mean": plant.mean.tolist(), "covariance": plant.covariance.tolist()}
    document = {
        "family": "athans",
        "name": problem.name,
        "horizon": {"steps": problem.steps, "epoch": problem.epoch},
        "plant": system,
        "sensors": [{"name": s.name, "H": s.H.document(), "R": s.R.document()} for s in problem.sensors],
        "select": int(problem.select),
        "objective": {"running": np.diag(1.0 / problem.scales**2).tolist(), "running_at": "posterior"},
    }
    return document, remarks
