"""Pages: what a run, a comparison or a front shows, as one HTML file that needs no network.

`Page` (content.py) is data that knows no family; `write_page` (document.py) makes the file. Bokeh is imported there and
nowhere else (drawing.py), only while a page is being written.
"""

from occontrol.files.page.content import Bars, Curves, Group, Page, Panel, Picture, Shades, Table
from occontrol.files.page.document import write_page

__all__ = ["Bars", "Curves", "Group", "Page", "Panel", "Picture", "Shades", "Table", "write_page"]
