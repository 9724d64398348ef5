"""The panels of a jumping-mode page: errors over all runs, and the modes and sensors of the first run."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import plural
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_labels, state_names
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.result import numbers_of
from occontrol.files.page.content import Bars, Curves, Group, Panel, Shades
from occontrol.files.page.usual import STEP, curves_or_map, deviations


def groups(problem: Problem, solution: Solution) -> list[Group]:
    """The panels of a solution.

    Parameters
    ----------
    problem : Problem of the family hybrid
    solution : Solution
    """
    arrays, names = solution.arrays, list(problem.sensors.names)
    times, runs = arrays["times"], plural(numbers_of(solution).runs, "run")
    rms, error = arrays["rms"][:, None], arrays["rms_standard_error"][:, None]
    panels: list[Panel] = [
        Curves(title=f"RMS position error of {runs}; band: two standard errors", label="RMS", times=times[1:],
               values=rms, low=rms - 2 * error, high=rms + 2 * error, names=["RMS"]),
        Bars(title="run 1: the sensors in use", edges=arrays["edges"], weights=arrays["weights"], names=names),
        curves_or_map(f"share of {runs} that use a sensor", "share", times[1:], arrays["use"], names, sensors=True),
    ]  # fmt: skip
    modes = list(problem.plant.names)
    true = np.eye(len(modes), dtype=bool)[arrays["truth_mode"].astype(int)]
    chances = arrays["mode_probabilities"]
    title = "run 1: probability of every mode"
    if len(modes) <= 7:
        panels.append(Curves(title=f"{title} (thick: the true one)", label="probability", times=times, values=chances,
                             names=modes, used=true))  # fmt: skip
    else:
        edges = np.append(times, times[-1] + 1) - 0.5
        panels.append(Shades(title=title, label="probability", edges=edges, values=chances, names=modes))
    names, labels = state_names(problem), state_labels(problem)
    deviation = deviations(arrays["covariance"])
    for i in list(problem.position or ())[:3]:
        error, band = (arrays["estimate"] - arrays["truth"])[:, [i]], 2 * deviation[:, [i]]
        panels.append(Curves(title=f"run 1: error of {names[i]}; band: two standard deviations", times=times,
                             label=labels[i], values=error, low=-band, high=band, names=["error"]))  # fmt: skip
    return [Group(axis=STEP, panels=panels, whole=True)]
