"""Figures of a proof: detection against strength, confusion matrix, closures, waveform gains."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.experiments.proof.corpus import STAGES
from inkjet_env.experiments.validation.verdict_scores import OUTCOMES
from inkjet_env.reporting import plotting
from inkjet_env.reporting.zoomable import Line, Panel, Picture, stacked_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 5.4
RIGHT, WRONG, ABSTAINED = "#1b5e8c", "#b3541e", "#777777"
LEAST_SHADE, LEAST_WRONG = 0.2, 0.55
"""Lightest shade of a nonempty cell, and of a wrong one, so that single heads are visible."""
NOTHING_AT = 0.03
"""Position of strength 0 on the logarithmic axis."""


def curve_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Fractions detected and correctly named against strength, with 90 % intervals."""
    figure, axes = plotting.new_figure(WIDTH, 3.5)
    at = [row["rho"] if row["strength"] != "nothing" else NOTHING_AT for row in rows]
    for name, label, colour, mark in (
        ("detected", "detected", plotting.COLOURS[0], "o"),
        ("right", "right name or right set", plotting.COLOURS[1], "s"),
    ):
        shown = [(x, row[name]) for x, row in zip(at, rows, strict=True) if row[name] is not None]
        x = np.array([place for place, _ in shown]) * (1.0 if name == "detected" else 1.04)
        value, low, high = (np.array([100 * entry[key] for _, entry in shown]) for key in ("value", "low", "high"))
        axes.errorbar(
            x, value, [value - low, high - value], fmt=mark, color=colour, ms=5, capsize=3, lw=1.2, label=label
        )
        strong = x > 1.5 * NOTHING_AT
        axes.plot(x[strong], value[strong], color=colour, lw=1.2)
    axes.set(xscale="log", ylim=(-3, 103))
    axes.set_xticks(at, ["nothing\nconcealed" if x == NOTHING_AT else f"{x:.2g}" for x in at])
    axes.minorticks_off()
    axes.set_xlabel("strength ρ")
    axes.set_ylabel("fraction of heads (%)")
    figure.legend(loc="outside upper left", ncols=2, frameon=False)
    return figure


def curve_picture(rows: Sequence[Mapping[str, Any]]) -> Picture:
    """The same to zoom: fractions with the ends of their intervals, where the pointer is."""
    rows = sorted(rows, key=lambda row: float(row["rho"]))
    at = np.array([row["rho"] if row["strength"] != "nothing" else NOTHING_AT for row in rows])
    lines = []
    for name, label, colour in (
        ("detected", "detected", plotting.COLOURS[0]),
        ("right", "right name or right set", plotting.COLOURS[1]),
    ):
        for key, words, width, marks in (
            ("value", label, 1.6, False), ("value", label, 2.0, True),
            ("low", f"{label}, 90 % interval from", 0.0, False), ("high", f"{label}, to", 0.0, False),
        ):  # fmt: skip
            values = [math.nan if row[name] is None else 100 * row[name][key] for row in rows]
            if width and not marks:
                values = [
                    math.nan if row["strength"] == "nothing" else value for row, value in zip(rows, values, strict=True)
                ]
            if width or key != "value":
                lines.append(Line(words, np.array(values), colour, width, marks=marks))
    panel = Panel("fraction of heads (%)", "%", lines, 320)
    picture = stacked_picture("curve", at, "strength ρ", "", [panel], curve_figure(rows), x_scale="log")
    return replace(
        picture, legend=[entry for entry in picture.legend if "interval" not in entry[0] and ", to" not in entry[0]]
    )


def confusion_figure(table: Mapping[str, Mapping[str, int]]) -> Figure:
    """Confusion matrix of heads. Rows: concealed; columns: verdict. Blue: right, orange: wrong, grey: abstained."""
    rows = [name for name, counts in table.items() if sum(counts.values())]
    columns = list(next(iter(table.values())))
    ids = columns[: -len(OUTCOMES)]
    figure, axes = plotting.new_figure(max(8.6, 0.26 * len(columns) + 2), 1.9 + 0.235 * len(rows))
    share = np.array([[table[row][column] / sum(table[row].values()) for column in columns] for row in rows])
    image = np.ones((*share.shape, 3))
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            if share[i, j]:
                colour = _colour(row, column, ids)
                base = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
                least = LEAST_WRONG if colour == WRONG else LEAST_SHADE
                depth = least + (1 - least) * share[i, j]
                image[i, j] = 1 - depth * (1 - base)
                dark = depth > 0.5
                axes.text(
                    j, i, str(table[row][column]), ha="center", va="center", fontsize=7, color="w" if dark else "k"
                )
    axes.imshow(image, aspect="auto", interpolation="nearest")
    axes.set_xticks(
        range(len(columns)), [_words(c) for c in columns], rotation=60, ha="left", rotation_mode="anchor", fontsize=7.5
    )
    axes.set_yticks(range(len(rows)), [_words(r) for r in rows], fontsize=7.5)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.set_xticks(np.arange(len(columns) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(rows) + 1) - 0.5, minor=True)
    axes.grid(visible=True, which="minor", color="#dddddd", lw=0.5)
    axes.tick_params(which="minor", length=0)
    for edge in axes.spines.values():
        edge.set_visible(False)
    axes.axvline(len(ids) - 0.5, color="#444444", lw=0.8)
    if "nothing" in rows:
        axes.axhline(rows.index("nothing") + 0.5, color="#444444", lw=0.8)
    inside = sum(row == "nothing" or row in ids for row in rows)
    if inside < len(rows):
        axes.axhline(inside - 0.5, color="#444444", lw=0.8)
    axes.set_ylabel("concealed")
    axes.set_title("verdict", fontsize=9)
    return figure


def _colour(row: str, column: str, ids: Sequence[str]) -> str:
    if row == "nothing":
        return RIGHT if column == "none" else WRONG
    if row in ids:
        return RIGHT if column in (row, "set") else ABSTAINED if column in ("unknown", "none", "refused") else WRONG
    return RIGHT if column == "unknown" else ABSTAINED if column in ("none", "refused") else WRONG


def _words(name: str) -> str:
    return name.replace("_", " ")


def closures_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Closure on fresh drives by effect, one dot per head."""
    names = [name for name in STAGES if any(row["effect"] == name for row in rows)]
    figure, axes = plotting.new_figure(WIDTH, 1.3 + 0.2 * max(len(names), 4))
    for strength, colour, shift in (("strong", plotting.COLOURS[0], -0.14), ("medium", plotting.COLOURS[4], 0.14)):
        mine = [row for row in rows if row["strength"] == strength]
        x = [max(row["closure"], -0.5) for row in mine]
        y = [names.index(row["effect"]) + shift for row in mine]
        if mine:
            axes.plot(x, y, "o", color=colour, ms=4, alpha=0.8, mec="none", label=strength, clip_on=False)
    axes.axvline(0.9, color="#444444", lw=0.8, ls="--")
    axes.set_yticks(range(len(names)), [_words(name) for name in names], fontsize=7.5)
    axes.set(ylim=(len(names) - 0.5, -0.5), xlim=(-0.52, 1.02))
    axes.set_xlabel("closure on fresh drives")
    if rows:
        figure.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=8)
    return figure


def waveform_gain_figure(heads: Sequence[Mapping[str, Any]]) -> Figure:
    """Peak costs of the three waveforms on the concealed head, one line per head, the largest gain first."""
    order = sorted(heads, key=lambda head: head["oracle"] - head["base"])
    figure, axes = plotting.new_figure(WIDTH, 1.3 + 0.2 * max(len(order), 4))
    at = np.arange(len(order))
    base, augmented, oracle = (np.array([head[name] for head in order]) for name in ("base", "augmented", "oracle"))
    axes.hlines(at, np.minimum(base, oracle), np.maximum(base, oracle), color=plotting.GREY, lw=0.8)
    axes.plot(base, at, "o", color=plotting.COLOURS[1], mfc="white", ms=5, label="base model")
    axes.plot(augmented, at, "o", color=plotting.COLOURS[0], ms=4, label="corrected model")
    axes.plot(oracle, at, "|", color="#222222", ms=9, mew=1.6, label="oracle")
    axes.set_yticks(at, [_words(" + ".join(head["effects"])) for head in order], fontsize=7)
    axes.set(ylim=(len(order) - 0.4, -0.6))
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("peak cost on the concealed head (V; lower is better)")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False, fontsize=8)
    return figure
