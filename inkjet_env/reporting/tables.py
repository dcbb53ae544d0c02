"""Tables for people, on standard output."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from inkjet_env.identification import Identification

SIDE_BY_SIDE = 6
"""Problems that a ranking shows in columns of their own; more of them, and it tells of all together."""


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under headings: the first column at the left, the others at the right."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="right" if place else "left", no_wrap=place == 0)
    for row in rows:
        table.add_row(*row)
    Console(width=None if sys.stdout.isatty() else 160).print(table)


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """The same in Markdown."""
    lines = [" | ".join(headings), " | ".join(["---"] * len(headings)), *(" | ".join(row) for row in rows)]
    return "\n".join(f"| {line} |" for line in lines)


def print_peaks(found: dict[str, Any]) -> None:
    """Print the peaks and cost of a ``simulation/1``."""
    peaks = zip(found["peak_times_s"], found["peaks_V"], strict=True)
    print_table(
        ("peak", "time (µs)", "response (V)", ""),
        [
            (str(i + 1), f"{t * 1e6:.3f}", f"{v:.4f}", "effective" if i == found["effective_peak"] else "")
            for i, (t, v) in enumerate(peaks)
        ],
    )
    print(f"cost {found['cost']:.6f} V")


def print_ranking(ranking: Mapping[str, Any]) -> None:
    """Print the ranking of a ``ranking/1``, what may be concluded from it, and what was not compared."""
    from experiments.report import volts

    names = [problem["name"] for problem in ranking["problems"]]
    if len(names) <= SIDE_BY_SIDE:
        rows = [
            (
                one["optimizer"],
                f"{one['mean_rank']:.2f}",
                *(volts(one["problems"].get(name, {}).get("median_regret_V", math.nan)) for name in names),
            )
            for one in ranking["ranking"]
        ]
        print_table(("optimiser", "mean rank", *names), rows)
        print("Median regret in volts above the best known cost.")
    else:
        print_table(*standings_table(ranking["standings"][str(ranking["settings"]["budget"])]))
        print(f"Regret in the problems' scales, solved: within a hundredth of it; over all {len(names)} problems.")
    for sentence in ranking["sentences"]:
        print(f"- {sentence}")
    for name, reason in ranking["unavailable"].items():
        print(f"- Not compared: {name}: {reason}")


def standings_table(found: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows of one budget's standings in a ``ranking/1``."""

    def share(value: float | None) -> str:
        return "–" if value is None else f"{100 * value:.0f} %"

    def regret(value: float | None) -> str:
        return "–" if value is None else f"{value:.2f}" if value >= 0.1 else f"{value:.2g}"

    def ranged(entry: Mapping[str, float | None], written: Callable[[float | None], str]) -> str:
        low, high = entry["low"], entry["high"]
        ends = "" if low is None or high is None else f" ({written(low)} to {written(high)})"
        return written(entry["value"]) + ends

    rows: list[tuple[str, ...]] = [
        (
            row["optimizer"] + ("" if row["applies"] == found["problems"] else f" (on {row['applies']})"),
            f"{row['rank']:.2f}",
            ranged(row["quality"], regret),
            ranged(row["solved"], share),
            ranged(row["improvement"], share),
            "–" if (s := row["signed_rank"]) is None else ", ".join(share(s[k]) for k in ("first", "alike", "second")),
        )
        for row in found["rows"]
    ]
    return ("optimiser", "mean rank", "regret", "solved", "lower than pso", "over problems: better, alike, worse"), rows


def print_identification(name: str, found: Identification) -> None:
    """Print what was identified, with intervals, how well it fits, and what a reader must know."""
    from experiments.identification_report import interval_text

    head = found.printhead
    rows = [
        (label, *interval_text(estimate), unit)
        for label, estimate, unit in (
            ("a0", found.dynamics["a0"], "1/s²"),
            ("a1", found.dynamics["a1"], "1/s"),
            ("b1", found.dynamics["b1"], "1/s"),
            *(
                (f"gain of {channel}", gain, f"{found.unit(channel)} per hysteretic V")
                for channel, gain in found.gains.items()
                if channel != "self_sensing"
            ),
        )
    ]
    print_table((name, "value", "90 % interval", "unit"), rows)
    print(
        f"Resonance {head.frequency_Hz / 1e3:.4g} kHz, damping ratio {head.damping_ratio:.4g}; branch law of degree "
        f"{len(head.coefficients) - 1} on {head.full_scale_V:g} V."
    )
    rows = []
    for channel in found.gains:
        unit = found.unit(channel)
        for label, held_out in (("fitted", False), ("held out", True)):
            rms, noise = found.rms(channel, held_out)
            if rms == rms:
                rows.append((f"{channel}, {label}", f"{rms:.4g} {unit}", f"{noise:.4g} {unit}", f"{rms / noise:.3g}"))
    print_table(("residual (RMS)", "residual", "noise", "ratio"), rows)
    for note in found.notes:
        print(f"- {note}")


def print_evaluation(found: dict[str, Any]) -> None:
    """Print an ``evaluation/1``."""
    rows = [
        (name, f"{entry['rms']:.4g} {entry['unit']}", f"{entry['output_rms']:.4g} {entry['unit']}")
        for name, entry in found["recordings"].items()
    ]
    print_table(("recording", "residual (RMS)", "signal (RMS)"), rows)
    print(f"RMS of the fast channel's residual: {found['rms']:.6g}")
