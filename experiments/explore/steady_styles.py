"""Bokeh's plots write and ask for styles whenever they are painted; what has not changed need not be worked out again.

A plot of Bokeh 3.9 puts the place of each axis, grid and legend into a style sheet at every painting, and then asks the
browser whether a style sheet says another colour or font (``--bk-…``), which makes it work out all styles of the page:
about thirty times for one change of the drive. Almost always the text of the style sheet is what it was, and no style
sheet of this page says a colour or a font of a plot."""

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
const asked = Bokeh.require("core/visuals/visual").VisualProperties.prototype;
if (typeof asked._get_css_value === "function") asked._get_css_value = () => "";
const plots = Bokeh.require("models/plots/plot_canvas").PlotView.prototype;
const font = Object.getOwnPropertyDescriptor(plots, "base_font_size");
if (font && font.get && !plots.steady) {
    Object.defineProperty(plots, "base_font_size", {get() { return this.steady_font ??= font.get.call(this); }});
    plots.steady = true;
}
"""
"""Lets a style sheet keep a text that is the same, and colours and fonts be those of the models."""


def keep_styles(document: Any) -> None:
    """Have a page leave the style sheets of its plots alone as long as they say the same."""
    document.js_on_event(DocumentReady, CustomJS(code=CODE))
