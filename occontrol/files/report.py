"""The pictures of a run as PNG files, and one HTML page that embeds them beside the numbers."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from occontrol.files.figures import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222 }}
table {{ border-collapse: collapse }} td {{ padding: .2rem 1.5rem .2rem 0; vertical-align: top; white-space: pre-line }}
td:first-child {{ color: #666 }} img {{ max-width: 100%; margin: 1rem 0 }}
</style></head><body>
<h1>{title}</h1>
<table>{rows}</table>
{pictures}
</body></html>
"""


def write_pictures_and_report(
    folder: Path, title: str, rows: Sequence[tuple[str, str]], figures: Mapping[str, Figure]
) -> None:
    """Write every figure into figures/ and gather them in report.html.

    Parameters
    ----------
    folder : where to write
    title : of the page
    rows : (label, text) lines above the pictures
    figures : by name, in the order of the page
    """
    pictures = []
    for name, figure in figures.items():
        path = folder / "figures" / f"{name}.png"
        path.parent.mkdir(exist_ok=True)
        save(figure, path)
        pictures.append(path)
    (folder / "report.html").write_text(_page(title, rows, pictures), encoding="utf-8")


def _page(title: str, pairs: Sequence[tuple[str, str]], pictures: list[Path]) -> str:
    rows = "".join(f"<tr><td>{html.escape(str(a))}</td><td>{html.escape(str(b))}</td></tr>" for a, b in pairs)
    images = []
    for path in pictures:
        code = base64.b64encode(path.read_bytes()).decode("ascii")
        images.append(f'<img alt="{html.escape(path.stem)}" src="data:image/png;base64,{code}">')
    return _PAGE.format(title=html.escape(title), rows=rows, pictures="\n".join(images))
