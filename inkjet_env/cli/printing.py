"""Results of the commands, printed as tables and sentences on standard output."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

from inkjet_env.reporting.tables import print_table

NEGLIGIBLE = 1e-4
"""Fraction of the largest peak below which a tail of peaks is not listed."""

if TYPE_CHECKING:
    from inkjet_env.identification import Identification
    from inkjet_env.jetting.figures_of_merit import Jetting
    from inkjet_env.mismatch import Diagnosis


def print_diagnosis(found: Diagnosis) -> None:
    """Print the verdict, effects with intervals, the fit before and after, candidates and the next experiment."""
    from inkjet_env.mismatch.headline import probabilities_text
    from inkjet_env.plant.registry import known_effects
    from inkjet_env.reporting.diagnosis_tables import channel_rows, parameter_rows
    from inkjet_env.reporting.formatting import explained_text, quantity_text

    parameters = [
        (e.effect.id, _without_unit(row[0]), *row[1:4])
        for e in (*found.effects, *found.minor)
        for row in parameter_rows(e)
    ]
    channels = channel_rows(found)
    print(found.headline)
    print(f"Probability of what is missing: {probabilities_text(found.probabilities)}.")
    if parameters:
        print_table(("effect", "parameter", "value", "90 % interval", "unit"), parameters)
    second = {"none": (), "unknown": ("closest", "closure")}.get(found.verdict, ("corrected", "closure"))
    fits = [
        (
            f"{row.label}, {row.role}",
            *(quantity_text(rms, row.unit) for rms in (row.noise, row.base)),
            *((quantity_text(row.augmented, row.unit), explained_text(row.closure)) if second else ()),
        )
        for row in channels
    ]
    print_table(("residual (RMS)", "noise", "base", *second), fits)
    for group in found.candidates:
        print(f"- These recordings cannot distinguish between: {', '.join(group)}.")
    print(f"- Location: {found.location.sentence}")
    if found.remainder is not None:
        print(f"- {found.remainder_sentence}")
    for experiment in found.next_experiments:
        print(f"- Next experiment: {experiment.sentence}")
    shown_by = {effect.id: effect.shown_by for effect in known_effects()}
    for effect_id, why in found.untestable.items():
        remedy = f" To test it, record {shown_by[effect_id]}." if effect_id in shown_by else ""
        print(f"- {effect_id} cannot be tested here, because {why}.{remedy}")
    for note in found.notes:
        print(f"- {note}")


def _without_unit(name: str) -> str:
    """A parameter's name in words; its unit, which the value may have with another prefix, has a column of its own."""
    return re.sub(r"(?<!_per)_(?:Hz|s|V)$", "", name).replace("_", " ")


def print_peaks(found: dict[str, Any]) -> None:
    """Print the peaks and the cost of a ``simulation/1``; of a tail that has died away only how long it is."""
    heights_V = [abs(v) for v in found["peaks_V"]]
    large = [i for i, v in enumerate(heights_V) if v >= NEGLIGIBLE * max(heights_V)]
    shown = large[-1] + 1 if large else 0
    peaks = zip(found["peak_times_s"][:shown], found["peaks_V"][:shown], strict=True)
    print_table(
        ("peak", "time (µs)", "response (V)", ""),
        [
            (str(i + 1), f"{t * 1e6:.3f}", f"{v:.4f}", "effective" if i == found["effective_peak"] else "")
            for i, (t, v) in enumerate(peaks)
        ],
    )
    if rest := heights_V[shown:]:
        print(f"{len(rest)} later peaks, the largest {max(rest):.2g} V")
    print(f"cost {found['cost']:.6f} V")


def print_figures(figures: Jetting) -> None:
    """Print when a single drop has settled, and how fast drops may follow."""
    if math.isnan(figures.effective_V):
        return
    print(
        f"Residual vibration of a single drop: {figures.residual_V:.4g} V, {100 * figures.residual:.3g} % of the "
        f"effective peak; {settling_text(figures)}."
    )


def settling_text(figures: Jetting) -> str:
    """When a single drop has settled, in words."""
    from inkjet_env.jetting.figures_of_merit import SETTLED

    level = f"{100 * SETTLED:g} %"
    if math.isinf(figures.settling_s):
        return f"not below {level} within the window"
    after = f"below {level} after {1e6 * figures.settling_s:.4g} µs"
    return f"{after}, so drops can follow at up to {figures.highest_Hz / 1e3:.4g} kHz"


def print_identification(name: str, found: Identification) -> None:
    """Print the verdict, the identified parameters with their intervals, the residuals beside the noise, all notes."""
    from inkjet_env.reporting.formatting import interval_text
    from inkjet_env.reporting.identification_report import headline

    print(f"{name}: {headline(found)}.")
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
    resonance = "Resonance unknown"
    if head.has_dynamics:
        resonance = f"Resonance {head.frequency_Hz / 1e3:.4g} kHz, damping ratio {head.damping_ratio:.4g}"
    print(
        f"{resonance}; branch law of degree {len(head.coefficients) - 1} with a full scale of {head.full_scale_V:g} V."
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


def print_evaluation(found: dict[str, Any], unit: str) -> None:
    """Print an ``evaluation/1``: the verdict, and each recording; its overall RMS has that unit."""
    print(found["sentence"])
    rows = []
    for name, entry in found["recordings"].items():
        noise = "–" if entry["noise_rms"] is None else f"{entry['noise_rms']:.4g}"
        values = (f"{entry['rms']:.4g}", noise, f"{entry['output_rms']:.4g}", entry["unit"])
        rows.append((name, *values, "differs" if entry["differs"] else ""))
    print_table(("recording", "residual (RMS)", "noise", "signal (RMS)", "unit", ""), rows)
    print(f"RMS of the main channel's residual: {found['rms']:.6g} {unit}")
