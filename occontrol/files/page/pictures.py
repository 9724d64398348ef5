"""Pictures of a figure, written beside a page and small inside of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from occontrol.files.figures import save
from occontrol.files.page.content import Picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def pictures_of(figures: Mapping[str, Figure], folder: Path, prefix: str = "") -> list[Picture]:
    """Write every figure as a PNG file and return what a page shows of it.

    Parameters
    ----------
    figures : by name, in the order of the page
    folder : where to write, created if missing
    prefix : of the files' names

    Raises FileAccessError.
    """
    from occontrol.files.figures.words import small_png, words_of

    pictures = []
    for name, figure in figures.items():
        path = folder / f"{prefix}{name}.png"
        path.parent.mkdir(exist_ok=True)
        save(figure, path)
        pictures.append(Picture(name=name, png=small_png(path.read_bytes()), words=words_of(figure)))
    return pictures
