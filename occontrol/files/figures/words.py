"""What a picture shows, in words, for those who cannot see it; and the picture in few bytes."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_CURVES = 6  # that are told one by one
WIDTH, COLOURS = 1100, 64  # pixels and colours of a picture inside a page


def words_of(figure: Figure) -> str:
    """Title, and of every panel its title, what its axes are, and where its curves begin and end.

    Parameters
    ----------
    figure : a picture that is complete
    """
    said = [text.get_text() for text in figure.texts]
    said += [_panel(axes) for axes in figure.axes if axes.get_visible() and (axes.axison or axes.texts)]
    return _plain(". ".join(part.rstrip(". ") for part in said if part) + ".")


def _panel(axes: Axes) -> str:
    if not axes.axison:
        return ", ".join(line for text in axes.texts for line in text.get_text().splitlines() if line)
    title = axes.get_title(loc="left") or axes.get_title()
    names = [text for text in (axes.get_ylabel(), axes.get_xlabel()) if text]
    head = ": ".join(part for part in (title, " over ".join(names)) if part)
    told = [_curve(label, line) for line, label in zip(*_labelled(axes), strict=True)]
    if len(told) > MOST_CURVES:
        told = [*told[:MOST_CURVES], f"and {len(told) - MOST_CURVES} more"]
    rows = [] if told else [text.get_text() for text in axes.get_yticklabels() if _is_name(text.get_text())]
    if len(rows) > 2 * MOST_CURVES:
        rows = [*rows[:MOST_CURVES], f"and {len(rows) - MOST_CURVES} more"]
    tail = ", ".join(told) or (f"rows {', '.join(rows)}" if rows else "")
    return "; ".join(part for part in (head, tail) if part)


def _labelled(axes: Axes) -> tuple[list, list[str]]:
    handles, labels = axes.get_legend_handles_labels()
    return list(handles), [str(label) for label in labels]


def _curve(label: str, handle: object) -> str:
    data = getattr(handle, "get_ydata", None)
    if data is None:
        return label
    values = np.asarray(data(), dtype=float)
    finite = values[np.isfinite(values)]
    if not len(finite):
        return label
    return f"{label} from {finite[0]:.3g} to {finite[-1]:.3g}" if len(finite) > 1 else f"{label} {finite[0]:.3g}"


def _is_name(text: str) -> bool:
    return any(letter.isalpha() for letter in text) and "mathdefault" not in text


def _plain(text: str) -> str:
    return " ".join(text.replace("\\$", "\0").replace("$", "").replace("\0", "$").split())  # \$ is a sign, $ none


def small_png(png: bytes) -> bytes:
    """The same picture with fewer pixels and colours, for a page that must stay small.

    Parameters
    ----------
    png : content of a picture file
    """
    from PIL import Image

    with Image.open(io.BytesIO(png)) as image:
        height = round(image.height * WIDTH / image.width)
        small = image.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
        content = io.BytesIO()
        small.quantize(COLOURS, dither=Image.Dither.NONE).save(content, "PNG", optimize=True)
    return content.getvalue()
