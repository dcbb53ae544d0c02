"""Bokeh's plots write their styles anew whenever they are painted; what has not changed need not be worked out again.

A plot of Bokeh 3.9 puts the place of each axis, grid and legend into a style sheet at every painting, and then asks the
browser for colours, which makes it work out all styles of the page: about thirty times for one change of the drive.
Almost always the text of the style sheet is what it was."""

from __future__ import annotations

from typing import Any

from bokeh.events import DocumentReady
from bokeh.models import CustomJS

CODE = """
const sheets = Bokeh.require("core/dom").InlineStyleSheet.prototype;
if (!sheets.steady && typeof sheets._update === "function") {
    const update = sheets._update;
    sheets._update = function(css) { if (this.el.textContent !== css) update.call(this, css); };
    sheets.steady = true;
}
"""
"""Lets a style sheet keep a text that is the same."""


def keep_styles(document: Any) -> None:
    """Have a page leave the style sheets of its plots alone as long as they say the same."""
    document.js_on_event(DocumentReady, CustomJS(code=CODE))
