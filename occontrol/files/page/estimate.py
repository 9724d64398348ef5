"""The panels of a filter run: who measured, the states with their bands, the prediction, and whether to believe it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.measurement import Estimate
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.core.state_labels import default_names, state_labels, state_names
from occontrol.core.trajectory import Trajectory
from occontrol.files.page.content import Curves, Group, Panel, Shades
from occontrol.files.page.usual import STEP, TIME, column_edges, schedule_bars

MOST_STATES, MOST_OUTPUTS = 12, 6  # that have a panel each


def estimate_groups(
    problem: BaseProblem,
    solution: Solution,
    estimate: Estimate,
    truth: Trajectory | None,
    deviations: float = 2.0,
    band: str = "two standard deviations",
) -> list[Group]:
    """The panels of an estimate, in one group.

    Parameters
    ----------
    problem, solution : that the run belongs to
    estimate : one row per time
    truth : true states at the same times, where they are known
    deviations : half width of the bands, in standard deviations
    band : what the bands are, in words
    """
    times, n = estimate.times, estimate.mean.shape[1]
    panels: list[Panel] = []
    if solution.schedule is not None:
        panels.append(schedule_bars(solution.schedule, "who measures when"))
    width = deviations * estimate.standard_deviation
    value = estimate.mean if truth is None else estimate.mean - truth.values
    names, labels = state_names(problem), state_labels(problem)
    if len(names) != n:
        names = labels = default_names(n)
    of = "" if truth is None else "error of "
    if n <= MOST_STATES:
        for i in range(n):
            middle = value[:, [i]] if truth is None else np.zeros((len(times), 1))
            panels.append(Curves(title=f"{of}{names[i]}; band: {band}", label=labels[i], times=times, names=[names[i]],
                                 values=value[:, [i]], low=middle - width[:, [i]],
                                 high=middle + width[:, [i]]))  # fmt: skip
    else:
        with np.errstate(invalid="ignore", divide="ignore"):
            shown = estimate.standard_deviation if truth is None else np.abs(value) / estimate.standard_deviation
        what = "standard deviation of every state" if truth is None else "size of the error, in standard deviations"
        panels.append(Shades(title=what, label="deviation", edges=column_edges(times, len(times)), values=shown,
                             names=names))  # fmt: skip
    panels += _predictions(estimate, deviations, band)
    panels += _consistency(estimate)
    whole = isinstance(getattr(problem, "steps", None), int)
    return [Group(axis=STEP if whole else TIME, panels=panels, whole=whole)]


def _predictions(estimate: Estimate, deviations: float, band: str) -> list[Panel]:
    """What was predicted at every time, about the last prediction."""
    found: list[Panel] = []
    for i in range(min(estimate.predicted.shape[1], MOST_OUTPUTS)):
        width = deviations * estimate.predicted_deviation[:, [i]]
        if not np.any(width > 0):
            continue
        value = estimate.predicted[:, [i]] - estimate.predicted[-1, i]
        last = f"{estimate.predicted[-1, i]:.4g}"
        title = f"prediction of w{i + 1} made at time t, less the last one, {last}; band: {band}"
        found.append(Curves(title=title, label=f"w{i + 1} − last", times=estimate.times, values=value,
                            low=value - width, high=value + width, names=[f"w{i + 1}"]))  # fmt: skip
    return found


def _consistency(estimate: Estimate) -> list[Panel]:
    """NIS of every time at which something was measured, by the number of values; 1 on average where all is right."""
    used = np.flatnonzero(estimate.dimension > 0)
    if not len(used):
        return []
    nis = estimate.nis[used] / estimate.dimension[used]
    return [Curves(title="normalised innovation squared (NIS) per value; 1 on average where the filter is right",
                   label="NIS per value", times=estimate.times[used], values=nis[:, None], names=["NIS"], level=1.0,
                   dots=True)]  # fmt: skip


def estimate_facts(estimate: Estimate, notes: Sequence[str]) -> list[tuple[str, str]]:
    """(label, text) lines of a filter run.

    Parameters
    ----------
    estimate : one row per time
    notes : sentences that the filter and the comparison with a truth have to say
    """
    used = estimate.dimension > 0
    values = int(np.sum(estimate.dimension[used]))
    rows = [("estimates", str(len(estimate.times))), ("values measured", str(values))]
    if values:
        rows.append(("NIS per value", f"{float(np.sum(estimate.nis[used])) / values:.4g} on average"))
    return [*rows, *(("note", note) for note in notes)]
