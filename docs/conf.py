"""The documentation site: `sphinx-build -W -b html docs build/docs` (pip install '.[docs]')."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "scripts")]

project = "occontrol"
author = "the developers of occontrol"
extensions = ["myst_parser"]
html_theme = "furo"
smartquotes = False  # "--to" stays two hyphens
html_title = "occontrol"
exclude_patterns = ["_build"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3


def setup(app):
    """Write the reference pages before Sphinx looks for its sources."""
    import docs_reference

    docs_reference.write(HERE / "_reference")
    app.connect("include-read", _own_page_of_contributing)


def _own_page_of_contributing(app, path, docname, content):
    """The README's link to a file that has a page of its own here."""
    content[0] = content[0].replace("](CONTRIBUTING.md)", "](contributing.md)")
