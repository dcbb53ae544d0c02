"""Tables for people, on standard output."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from experiments.statistics import Summary
    from inkjet_env.identification import Identification


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


def print_ranking(
    summary: Summary, problems: Sequence[str], sentences: Sequence[str], unavailable: dict[str, str]
) -> None:
    """Print the ranking, what may be concluded from it, and what was not compared."""
    from experiments.report import volts

    rows = [
        (
            standing.optimizer,
            f"{standing.mean_rank:.2f}",
            *(
                volts(score.regret.value if (score := summary.score(standing.optimizer, name)) else math.nan)
                for name in problems
            ),
        )
        for standing in summary.standings
    ]
    print_table(("optimiser", "mean rank", *problems), rows)
    print("Median regret in volts above the best known cost.")
    for sentence in sentences:
        print(f"- {sentence}")
    for name, reason in unavailable.items():
        print(f"- Not compared: {name}: {reason}")


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
