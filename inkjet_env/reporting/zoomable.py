"""Pictures that can be zoomed and that tell their numbers where the pointer is, drawn in the browser by Bokeh."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.extras import extra
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_SAMPLES = 6000
"""Largest number of samples of a picture outside its first view; more are thinned, the peaks kept."""
LEFT_MARGIN = 62
"""Width of the ordinates' labels in pixels, so that panels above each other have their axes above each other."""
MODEL_ID = re.compile(r"p\d+")


@dataclass(frozen=True)
class Line:
    """One line of a panel.

    Attributes
    ----------
    label : str
        Its name in the legend and where the pointer is.
    y : ndarray, shape (n,)
        Ordinates.
    colour : str
        Colour as in HTML.
    width : float
        Width in pixels.
    dash : str
        "solid", "dashed", "dotted" or "dotdash".
    marks : bool
        Whether it is drawn as dots instead of a line.
    """

    label: str
    y: Real
    colour: str
    width: float = 1.4
    dash: str = "solid"
    marks: bool = False


@dataclass(frozen=True)
class Panel:
    """One of the panels above each other.

    Attributes
    ----------
    label : str
        Label of the ordinate.
    unit : str
        Its unit, as told where the pointer is.
    lines : sequence of Line
        Lines, drawn in this order.
    height : int
        Height in pixels.
    band : float
        Half the height of the noise's band around 0, in the ordinate's unit; 0 for none.
    scale : {"linear", "log"}
        Scale of the ordinate.
    """

    label: str
    unit: str
    lines: Sequence[Line]
    height: int = 170
    band: float = 0.0
    scale: str = "linear"


@dataclass(frozen=True)
class Picture:
    """A picture for a page.

    Attributes
    ----------
    name : str
        Id of its place on the page.
    item : dict
        Content for Bokeh in the browser, as plain JSON values; the same picture always has the same.
    still : Figure, optional
        The same, drawn without a browser's code: for paper, and where no code may run.
    legend : sequence of (str, str, str)
        Label, colour and kind ("line", "band") of each entry.
    """

    name: str
    item: Mapping[str, Any]
    still: Figure | None = None
    legend: Sequence[tuple[str, str, str]] = field(default=())


def stacked_picture(
    name: str,
    x: Real,
    x_name: str,
    x_unit: str,
    panels: Sequence[Panel],
    still: Figure,
    view: slice | None = None,
    shaded: slice | None = None,
    x_scale: str = "linear",
) -> Picture:
    """Panels above each other that share their abscissa: zoomed together, with a line through all at the pointer.

    Parameters
    ----------
    name : str
        Id of the picture on its page.
    x : ndarray, shape (n,)
        Abscissae of every line, increasing.
    x_name, x_unit : str
        Name and unit of the abscissa; empty for a number without one.
    panels : sequence of Panel
        From top to bottom.
    still : Figure
        The same, drawn by Matplotlib.
    view : slice, optional
        Samples that are seen first; all unless given. The whole is seen after a click on "reset".
    shaded : slice, optional
        Samples that are shaded; none unless given.
    x_scale : {"linear", "log"}
        Scale of the abscissa.
    """
    with extra("a report"):
        from bokeh.layouts import gridplot
        from bokeh.models import BoxAnnotation, ColumnDataSource, CrosshairTool, HoverTool, Range1d, Span
        from bokeh.plotting import figure

    rows = kept_samples([line.y for panel in panels for line in panel.lines], view)
    columns = {"x": x[rows]}
    ends = float(x[0]), float(x[-1])
    start, end = ends if view is None else (float(x[view.start]), float(x[view.stop - 1]))
    across = Range1d(start, end, bounds=ends, reset_start=ends[0], reset_end=ends[1])
    pointer = Span(dimension="height", line_color="#888888", line_width=1)
    source = ColumnDataSource()
    plots = []
    for place, panel in enumerate(panels):
        last = place == len(panels) - 1
        plot = figure(
            height=panel.height + (45 if last else 0), x_range=across, x_axis_type=x_scale, y_axis_type=panel.scale,
            tools="pan,box_zoom,wheel_zoom,reset,save", active_drag="box_zoom", active_scroll=None,
            output_backend="svg", sizing_mode="stretch_width", min_border_left=LEFT_MARGIN, min_border_right=12,
            background_fill_alpha=0, border_fill_alpha=0, outline_line_color=None,
        )  # fmt: skip
        plain_axes(plot, last)
        if panel.band:
            plot.add_layout(BoxAnnotation(bottom=-panel.band, top=panel.band, fill_color="#bbbbbb", fill_alpha=0.5))
        if shaded is not None:
            plot.add_layout(
                BoxAnnotation(left=x[shaded.start], right=x[shaded.stop - 1], fill_color="#e69f00", fill_alpha=0.15)
            )
        told = [(x_name, f"@x{{0.[000]}} {x_unit}")]
        glyphs = []
        for number, line in enumerate(panel.lines):
            column = f"y{place}_{number}"
            columns[column] = line.y[rows]
            drawn = {"source": source, "color": line.colour}
            if line.marks:
                glyphs.append(plot.scatter("x", column, size=4 * line.width, **drawn))
            else:
                style = {"line_width": line.width, "line_dash": line.dash}
                glyphs.append(plot.line("x", column, **drawn, **style))
            told.append((line.label, f"@{column}{{{_digits(line.y)}}} {panel.unit}"))
        plot.add_tools(HoverTool(renderers=glyphs[:1], mode="vline", tooltips=told, visible=False))
        plot.add_tools(CrosshairTool(dimensions="height", overlay=pointer, visible=False))
        plot.yaxis.axis_label = panel.label
        named = f"{x_name} ({x_unit})" if x_unit else x_name
        plot.xaxis.axis_label = named if last else None
        plots.append([plot])
    source.data = {column: np.asarray(values, dtype=np.float64) for column, values in columns.items()}
    stack = gridplot(plots, sizing_mode="stretch_width", toolbar_location="right", toolbar_options={"logo": None})
    seen = {
        line.label: (line.label, line.colour, "line") for panel in panels for line in panel.lines if panel.lines[1:]
    }
    bands = [("± 2 × noise", "#bbbbbb", "band")] if any(panel.band for panel in panels) else []
    return Picture(name, item_of(name, stack), still, [*seen.values(), *bands])


def plain_axes(plot: Any, last: bool = True) -> None:
    """Give a Bokeh plot fonts, grid and ticks like those of the still pictures; only the last panel has an abscissa."""
    plot.xgrid.grid_line_color = plot.ygrid.grid_line_color = "#dddddd"
    for axis in (*plot.xaxis, *plot.yaxis):
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = axis.major_label_text_font_size = "12px"
        axis.axis_label_standoff = 6
        axis.axis_line_color = "#666666"
    plot.xaxis.major_label_text_font_size = "12px" if last else "0px"
    plot.xaxis.major_tick_line_color = "#666666" if last else None
    plot.xaxis.minor_tick_line_color = plot.yaxis.minor_tick_line_color = None


def _digits(y: Real) -> str:
    """Format of a number where the pointer is, with four digits of the largest."""
    sizes = np.abs(y[np.isfinite(y)])
    decimals = 3 - int(np.floor(np.log10(max(float(sizes.max(initial=0.0)), 1e-12))))
    return "0." + "0" * min(max(decimals, 1), 9)


def kept_samples(signals: Sequence[Real], view: slice | None) -> NDArray[np.intp]:
    """Indices of the samples to draw: all in view; outside it, the extremes of each run of neighbours of each signal.

    Parameters
    ----------
    signals : sequence of ndarray, shape (n,) each
        What is drawn.
    view : slice, optional
        Samples that are all kept, if there are at most `MOST_SAMPLES`.

    Returns
    -------
    ndarray of int, shape (k,)
        Increasing, the first and the last among them.
    """
    n = signals[0].size
    if n <= MOST_SAMPLES:
        return np.arange(n)
    run = -(-2 * len(signals) * n // MOST_SAMPLES)
    first = np.arange(0, n, run)
    kept = [np.array([0, n - 1])]
    for signal in signals:
        table = np.append(signal, np.full(first.size * run - n, signal[-1])).reshape(-1, run)
        kept += [np.minimum(first + of(table, axis=1), n - 1) for of in (np.argmin, np.argmax)]
    if view is not None and view.stop - view.start <= MOST_SAMPLES:
        kept.append(np.arange(view.start, view.stop))
    return np.unique(np.concatenate(kept))


def item_of(name: str, model: Any) -> dict[str, Any]:
    """A Bokeh model as plain JSON values for the browser, with ids that depend on nothing but the picture.

    Bokeh counts its ids on through a process, and a page would differ each time that it is written.
    """
    with extra("a report"):
        from bokeh.embed import json_item

    item: dict[str, Any] = json_item(model, name)
    ids: dict[str, str] = {}
    renamed: dict[str, Any] = _renamed(item, ids, name)
    return renamed


def _renamed(value: Any, ids: dict[str, str], name: str) -> Any:
    if isinstance(value, dict):
        return {
            key: ids.setdefault(inner, f"{name}-{len(ids)}")
            if key in ("id", "root_id") and isinstance(inner, str) and MODEL_ID.fullmatch(inner)
            else _renamed(inner, ids, name)
            for key, inner in value.items()
        }
    if isinstance(value, (list, tuple)):
        return [_renamed(inner, ids, name) for inner in value]
    return value
