"""Switching against the worst uncertainty as a schedule of continuous sensing: the same Riccati equation without K."""

from __future__ import annotations

import numpy as np

from occontrol.core.kinds import Plain, PlainDict
from occontrol.core.sensor import IDLE
from occontrol.families.robust.problem import Problem

SAMPLES = 400  # of B B' where it varies, in a table joined by straight lines


def as_schedule(problem: Problem) -> tuple[PlainDict, list[str]]:
    """The problem as a document of family athans: noise B B', unit noise of the sensors, covariance X0^-1.

    Parameters
    ----------
    problem : Problem

    Returns the document, and sentences on what is left behind.
    """
    remarks = ["level is left behind: tr Sigma(T) counts, as if w and v were white noise of intensity 1"]
    if problem.size != "trace":
        remarks.append("the size is left behind: the trace of the covariance at the end is minimised")
    plant, n = problem.plant, problem.states
    times = np.linspace(problem.edges[0], problem.edges[-1], SAMPLES + 1)
    if np.any(plant.K.sample(times)):
        remarks.append("K is left behind: family athans takes the plant for known")
    B = plant.B.sample(times)
    driven = B @ np.swapaxes(B, 1, 2)
    constant = bool(np.all(driven == driven[0]))
    noise: Plain = {"times": times.tolist(), "values": driven.tolist(), "interpolation": "linear"}
    sensors: list[Plain] = [
        {"name": s.name, "C": s.C.document(), "noise": np.eye(s.rows).tolist()} if s.rows else IDLE
        for s in problem.sensors
    ]
    document: PlainDict = {
        "family": "athans",
        "name": problem.name,
        "horizon": {"edges": problem.edges.tolist(), "refine": False},
        "plant": {
            "A": plant.A.document(),
            "noise": driven[0].tolist() if constant else noise,
            "initial": {"mean": plant.center.tolist(), "covariance": np.linalg.inv(plant.weight).tolist()},
        },
        "sensors": sensors,
        "objective": {"output": np.eye(n).tolist()},
    }
    return document, remarks
