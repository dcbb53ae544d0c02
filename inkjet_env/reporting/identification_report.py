"""The HTML report of an identification: the parameters, their uncertainty and the residuals.

`write_identification_report` writes one self-contained HTML file. From top to bottom: the result in words, a recording
with the model, what to do next, parameters; then, folded, hysteresis, ringing, spectrum, the residual of every
recording, settings.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.identification import Identification, ModelledRecording, NoiseModel
from inkjet_env.identification.fit import RESIDUAL
from inkjet_env.plant.wording import CHANNEL_WORDS
from inkjet_env.reporting import identification_figures as figures
from inkjet_env.reporting.diagnosis_figures import view_picture
from inkjet_env.reporting.formatting import hertz, interval_text, prefixed_unit, short, unit_text
from inkjet_env.reporting.identification_figures import Part, terms_of
from inkjet_env.reporting.page import PageFile, page_environment
from inkjet_env.reporting.plotting import svg_text
from inkjet_env.storage import json_text, write_atomically
from inkjet_env.typing import Real

EXPLAINED = 1.1
"""Largest ratio of residual to noise on held-out recordings at which the report says that the model explains them."""
MOST_REVERSALS = 60
"""Largest number of turning points of a drive whose loops can still be distinguished in a figure."""
SHORTEST_BRANCH = 0.2
"""Shortest branch that is drawn with the branch law, as a fraction of the recording's swing."""
PERIODS_SHOWN = 30
"""Periods of the resonance shown in a figure of the ringing."""
MOST_VIEWS = 3
DYNAMICS_UNITS = (("a0", "1/s²"), ("a1", "1/s"), ("b1", "1/s"))
"""Units of the dynamics by their symbols."""


def write_identification_report(
    path: str | os.PathLike[str], campaign_name: str, identification: Identification
) -> None:
    """Write the report atomically.

    Parameters
    ----------
    path : path
        Path of the HTML file; an existing file is replaced.
    campaign_name : str
        Name of the head in the report; any characters.
    identification : Identification
        The identification to report.

    Raises
    ------
    OSError
        The folder is missing or not writable.
    """
    write_atomically(path, identification_html(campaign_name, identification))


def identification_html(campaign_name: str, identification: Identification) -> str:
    """The report as HTML text."""
    environment = page_environment()
    parts = [part for recording in identification.recordings for part in terms_of(recording)]
    loops = loop_recordings(identification)
    rings = identification.printhead.has_dynamics
    main = main_recordings(identification)
    broadest = broadest_recording(main)
    views = ringing_views(main, identification.printhead.frequency_Hz) if rings else []
    shown = views[0] if views else Part(broadest, slice(0, broadest.measured.size), broadest.held_out)
    rising, falling = (measured_branches(identification, heading) for heading in (1, -1))
    return environment.get_template("identification.html").render(
        name=campaign_name,
        pictures=[view_picture("shows", shown.recording, {"base": shown.recording.modelled["base"]}, shown.samples)],
        shown=shown.recording,
        usable=not identification.warning,
        files=[
            PageFile("printhead.json", json_text(identification.as_json()), "the identified printhead"),
            PageFile("residuals.csv", residuals_csv(parts), "residual of every recording beside its noise"),
        ],
        headline=headline(identification),
        worst=worst_recording(parts),
        identification=identification,
        head=identification.printhead,
        gauge="strain_gauge" in identification.gains,
        parameters=parameter_rows(identification),
        coefficients=coefficient_rows(identification),
        loops=[(loop, svg_text(figures.loop_figure(loop))) for loop in loops],
        law=svg_text(figures.law_figure(identification, rising, falling)),
        degree=svg_text(figures.degree_figure(identification)),
        ringing=svg_text(figures.ringing_figure(views)) if rings else None,
        broadest=broadest,
        spectrum=svg_text(figures.spectrum_figure(broadest, noise_of(broadest, identification))),
        parts=parts,
        units={r.channel: r.unit for r in identification.recordings},
        scales={r.channel: prefixed_unit(r.noise_rms, r.unit) for r in identification.recordings[::-1]},
        explains=explains(identification),
        residuals=svg_text(figures.residuals_figure(parts)),
        explained=EXPLAINED,
    )


def residuals_csv(parts: Sequence[Part]) -> str:
    """Residual of each part of a recording beside its noise, as CSV."""
    lines = ["recording,channel,role,samples,unit,residual_rms,noise_rms"]
    for part in parts:
        own = part.recording
        size = part.samples.stop - part.samples.start
        name = '"' + own.name.replace('"', '""') + '"'
        lines.append(f"{name},{own.channel},{part.role},{size},{own.unit},{part.rms:.6g},{own.noise_rms:.6g}")
    return "\n".join(lines) + "\n"


def headline(identification: Identification) -> str:
    """That the head must not be used; or its resonance, if known, and how well it explains unseen recordings."""
    head = identification.printhead
    if identification.warning:
        return identification.warning[0].lower() + identification.warning[1:].removesuffix(".")
    found = "hysteresis alone, since no recording shows the resonance; "
    if head.has_dynamics:
        found = f"resonance {hertz(head.frequency_Hz)}, damping ratio {head.damping_ratio:.3g}; "
    held_out = bool(identification.heldout)
    whose = "held-out recordings" if held_out else "fitted recordings (none was held out)"
    pooled = {channel: identification.rms(channel, held_out) for channel in identification.gains}
    ratios = {channel: rms / noise for channel, (rms, noise) in pooled.items() if rms / noise >= 0}
    if not ratios:
        return found + f"how well the model explains the {whose} cannot be assessed, since their noise is unknown"
    worst = max(ratios, key=lambda channel: ratios[channel])
    mine = [r for r in identification.recordings if r.channel == worst and r.held_out == held_out]
    signal = math.sqrt(float(np.mean([np.var(r.measured[terms_of(r)[-1].samples]) for r in mine])))
    share = f"{100 * pooled[worst][0] / signal:.2g}\u00a0% of their signal" if signal > 0 else "all of their signal"
    theirs = whose if len(ratios) == 1 else f"{whose} of {CHANNEL_WORDS[worst]}"
    if any(m.source == RESIDUAL for (channel, _), m in identification.noise.items() if channel == worst):
        return found + (
            f"the model leaves a residual of {share} in the {theirs}; whether that is noise cannot be decided, since "
            "their noise is known from the fit alone"
        )
    if ratios[worst] > EXPLAINED:
        return found + (
            f"the model does not explain the {theirs}: its residual there is {ratios[worst]:.3g} times their noise, "
            f"{share}"
        )
    loud = [channel for channel in identification.misfit if has_unexplained_residual(identification, channel)]
    if loud:
        misfits = " and ".join(f"{identification.misfit[c]:.3g} times that of {CHANNEL_WORDS[c]}" for c in loud)
        return found + (
            f"the model's residual is {ratios[worst]:.2f} times the noise in the {whose}, yet it has structure in the "
            f"fitted ones: whitened, it is {misfits}"
        )
    return found + f"the model explains the {whose} to {ratios[worst]:.2f} times their noise"


def explains(identification: Identification) -> bool:
    """Whether the model explains the held-out recordings (the fitted ones if there are none) to within their noise.

    Where their noise is known from the fit alone, that cannot be decided, and nothing speaks against the model.
    """
    held_out = bool(identification.heldout)
    known = {channel for (channel, _), noise in identification.noise.items() if noise.source != RESIDUAL}
    pooled = (identification.rms(channel, held_out) for channel in identification.gains if channel in known)
    return not any(rms > EXPLAINED * noise for rms, noise in pooled) and not any(
        has_unexplained_residual(identification, channel) for channel in identification.misfit if channel in known
    )


def has_unexplained_residual(identification: Identification, channel: str) -> bool:
    """Whether a note says that the model does not explain a channel."""
    return any(note.startswith(f"{channel}: the residual is") for note in identification.notes)


def worst_recording(parts: Sequence[Part]) -> Part | None:
    """The part with the largest ratio of residual to noise; None if no noise is known."""
    known = [part for part in parts if math.isfinite(part.over_noise)]
    return max(known, key=lambda part: part.over_noise, default=None)


def loop_recordings(identification: Identification) -> list[ModelledRecording]:
    """The widest simple loop and the one with most nested loops, of the channel that shows the hysteresis.

    Empty for self-sensing, which measures the rate of the deflection. Drives with more than `MOST_REVERSALS` turning
    points are left out.
    """
    if identification.hysteresis_channel == "self_sensing":
        return []
    mine = [r for r in identification.recordings if r.channel == identification.hysteresis_channel]
    turns = {r.name: len(turning_points(r.drive_V)) for r in mine}
    mine = [r for r in mine if np.ptp(r.drive_V) > 0 and turns[r.name] <= MOST_REVERSALS]
    if not mine:
        return []
    widest = max(float(np.ptp(r.drive_V)) for r in mine)
    wide = [r for r in mine if np.ptp(r.drive_V) >= 0.9 * widest]
    first = min(wide, key=lambda r: (turns[r.name] < 2, turns[r.name], not r.held_out))
    nested = [r for r in mine if turns[r.name] > turns[first.name] + 2]
    return [first, *sorted(nested, key=lambda r: -turns[r.name])[:1]]


def measured_branches(identification: Identification, heading: int) -> tuple[Real, Real]:
    """Points measured on rising (1) or falling (-1) `branches`: ``x`` and the deviation from ``Q(x)``.

    The deviation is the recording's residual, so the resonator's contribution is removed as modelled. Empty for
    self-sensing.
    """
    law, channel = identification.printhead.branch_law, identification.hysteresis_channel
    at, off = [np.zeros(0)], [np.zeros(0)]
    for recording in identification.recordings:
        if recording.channel != channel or channel == "self_sensing" or np.ptp(recording.drive_V) == 0:
            continue
        drive, gain = recording.drive_V, identification.gains[channel].value
        for start, end in branches(drive):
            if heading * (drive[end] - drive[start]) > 0:
                moving = start + 1 + np.flatnonzero(np.diff(drive[start : end + 1]))
                at.append(np.abs(drive[moving] - drive[start]) / law.full_scale_V)
                off.append(heading * recording.residual()[moving] / (gain * law.full_scale_V))
    return np.concatenate(at), np.concatenate(off)


def branches(drive_V: Real) -> list[tuple[int, int]]:
    """First and last sample of the segments of drive that follow the branch law ``Q`` regardless of earlier history.

    The outermost turning point wipes out all memory. The branch that starts there follows ``Q``, and so does the next
    one until it returns to that level.
    """
    turns = turning_points(drive_V)
    level = np.abs(drive_V).max() * (1 - 1e-3)
    found, after_outermost = [], False
    for start, end in pairwise([*turns, drive_V.size - 1]):
        outermost = abs(drive_V[start]) >= level
        if (outermost or after_outermost) and abs(drive_V[end] - drive_V[start]) >= SHORTEST_BRANCH * np.ptp(drive_V):
            found.append((start, end))
        after_outermost = outermost
    return found


def turning_points(drive_V: Real) -> list[int]:
    """Indices of the samples at which the drive reverses."""
    moving = np.flatnonzero(np.diff(drive_V))
    up = drive_V[moving + 1] > drive_V[moving]
    return [int(k) for k in moving[1:][up[1:] != up[:-1]]]


def main_recordings(identification: Identification) -> list[ModelledRecording]:
    """Recordings with a varying drive on self-sensing, else on displacement, else on the strain gauge."""
    channel = next(c for c in ("self_sensing", "displacement", "strain_gauge") if c in identification.gains)
    return [r for r in identification.recordings if r.channel == channel and np.ptp(r.drive_V) > 0]


def ringing_views(fast: Sequence[ModelledRecording], frequency_Hz: float) -> list[Part]:
    """Segments of ringing to show: held-out pulses first, each drive once, around a long recording's steepest edge."""
    views: list[Part] = []
    drives: set[bytes] = set()
    for recording in sorted(fast, key=lambda r: (not r.held_out, not _pulsed(r), -np.ptp(r.drive_V))):
        if recording.drive_V.tobytes() in drives:
            continue
        drives.add(recording.drive_V.tobytes())
        most = max(round(PERIODS_SHOWN / (frequency_Hz * recording.step_s)), 60)
        for part in terms_of(recording):
            first, last = part.samples.start, part.samples.stop
            steepest = first + int(np.argmax(np.abs(np.diff(recording.drive_V[part.samples]))))
            if last - first > most:
                first = min(max(first, steepest - most // 10), last - most)
            views.append(Part(recording, slice(first, min(first + most, last)), part.held_out))
    return views[:MOST_VIEWS]


def _pulsed(recording: ModelledRecording) -> bool:
    return bool(np.mean(np.diff(recording.drive_V) == 0) > 0.5)


def broadest_recording(fast: Sequence[ModelledRecording]) -> ModelledRecording:
    """The recording whose drive has the broadest spectrum; among similar ones a held-out one, then the strongest."""
    width = {}
    for recording in fast:
        frequency, density = figures.amplitude_densities(recording, recording.drive_V)
        below = np.cumsum(density**2) / np.sum(density**2)
        first, last = np.searchsorted(below, (0.05, 0.95))
        width[recording.name] = frequency[last] - frequency[first]
    broad = [r for r in fast if width[r.name] >= 0.9 * max(width.values())]
    return max(broad, key=lambda r: (r.held_out, np.ptp(r.drive_V)))


def noise_of(recording: ModelledRecording, identification: Identification) -> NoiseModel | None:
    """The noise model of a recording's channel at the nearest sampling step; None if the channel has none."""
    known = {step: model for (channel, step), model in identification.noise.items() if channel == recording.channel}
    if not known:
        return None
    return known[min(known, key=lambda step: abs(math.log(step / recording.step_s)))]


def parameter_rows(identification: Identification) -> list[tuple[str, str, str, str, str]]:
    """Symbol, value, 90 % interval, unit and meaning of every parameter except the branch law's coefficients."""
    given = {recording.channel: recording.unit for recording in identification.recordings}
    units = {channel: unit_text(unit) for channel, unit in given.items()}
    if identification.printhead.has_dynamics:
        rows = _dynamics_rows(identification)
    else:
        why = "not known: no recording shows the resonance"
        rows = [(name, identification.dynamics[name], unit, why) for name, unit in DYNAMICS_UNITS]
    for channel, gain in identification.gains.items():
        if channel != "self_sensing":  # whose gain is b1
            rows.append(("gain", gain, f"{units[channel]}/V", f"{CHANNEL_WORDS[channel]}: per hysteretic volt"))
    table = [(symbol, *interval_text(estimate), unit, meaning) for symbol, estimate, unit, meaning in rows]
    for channel, offset in identification.offsets.items():
        size, unit = prefixed_unit(offset, given[channel])
        table.append(("offset", short(offset / size), "", unit, CHANNEL_WORDS[channel]))
    return table


def _dynamics_rows(identification: Identification) -> list[tuple[str, Estimate, str, str]]:
    """Symbol, value with its interval, unit and meaning of the dynamics."""
    a0, a1 = identification.dynamics["a0"], identification.dynamics["a1"]
    turns = 2 * math.pi
    b1 = "gain of self-sensing" + ("" if "self_sensing" in identification.gains else ": not observed, set to √a0")
    size, unit = (1e3, "kHz") if math.sqrt(a0.value) >= 1e3 * turns else (1.0, "Hz")
    frequency = Estimate(*(math.sqrt(v) / turns / size for v in (a0.value, a0.low, a0.high)))
    # ln ζ = ln a1 - ln(a0) / 2 - ln 2; ringing determines its frequency and its decay independently.
    spread = math.hypot(math.log(a1.high / a1.low), math.log(a0.high / a0.low) / 2) / 2
    zeta = identification.printhead.damping_ratio
    damping = Estimate(zeta, zeta * math.exp(-spread), zeta * math.exp(spread))
    return [
        ("f0", frequency, unit, "resonance, √a0 / 2π"),
        ("ζ", damping, "", "damping ratio, a1 / (2 √a0)"),
        ("a0", a0, "1/s²", "coefficient of G(s) = b1 s / (s² + a1 s + a0)"),
        ("a1", a1, "1/s", "coefficient of the same G(s)"),
        ("b1", identification.dynamics["b1"], "1/s", b1),
    ]


def coefficient_rows(identification: Identification) -> list[tuple[int, str, str]]:
    """Power, coefficient and standard error, highest power first."""
    errors = np.sqrt(np.diag(identification.coefficient_covariance))
    coefficients = identification.printhead.branch_law.ascending[1:]
    rows = [
        (k + 1, *interval_text(Estimate(c, c - e, c + e))[:1], short(e))
        for k, (c, e) in enumerate(zip(coefficients, errors, strict=True))
    ]
    return rows[::-1]
