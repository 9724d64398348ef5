"""The pictures of a run as PNG files, and one HTML page that embeds them beside the numbers."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from occontrol.core.solution import Solution
from occontrol.families import family_module
from occontrol.files.figures import figures_of, save

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


def write_pictures_and_report(folder: Path, problem: Any, solution: Solution, content: Mapping[str, Any]) -> None:
    """Draw every figure into figures/ and gather them in report.html.

    Parameters
    ----------
    folder : where to write
    problem : the problem
    solution : Solution
    content : what result.json will hold
    """
    pictures = []
    for name, figure in figures_of(problem, solution).items():
        path = folder / "figures" / f"{name}.png"
        path.parent.mkdir(exist_ok=True)
        save(figure, path)
        pictures.append(path)
    (folder / "report.html").write_text(_page(problem, solution, content, pictures), encoding="utf-8")


def _page(problem: Any, solution: Solution, content: Mapping[str, Any], pictures: list[Path]) -> str:
    pairs = [("family", problem.family), ("status", f"{solution.status}: {solution.message or solution.status.text}")]
    pairs += family_module(problem.family).summarise(problem, solution)
    pairs += [("versions", ", ".join(f"{name} {text}" for name, text in content.get("versions", {}).items()))]
    rows = "".join(f"<tr><td>{html.escape(str(a))}</td><td>{html.escape(str(b))}</td></tr>" for a, b in pairs)
    images = []
    for path in pictures:
        code = base64.b64encode(path.read_bytes()).decode("ascii")
        images.append(f'<img alt="{html.escape(path.stem)}" src="data:image/png;base64,{code}">')
    return _PAGE.format(title=html.escape(str(problem.name)), rows=rows, pictures="\n".join(images))
