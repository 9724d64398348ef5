"""A page as one HTML file that asks for nothing else: with panels where Bokeh is there, with pictures where not."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from occontrol.core.kinds import Plain, PlainDict
from occontrol.files.atomic import write_text
from occontrol.files.page.content import Bars, Curves, Group, Page, Panel, Picture, Table
from occontrol.files.plain_json import plain
from occontrol.files.spreadsheet import as_text

FIRST_ROWS = 200  # of a table, for those without scripts
_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>
{css}</style>
<script>document.documentElement.className = "js"</script>
</head><body>
<header><h1>{title}</h1><p class="kind">{kind}</p></header>
<main>
{main}
</main>
{scripts}
</body></html>
"""


def write_page(path: str | Path, page: Page, static: bool = False) -> Path:
    """Write a page to one file and return its path; what was there is replaced only when the new one is complete.

    Parameters
    ----------
    path : the file; its folder must exist
    page : what stands on it
    static : pictures in the place of panels; also where Bokeh is not installed

    Raises FileAccessError.
    """
    return write_text(path, page_text(page, static))


def page_text(page: Page, static: bool = False) -> str:
    """The text of the HTML file.

    Parameters
    ----------
    page : what stands on it
    static : pictures in the place of panels; also where Bokeh is not installed
    """
    live = not static and bool(page.groups) and find_spec("bokeh") is not None
    parts = [_sentences(page), _numbers(page.numbers)]
    scripts = []
    if live:
        parts += [_boxes(page.groups), *(_figure(group, f"panels{i}") for i, group in enumerate(page.groups))]
        scripts += [_data(f"panels{i}-data", _drawn(group, f"panels{i}")) for i, group in enumerate(page.groups)]
    pictures = [_picture(picture) for picture in page.pictures]
    if pictures and live:
        shut = "<script>document.currentScript.previousElementSibling.open = false</script>"
        parts.append(f'<details class="pictures" open><summary>pictures</summary>{"".join(pictures)}</details>{shut}')
    else:
        parts += pictures
    parts.append(_facts(page.facts))
    for i, table in enumerate(page.tables):
        parts.append(_table(table, f"table{i}"))
        scripts.append(_data(f"table{i}", _columns(table)))
    parts += [_text(title, text) for title, text in page.texts]
    if live:
        scripts.append(f"<script>{_library()}</script>")
    if live or page.tables:
        scripts.append(f"<script>{_own('page.js')}</script>")
    return _PAGE.format(
        title=html.escape(page.title), kind=html.escape(page.kind), css=_own("page.css"),
        main="\n".join(part for part in parts if part), scripts="\n".join(scripts),
    )  # fmt: skip


@cache
def _own(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


@cache
def _library() -> str:
    """BokehJS as it came with the installed package: the canvas part alone."""
    from bokeh.resources import Resources

    found = Resources(mode="inline", components=["bokeh"], minified=True)
    return "\n".join(found.js_raw).replace("</script", "<\\/script")


def _drawn(group: Group, target: str) -> PlainDict:
    from occontrol.files.page.drawing import item

    return item(group, target)


def _data(name: str, content: object) -> str:
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{text}</script>'


def _sentences(page: Page) -> str:
    return "".join(f"<p>{html.escape(sentence)}</p>" for sentence in page.sentences)


def _numbers(numbers: Sequence[tuple[str, str]]) -> str:
    entries = "".join(
        f'<div><dt>{html.escape(label)}</dt><dd data-number="{html.escape(label)}">{html.escape(text)}</dd></div>'
        for label, text in numbers
    )
    return f'<dl class="numbers">{entries}</dl>' if entries else ""


def _boxes(groups: Sequence[Group]) -> str:
    """A box for every sensor of the schedule; those without one have nothing to hide."""
    bars = next((panel for group in groups for panel in group.panels if isinstance(panel, Bars)), None)
    if bars is None or len(bars.names) < 2:
        return ""
    boxes = "".join(
        f'<label><input type="checkbox" checked value="{html.escape(name)}"> {html.escape(name)}</label>'
        for name in bars.names
    )
    summary = "<summary>sensors that are shown</summary>"
    return f'<details class="live">{summary}<div class="sensors">{boxes}</div></details>'


def _figure(group: Group, name: str) -> str:
    """Where a group is drawn, with what it shows in words for those who cannot see it."""
    title = f"<h2>{html.escape(group.title)}</h2>" if group.title else ""
    words = html.escape(". ".join(panel_words(panel) for panel in group.panels) + f". Horizontal axis: {group.axis}.")
    hint = "wheel: zoom in time, all panels together; drag: move; point at anything to read it"
    return (
        f'{title}<figure class="live"><div class="panels" id="{name}" role="img" aria-label="{words}"></div>'
        f"<figcaption>{hint}</figcaption></figure>"
    )


def panel_words(panel: Panel) -> str:
    """What a panel shows, in words.

    Parameters
    ----------
    panel : of a page
    """
    if isinstance(panel, Bars):
        lengths = np.ones(len(panel.weights)) if panel.instants else np.diff(panel.edges)
        use = lengths @ panel.weights
        most = [j for j in np.argsort(-use, kind="stable") if use[j] > 0][:5]
        unit = " times" if panel.instants else " %"
        scale = 1.0 if panel.instants else 100 / np.sum(lengths)
        said = ", ".join(f"{panel.names[j]} {use[j] * scale:.3g}{unit}" for j in most) or "nothing"
        more = f" and {int(np.sum(use > 0)) - len(most)} more" if np.sum(use > 0) > len(most) else ""
        return f"{panel.title}: {said}{more}"
    if not isinstance(panel, Curves):
        finite = panel.values[np.isfinite(panel.values)]
        span = f" from {np.min(finite):.3g} to {np.max(finite):.3g}" if len(finite) else ""
        return f"{panel.title}: a map of {len(panel.names)} rows, {panel.label}{span}"
    ends = []
    for j, name in enumerate(panel.names[:6]):
        finite = panel.values[np.isfinite(panel.values[:, j]), j]
        ends.append(f"{name} from {finite[0]:.3g} to {finite[-1]:.3g}" if len(finite) else f"{name} nowhere")
    more = f" and {len(panel.names) - 6} more" if len(panel.names) > 6 else ""
    return f"{panel.title}, {panel.label}: {', '.join(ends)}{more}"


def _picture(picture: Picture) -> str:
    code = base64.b64encode(picture.png).decode("ascii")
    return f'<img alt="{html.escape(picture.words)}" decoding="async" src="data:image/png;base64,{code}">'


def _facts(facts: Sequence[tuple[str, str]]) -> str:
    rows = "".join(f"<tr><td>{html.escape(str(a))}</td><td>{html.escape(str(b))}</td></tr>" for a, b in facts)
    return f'<h2>what was found, and how</h2><table class="facts">{rows}</table>' if rows else ""


def _table(table: Table, name: str) -> str:
    """The first rows stand in the file; the script shows the others, sorts and copies."""
    heads = "".join(
        f'<th scope="col"{_numeric(values)}><button type="button">{html.escape(heading)}</button></th>'
        for heading, values in table.columns.items()
    )
    columns = [plain(list(values[:FIRST_ROWS])) for values in table.columns.values()]
    rows = "".join(
        "<tr>" + "".join(f"<td{_numeric([value])}>{html.escape(_shown(value))}</td>" for value in row) + "</tr>"
        for row in zip(*columns, strict=True)  # type: ignore[arg-type]
    )
    left = table.length - FIRST_ROWS
    count = f"the first {FIRST_ROWS} of {table.length} rows" if left > 0 else f"{table.length} rows"
    title = html.escape(table.title)
    return (
        f'<section data-table="{name}"><h2>{title}</h2>'
        f'<p><button type="button" class="copy live">copy as CSV</button> <span class="more">{count}</span></p>'
        f'<div class="scroll" tabindex="0" role="region" aria-label="{title}"><table class="data">'
        f"<thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></div>"
        f'<p class="live"><button type="button" class="next" hidden>more rows</button></p></section>'
    )


def _numeric(values: Sequence[Plain]) -> str:
    return "" if any(isinstance(value, str) for value in values) else ' class="number"'


def _shown(value: Plain) -> str:
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


def _columns(table: Table) -> PlainDict:
    """Numbers as they are, texts as codes for the few that there are."""
    columns: list[PlainDict] = []
    for values in table.columns.values():
        if any(isinstance(value, str) for value in values):
            texts = [as_text(_shown(value)) for value in values]
            words = {text: i for i, text in enumerate(dict.fromkeys(texts))}
            columns.append({"words": list(words), "codes": [words[text] for text in texts]})
        elif columns and "values" in columns[-1] and list(values[:-1]) == columns[-1]["values"][1:]:  # type: ignore[index]
            columns.append({"after": len(columns) - 1, "last": values[-1]})  # what ends where the next one begins
        else:
            columns.append({"values": plain(list(values))})
    return {"headings": list(table.columns), "columns": columns, "length": table.length}


def _text(title: str, text: str) -> str:
    return f"<details><summary>{html.escape(title)}</summary><pre tabindex=\"0\">{html.escape(text)}</pre></details>"
