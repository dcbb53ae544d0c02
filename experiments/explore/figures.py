"""Bokeh figures in the look of the application: one font, calm grid, colours that colour-blind readers can tell."""

from __future__ import annotations

from typing import Any

from bokeh.models import Range1d
from bokeh.plotting import figure

from inkjet_env.reporting.plotting import COLOURS

FONT = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif"
BLUE, ORANGE, GREEN, PINK, AMBER, SKY, BLACK = COLOURS
GREY = "#767676"
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
