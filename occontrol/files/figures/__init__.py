"""What the pictures of all families share: the house style, panels, and the figures of an estimate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from occontrol.files.atomic import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save(figure: Figure, path: Path) -> None:
    """Write `figure` as a picture to `path`, in the format that its suffix names."""
    with replacing(path) as file:
        figure.savefig(file, dpi=150, facecolor="white", format=Path(path).suffix.removeprefix(".") or "png")
