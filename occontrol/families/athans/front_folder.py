"""A trade-off on disk: tradeoff.json, front.csv, weights in arrays.npz, and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import FileAccessError
from occontrol.core.versions import stamped
from occontrol.files.atomic import replacing, write_text
from occontrol.files.page.content import Curves, Group
from occontrol.files.plain_json import to_json
from occontrol.files.tables import write_table

if TYPE_CHECKING:
    from occontrol.families.athans.tradeoff import Front


def write_front(folder: str | Path, front: Front, figures: bool = True) -> list[Path]:
    """Write a front; each file is replaced only when its successor is complete.

    Parameters
    ----------
    folder : created if missing
    front : Front
    figures : whether to draw

    Returns the files written. Raises FileAccessError.
    """
    folder, content = Path(folder), stamped(front.as_dict())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        written = [write_text(folder / "tradeoff.json", to_json(content))]
        keys = ("cost_weight", "observation_cost", "error", "cost", "lower_bound", "relative_gap", "switches")
        rows = [[point[key] for key in keys] for point in content["points"]]
        written.append(write_table(folder / "front.csv", keys, rows))
        arrays = {
            "cost_weights": front.cost_weights,
            "edges": front.problem.edges,
            "weights": front.schedules.weights,
            "relaxed_weights": front.relaxed.weights,
        }
        with replacing(folder / "arrays.npz") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        written.append(folder / "arrays.npz")
        if figures:
            from occontrol.families.athans.figures_tradeoff import draw
            from occontrol.files.page.records import write_records_page

            points = [{key: point[key] for key in keys} for point in content["points"]]
            written += write_records_page(
                folder / "tradeoff.html", front.problem.name, "trade-off of observation cost against error", points,
                draw(front), sentences=[_said(front)], groups=front_groups(front),
            )  # fmt: skip
    except OSError as error:
        raise FileAccessError(f"cannot write to {folder}: {error.strerror or error}") from error
    return written


def _said(front: Front) -> str:
    where = {"continuous": "", "grid": " that changes at these edges", "problem": " of these readings"}[front.of]
    return f"No schedule{where} lies below the bound: with more error comes less observation cost, and the other way."


def front_groups(front: Front) -> list[Group]:
    """The panels of a front: error over observation cost with its bound, and the gap over the cost weight.

    Parameters
    ----------
    front : Front
    """
    order = np.argsort(front.schedules.observation_cost, kind="stable")
    spent, error = front.schedules.observation_cost[order], front.schedules.error[order]
    values = np.column_stack([error, front.least_error(spent)])
    gaps = (front.schedules.cost - front.lower_bound) / np.abs(front.schedules.cost)
    return [
        Group(axis="observation cost", panels=[
            Curves(title="error of the schedules, and the bound below which there is none", label="error", times=spent,
                   values=values, names=["schedules", "lower bound"]),
        ]),
        Group(axis="cost weight α", log=True, panels=[
            Curves(title="proven gap of the schedule, in percent of its cost", label="gap in %", names=["gap"],
                   times=front.cost_weights, values=100 * np.maximum(gaps, 0.0)[:, None]),
        ]),
    ]  # fmt: skip
