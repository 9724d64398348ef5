"""A trade-off on disk: tradeoff.json, front.csv, weights in arrays.npz, and pictures."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occontrol.core.errors import FileAccessError
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
        written = [_replace(folder / "tradeoff.json", lambda path: path.write_text(to_json(content), encoding="utf-8"))]
        keys = ("cost_weight", "observation_cost", "error", "cost", "lower_bound", "relative_gap", "switches")
        rows = [[point[key] for key in keys] for point in content["points"]]
        written.append(_replace(folder / "front.csv", lambda path: write_table(path, keys, rows)))
        arrays = {
            "cost_weights": front.cost_weights,
            "edges": front.problem.edges,
            "weights": front.schedules.weights,
            "relaxed_weights": front.relaxed.weights,
        }
        written.append(_replace(folder / "arrays.npz", lambda path: _save(path, arrays)))
        if figures:
            from occontrol.families.athans.figures_tradeoff import draw
            from occontrol.files.figures import save

            for name, figure in draw(front).items():
                written.append(_replace(folder / f"{name}.png", lambda path, f=figure: save(f, path)))
    except OSError as error:
        raise FileAccessError(f"cannot write to {folder}: {error.strerror or error}") from error
    return written


def _save(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with open(path, "wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def _replace(path: Path, write: Any) -> Path:
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    write(part)
    os.replace(part, path)
    return path
