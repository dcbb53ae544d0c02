"""Bokeh figures in the look of the application: one font, calm grid, colours that colour-blind readers can tell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, Range1d
from bokeh.plotting import figure

from inkjet_env.reporting.plotting import COLOURS

FONT = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif"
BLUE, ORANGE, GREEN, PINK, AMBER, SKY, BLACK = COLOURS
GREY = "#767676"
FEW = 64
"""Longest column that is sent as text: shorter ones cost more as buffers, which are messages of their own."""
PIN_COLOURS = (ORANGE, GREEN, PINK, AMBER, SKY)


def new_figure(x_label: str, y_label: str, title: str = "", height: int = 260, **options: Any) -> Any:
    """A figure that fills its column, with zoom by box and reset; axes are labelled with their unit."""
    options.setdefault("tools", "box_zoom,xwheel_zoom,reset,save")
    options.setdefault("active_drag", "box_zoom" if "box_zoom" in options["tools"] else None)
    made = figure(
        height=height, min_width=300, sizing_mode="stretch_width", title=title, x_axis_label=x_label,
        y_axis_label=y_label, active_scroll=None, toolbar_location="right", output_backend="canvas", **options,
    )  # fmt: skip
    made.toolbar.logo = None
    made.lod_threshold = None  # every point is drawn while one zooms, too: a peak may be a single point
    made.outline_line_color = None
    made.title.text_font, made.title.text_font_size, made.title.text_font_style = FONT, "13px", "normal"
    for axis in made.axis:
        axis.axis_label_text_font, axis.axis_label_text_font_style = FONT, "normal"
        axis.axis_label_text_font_size, axis.major_label_text_font = "12px", FONT
        axis.axis_line_color, axis.major_tick_line_color, axis.minor_tick_line_color = GREY, GREY, None
    made.grid.grid_line_color = "#e8e8e8"
    return made


def legend_above(made: Any) -> None:
    """Move the legend out of the plot, so that it covers nothing."""
    (legend,) = made.legend
    made.add_layout(legend, "above")
    legend.orientation, legend.border_line_color, legend.padding, legend.margin = "horizontal", None, 0, 0
    legend.label_text_font, legend.label_text_font_size, legend.spacing = FONT, "12px", 12
    legend.ncols = "auto"


def fit(range_: Range1d, low: float, high: float, grow_only: bool) -> None:
    """Set the ends of an axis; while something is dragged, only so that it is wide enough."""
    if grow_only and range_.start is not None and range_.end is not None:
        low, high = min(low, range_.start), max(high, range_.end)
    if (range_.start, range_.end) != (low, high):
        range_.update(start=low, end=high, reset_start=low, reset_end=high)


def put(source: ColumnDataSource, columns: Mapping[str, Any]) -> None:
    """Give a plot new data; what it has already is not sent again."""
    old = source.data
    if old.keys() == columns.keys() and all(_same(old[name], column) for name, column in columns.items()):
        return
    source.data = {name: column.tolist() if _few(column) else column for name, column in columns.items()}


def _few(column: Any) -> bool:
    return isinstance(column, np.ndarray) and column.size <= FEW


def _same(old: Any, new: Any) -> bool:
    """Whether two columns, of numbers, of texts or of lines, are equal."""
    if len(old) != len(new):
        return False
    if len(new) and isinstance(new[0], np.ndarray):  # a column of lines
        return all(np.array_equal(one, other) for one, other in zip(old, new, strict=True))
    return bool(np.array_equal(old, new))
