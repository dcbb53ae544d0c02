"""The figure of scans of one waveform on one or several heads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from inkjet_env.jetting import Curve, Scan
from inkjet_env.reporting.plotting import COLOURS, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_HEADS = 6
PANEL_INCHES = 3.3, 2.7
MOST_LEVELS = 12
"""Largest number of steps of a map's colours."""


def draw_scans(scans: Sequence[Scan]) -> Figure:
    """Effective peak and residual vibration against width, voltage and frequency, and a map for each head.

    Parameters
    ----------
    scans : sequence of Scan
        Scans of one waveform, at least one and at most `MOST_HEADS`.
    """
    columns = 2 if len(scans) == 1 else 3
    rows = 2 if len(scans) == 1 else 1 + -(-len(scans) // columns)
    width, height = PANEL_INCHES
    figure, axes = new_figure(columns * width, rows * height + 0.4, nrows=rows, ncols=columns, squeeze=False)
    if len(scans) == 1:
        curves, maps, spare = axes.ravel()[:3], axes.ravel()[3:], []
    else:
        below = axes[1:].ravel()
        curves, maps, spare = axes[0], below[: len(scans)], below[len(scans) :]
    width_us = 1e6 * scans[0].waveform.t2
    _draw_curves(curves[0], [s.width for s in scans], 1e6, "pulse width t2 (µs)", width_us)
    _draw_curves(curves[1], [s.voltage for s in scans], 1.0, "factor of the voltages", 1.0)
    _draw_curves(curves[2], [s.frequency for s in scans], 1e-3, "jetting frequency (kHz)")
    _draw_maps(maps, scans)
    for ax in spare:
        ax.set_visible(False)
    handles = [curves[0].plot([], [], color=COLOURS[k], label=s.head)[0] for k, s in enumerate(scans)]
    handles += [
        curves[0].plot([], [], color="black", label="effective peak")[0],
        curves[0].plot([], [], color="black", ls="--", label="residual vibration")[0],
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=min(len(handles), columns), frameon=False)
    return figure


def _draw_curves(ax: Axes, curves: Sequence[Curve], scale: float, label: str, mark: float | None = None) -> None:
    for curve, colour in zip(curves, COLOURS, strict=False):
        ax.plot(scale * curve.values, curve.effective_V, color=colour, lw=1.4)
        ax.plot(scale * curve.values, curve.residual_V, color=colour, lw=1.1, ls="--")
    if mark is not None:
        ax.axvline(mark, color="black", lw=0.8, ls=":")
    ax.set_xlim(left=0)
    ax.set_ylim(bottom=min(0.0, -0.02 * ax.get_ylim()[1]))  # a residual of 0 V stays visible
    ax.set(xlabel=label, ylabel="height (V)")


def _draw_maps(maps: Sequence[Axes], scans: Sequence[Scan]) -> None:
    """Change of the cost on each map, on one scale."""
    from matplotlib.ticker import MaxNLocator

    changes_V = [s.robustness.cost_V - s.robustness.middle_V for s in scans]
    lowest = min(float(change.min()) for change in changes_V)
    highest = max(float(change.max()) for change in changes_V)
    levels = MaxNLocator(MOST_LEVELS).tick_values(lowest, max(highest, lowest + 1e-6))
    for ax, one, change_V in zip(maps, scans, changes_V, strict=True):
        found = one.robustness
        percent = 100 * found.changes
        picture = ax.contourf(percent, percent, change_V, levels=levels, cmap="viridis")
        ax.plot(0, 0, "+", color="white", ms=9, mew=1.5)
        ax.set(xlabel=f"{found.names[0]} (%)", ylabel=f"{found.names[1]} (%)")
        title = f"cost {found.middle_V:.2f} V, up to {found.loss_V:.2f} V lost".replace("-", "−")
        ax.set_title(title if len(scans) == 1 else f"{one.head}\n{title}", fontsize=8.5)
        ax.grid(False)
    bar = maps[0].figure.colorbar(picture, ax=list(maps), label="change of the cost (V)")
    bar.ax.tick_params(labelsize=8)
