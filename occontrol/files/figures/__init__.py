"""Pictures, one module per family: draw(problem, solution) and draw_compare(problem, solutions)."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from occontrol.core.solution import Solution
from occontrol.files.atomic import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _module(family: str) -> Any:
    try:
        return importlib.import_module(f"occontrol.families.{family}.figures")
    except ModuleNotFoundError as error:
        if error.name != f"occontrol.families.{family}.figures":
            raise
        return None


def figures_of(problem: Any, solution: Solution) -> dict[str, Figure]:
    """Every figure of `solution` to `problem` by name, the most telling first; none for a family without pictures."""
    module = _module(problem.family)
    return {} if module is None else module.draw(problem, solution)


def compare_figure(problem: Any, solutions: Mapping[str, Solution]) -> Figure | None:
    """One figure of several `solutions`, by method name, to the same `problem`."""
    module = _module(problem.family)
    return module.draw_compare(problem, solutions) if hasattr(module, "draw_compare") else None


def estimate_figures(problem: Any, solution: Solution, estimate: Any, truth: Any = None) -> dict[str, Figure]:
    """The figures of an `estimate`: the family's own where it has some, those of the filters otherwise."""
    own = getattr(_module(problem.family), "draw_estimate", None)
    if own is None:
        from occontrol.files.figures.estimates import draw as own
    return own(problem, solution, estimate, truth)


def save(figure: Figure, path: Path) -> None:
    """Write `figure` as a picture to `path`, in the format that its suffix names."""
    with replacing(path) as file:
        figure.savefig(file, dpi=150, facecolor="white", format=Path(path).suffix.removeprefix(".") or "png")
