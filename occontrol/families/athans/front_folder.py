"""A trade-off on disk: tradeoff.json, front.csv, weights in arrays.npz, and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import FileAccessError
from occontrol.files.atomic import replacing, write_text
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
    folder, content = Path(folder), front.as_dict()
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
            from occontrol.files.figures import save

            for name, figure in draw(front).items():
                save(figure, folder / f"{name}.png")
                written.append(folder / f"{name}.png")
    except OSError as error:
        raise FileAccessError(f"cannot write to {folder}: {error.strerror or error}") from error
    return written
