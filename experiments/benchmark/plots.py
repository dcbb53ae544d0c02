"""Plots of a comparison's page, drawn in the browser: the page's choices fill, show and hide their lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from inkjet_env.extras import extra
from inkjet_env.reporting import plotting
from inkjet_env.reporting.zoomable import Picture, item_of, plain_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#7f5fb5", "#8c6d46", "#7f7f7f",
)  # fmt: skip
"""Okabe and Ito's colours, which colour-blind readers can distinguish, and three more; then they begin anew, dashed."""
DASHES = ("solid", "dashed", "dotted")
MOST_IN_LEGEND = len(COLOURS)
"""Largest number of optimisers in a legend, the best first; the pointer tells the name of every line."""
PLAIN_TICKS = """
    if (tick < 0.001) return tick.toExponential(0).replace("-", "−");
    return Number(tick.toPrecision(1)).toLocaleString("en", {maximumFractionDigits: 3});
"""
WIDE, NARROW = 3.4, 1.7
"""Widths of the winner's line and of the others', in pixels."""


def style_of(place: int) -> tuple[str, str]:
    """Colour and dash of an optimiser by its place in the ranking, from 0 on."""
    return COLOURS[place % len(COLOURS)], DASHES[place // len(COLOURS) % len(DASHES)]


def pictures(data: Mapping[str, Any]) -> list[Picture]:
    """Every plot of the page; the first one, of the targets met, shows who won.

    Parameters
    ----------
    data : mapping
        Content of the page, as `page.page_data` returns it.
    """
    names = data["optimizers"]
    legend = [(name, style_of(place)[0], "line") for place, name in enumerate(names[:MOST_IN_LEGEND])]
    met = data["ecdf"]["all"]
    lines = {name: (data["evaluations"][: len(met[name])], met[name]) for name in names}
    evaluations = ("evaluations", "@x{0,0} evaluations")
    return [
        Picture(
            "ecdf",
            _plot("ecdf", lines, evaluations, ("fraction of targets met", "@y{0 %} of targets met")),
            targets_figure(lines),
            legend,
        ),
        Picture(
            "profile",
            _plot(
                "profile",
                dict.fromkeys(names, ([], [])),
                ("regret, in the problem's scale", "regret of at most @x"),
                ("fraction of runs", "@y{0 %} of runs"),
            ),
        ),
        Picture(
            "curves",
            _plot(
                "curves",
                dict.fromkeys(names, ([], [])),
                evaluations,
                ("regret (V)", "median @y V, quartiles @low … @high V"),
                True,
            ),
        ),
        Picture("ranks", _ranks(names)),
    ]


def _plot(
    name: str,
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    across: tuple[str, str],
    up: tuple[str, str],
    logarithmic: bool = False,
) -> dict[str, Any]:
    """A line for each optimiser; label and words of the pointer of both axes."""
    with extra("a report"):
        from bokeh.models import ColumnDataSource, CustomJSTickFormatter, DataRange1d, HoverTool, LogTicker
        from bokeh.plotting import figure

    plot = figure(
        height=400, x_axis_type="log", y_axis_type="log" if logarithmic else "linear",
        x_range=DataRange1d(only_visible=True),
        y_range=DataRange1d(only_visible=True, **({} if logarithmic else {"start": 0})),
        tools="pan,box_zoom,wheel_zoom,reset,save", active_drag="box_zoom",
        active_scroll=None, output_backend="svg", sizing_mode="stretch_width", min_border_right=16,
        background_fill_alpha=0, border_fill_alpha=0, outline_line_color=None, name=f"{name}:plot",
    )  # fmt: skip
    plain_axes(plot)
    plot.toolbar.logo = None
    plot.xaxis.axis_label, plot.yaxis.axis_label = across[0], up[0]
    for axis in (*plot.xaxis, *plot.yaxis) if logarithmic else plot.xaxis:
        axis.formatter = CustomJSTickFormatter(code=PLAIN_TICKS)
    if logarithmic:
        plot.yaxis.ticker = LogTicker(mantissas=[1, 2, 5], desired_num_ticks=6)
    glyphs = []
    for place, (optimizer, (x, y)) in reversed(list(enumerate(lines.items()))):  # the best above all others
        colour, dash = style_of(place)
        source = ColumnDataSource({"x": list(x), "y": list(y), "low": list(y), "high": list(y)})
        style: Any = {"line_width": NARROW if place else WIDE, "color": colour, "line_dash": dash}
        glyphs.append(plot.line("x", "y", source=source, name=f"{name}:{optimizer}", **style))
    for glyph in glyphs:
        words = f"<b>{escape(glyph.name.partition(':')[2])}</b><br>{across[1]}<br>{up[1]}"
        plot.add_tools(HoverTool(renderers=[glyph], tooltips=f"<div>{words}</div>", visible=False))
    return item_of(name, plot)


def _ranks(names: Sequence[str]) -> dict[str, Any]:
    """Mean ranks with half of the critical difference at either side, one row for each optimiser."""
    with extra("a report"):
        from bokeh.models import ColumnDataSource, DataRange1d, FactorRange, HoverTool
        from bokeh.plotting import figure

    plot = figure(
        height=120, y_range=FactorRange(factors=list(names), name="ranks:rows"),
        x_range=DataRange1d(range_padding=0.05),
        tools="save", output_backend="svg", sizing_mode="stretch_width", name="ranks:plot", toolbar_location=None,
        background_fill_alpha=0, border_fill_alpha=0, outline_line_color=None, min_border_right=16,
    )  # fmt: skip
    plain_axes(plot)
    columns = {"name": list(names), "rank": [1.0] * len(names), "low": [1.0] * len(names), "high": [1.0] * len(names)}
    source = ColumnDataSource({**columns, "colour": ["#000000"] * len(names)}, name="ranks:source")
    plot.segment("low", "name", "high", "name", source=source, color="#666666", line_width=1.5)
    dots = plot.scatter("rank", "name", source=source, color="colour", size=9)
    plot.add_tools(HoverTool(renderers=[dots], tooltips="<div>@name: @rank{0.00}</div>", visible=False))
    plot.xaxis.axis_label = "mean rank"
    return item_of("ranks", plot)


def targets_figure(lines: Mapping[str, tuple[Sequence[float], Sequence[float]]]) -> Figure:
    """Fraction of targets met by number of evaluations, the winner's line the widest, without a browser."""
    figure, axes = plotting.new_figure(9.0, 4.2)
    for place, (optimizer, (x, y)) in reversed(list(enumerate(lines.items()))):
        colour, dash = style_of(place)
        label = optimizer if place < MOST_IN_LEGEND else None
        style: Any = {"color": colour, "ls": dash, "lw": 1.1 if place else 2.6, "label": label}
        axes.plot(x, y, **style)
    axes.set_ylim(bottom=0)
    axes.set(xscale="log", xlabel="evaluations", ylabel="fraction of targets met")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside upper center", ncols=5, frameon=False)
    return figure
