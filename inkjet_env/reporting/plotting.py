"""The canvas of every figure: a new one, its colours and lines, and how it is written."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.extras import extra
from inkjet_env.storage import write_atomically
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER, GREY = "#b3541e", "#1b5e8c", "#888888"
STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "svg.hashsalt": "inkjet",
    "svg.fonttype": "path",
}
# Okabe and Ito's colours, which colour-blind readers can distinguish.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
SVG_DPI = 72
"""Pixels of an inch by which Matplotlib draws an SVG."""
MOST_POINTS = 3000
"""Largest number of points drawn for one line."""


def new_figure(width: float, height: float, **subplots: Any) -> tuple[Figure, Any]:
    """A new figure of ``width`` × ``height`` inches, not attached to a window, and its axes."""
    with extra("a figure"):
        import matplotlib as mpl
        from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure((width, height), layout="constrained")
        return figure, figure.subplots(**subplots)


def svg_text(figure: Figure) -> str:
    """The figure as an ``<svg>`` element; the same figure always gives the same text."""
    with extra("a figure"):
        import matplotlib as mpl
        from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer, engine = io.StringIO(), figure.get_layout_engine()
    with mpl.rc_context(STYLE):
        canvas, dpi = FigureCanvasSVG(figure), figure.dpi
        try:
            if engine is not None:  # laid out by `savefig`, it would be drawn twice
                figure.dpi = SVG_DPI
                engine.execute(figure)
                figure.set_layout_engine(None)
            canvas.print_figure(buffer, format="svg", metadata={"Date": None, "Creator": None})
        finally:
            figure.set_layout_engine(engine)
            figure.dpi = dpi
    text = buffer.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    return re.sub(r' xmlns(:xlink)?="[^"]*"', "", text)  # not needed within HTML


def check_picture_name(path: str | Path) -> None:
    """Raise ``ValueError`` unless the file name ends in .png, .svg or .pdf."""
    ending = Path(path).suffix.lower()
    if ending not in (".png", ".svg", ".pdf"):
        raise ValueError(f"{path}: a figure's name must end in .png, .svg or .pdf; got {ending or 'no ending'!r}.")


def write_picture(path: str | Path, figure: Figure) -> None:
    """Write a figure atomically as PNG, SVG or PDF, by the name's ending."""
    check_picture_name(path)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=Path(path).suffix.lower()[1:], dpi=160)
    write_atomically(path, buffer.getvalue())


def time_scale(span_s: float) -> tuple[float, str]:
    """The unit that suits a span of time: its length in seconds, and its symbol."""
    for seconds, unit in ((1.0, "s"), (1e-3, "ms")):
        if span_s >= 2 * seconds:
            return seconds, unit
    return 1e-6, "µs"


def draw_line(axes: Axes, x: Real, y: Real, **style: Any) -> None:
    """Draw a line of many points through the smallest and the largest value of each run of neighbours."""
    run = -(-2 * x.size // MOST_POINTS)
    if run > 2:
        rows = y[: y.size // run * run].reshape(-1, run)
        first = np.arange(len(rows)) * run
        kept = np.unique(np.concatenate([first + rows.argmin(axis=1), first + rows.argmax(axis=1), [y.size - 1]]))
        x, y = x[kept], y[kept]
    axes.plot(x, y, **style)
