"""Waveforms as print controllers take them: text in sections, one for each pulse, one line for each segment.

    [Pulse0]
    ; start V, end V, slew V/us, hold us
    Seg0 = 0, 42, 21, 3.5
    Seg1 = 42, 0, -14, 4

A segment goes from its start to its end voltage at a slew rate and holds the end voltage. Pulses follow each other in
the order of their numbers.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from inkjet_env.recordings.recording import CampaignError, brief
from inkjet_env.recordings.text_file import TextFile
from inkjet_env.storage import write_atomically
from inkjet_env.typing import Real

_SECTION = re.compile(r"\[\s*([A-Za-z]+)\s*(\d*)\s*\]")
_SEGMENT = re.compile(r"seg(?:ment)?\s*(\d+)\s*=\s*(.*)", re.IGNORECASE)
_COMMENT = re.compile(r"\s*[;#].*$")
_CHANGES = re.compile(r"[^=]*(scale|gain|factor|unit|invert|offset|repeat|count|times)[^=]*=", re.IGNORECASE)
"""Settings that would change the waveform."""
_MISSPELT = re.compile(r"s\w{0,6}\s*\d+\b|[^=]*=(\s*[-+\d.]+\s*,){3}", re.IGNORECASE)
"""What was surely meant as a segment."""
_FIELDS = ("start voltage", "end voltage", "slew rate", "hold time")
SAME_VOLTAGE_V = 1e-6
"""Largest difference in volts between the end of a segment and the start of the next."""
MICROSECOND = 1e-6


def is_segment_file(text: TextFile) -> bool:
    """Whether a text has sections with segments."""
    lines = [line.strip() for line in text.start]
    return any(_SECTION.fullmatch(line) for line in lines) and any(_SEGMENT.fullmatch(line) for line in lines)


def read_segments(text: TextFile) -> tuple[Real, Real]:
    """Corners of a waveform: times in seconds from 0 and voltages, shape (n,) each.

    Raises
    ------
    CampaignError
        A line that is no segment, segments that do not follow each other, a slew rate of the wrong sign or none where
        the voltage changes. The message names the row, the rule and a fix.
    """
    pulses: dict[int, dict[int, tuple[int, tuple[float, ...]]]] = {}
    pulse: int | None = None
    with text.lines() as lines:
        for row, line in enumerate(lines, start=1):
            content = _COMMENT.sub("", line).strip()
            if found := _SECTION.fullmatch(content):
                pulse = int(found.group(2) or 0) if found.group(1).lower() == "pulse" else None
                if pulse is None and found.group(1).lower().startswith("pul"):
                    raise CampaignError(f"{text.path}, row {row}: section {content[:40]} is not understood: [Pulse0]?")
            elif (found := _SEGMENT.fullmatch(content)) and pulse is not None:
                place = f"{text.path}, row {row}"
                segments = pulses.setdefault(pulse, {})
                if (number := int(found.group(1))) in segments:
                    raise CampaignError(f"{place}: segment {number} is there twice. Give each its own number.")
                segments[number] = row, _numbers(place, found.group(2))
            elif (
                _MISSPELT.match(content)
                or _CHANGES.match(content)
                or (pulse is not None and content and "=" not in content)
            ):
                raise CampaignError(
                    f"{text.path}, row {row}: {brief(content)} is no segment, Seg0 = start, end, slew, hold, and may "
                    "change the waveform. Correct it, or take it out."
                )
    ordered = [one for _, segments in sorted(pulses.items()) for _, one in sorted(segments.items())]
    if not ordered:
        raise CampaignError(f"{text.path}: has no [Pulse0] section with segments Seg0 = start, end, slew, hold.")
    time_us, corners = 0.0, [(0.0, ordered[0][1][0])]
    for row, (start_V, end_V, slew, hold_us) in ordered:
        place = f"{text.path}, row {row}"
        if abs(start_V - corners[-1][1]) > SAME_VOLTAGE_V:
            raise CampaignError(
                f"{place}: the segment must start at {corners[-1][1]:g} V, where the one before ended; got "
                f"{start_V:g} V. Correct it, or add a segment between."
            )
        change_V = end_V - start_V
        if change_V and not slew * change_V > 0 and not slew > 0:
            raise CampaignError(
                f"{place}: the slew rate must be {'above' if change_V > 0 else 'below'} 0 V/us from {start_V:g} V to "
                f"{end_V:g} V; got {slew:g}. Give volts in a microsecond."
            )
        if hold_us < 0:
            raise CampaignError(f"{place}: the hold time must be at least 0 us; got {hold_us:g}.")
        for last_us in (abs(change_V / slew) if change_V else 0.0, hold_us):
            if last_us:
                time_us += last_us
                corners.append((time_us, end_V))
    if len(corners) < 2:
        raise CampaignError(f"{text.path}: its segments take no time at all. Give rises or hold times above 0.")
    time, drive_V = np.array(corners).T
    return np.ascontiguousarray(time * MICROSECOND), np.ascontiguousarray(drive_V)


def _numbers(place: str, cells: str) -> tuple[float, ...]:
    values = []
    split = [cell.strip() for cell in cells.split(",")]
    if len(split) != len(_FIELDS):
        raise CampaignError(f"{place}: a segment has four numbers, {', '.join(_FIELDS)}; got {brief(cells)}.")
    for name, cell in zip(_FIELDS, split, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise CampaignError(f"{place}: the {name} must be a finite number; got {brief(cell)}. Correct it.")
        values.append(value)
    return tuple(values)


def write_segments(path: str | Path, time_s: Real, drive_V: Real) -> None:
    """Write `segments_text` to a file."""
    try:
        text = segments_text(time_s, drive_V)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    write_atomically(path, text)


def segments_text(time_s: Real, drive_V: Real) -> str:
    """The corners of a waveform as one pulse of segments.

    Parameters
    ----------
    time_s, drive_V : ndarray, shape (n,)
        Times in seconds, increasing, and voltages of the corners.

    Raises
    ------
    ValueError
        Two corners at one time with different voltages: a controller needs a slew rate.
    """
    lines = ["[generic]", "Version = 1", "", "[Pulse0]", "; start V, end V, slew V/us, hold us"]
    time_us = [float(f"{t / MICROSECOND:.12g}") for t in np.asarray(time_s).tolist()]
    volts = np.asarray(drive_V).tolist()
    number = k = 0
    while k + 1 < len(volts):
        start_V, end_V = volts[k], volts[k + 1]
        rise_us = time_us[k + 1] - time_us[k]
        if start_V != end_V and not rise_us > 0:
            raise ValueError(
                f"the drive jumps from {start_V:g} V to {end_V:g} V at {time_us[k]:g} us; a controller needs a "
                "rise time above 0."
            )
        slew, hold_us = (0.0, rise_us) if start_V == end_V else ((end_V - start_V) / rise_us, 0.0)
        k += 1
        while start_V != end_V and k + 1 < len(volts) and volts[k + 1] == end_V:
            hold_us += time_us[k + 1] - time_us[k]
            k += 1
        lines.append(f"Seg{number} = {start_V:.12g}, {end_V:.12g}, {slew:.17g}, {hold_us:.12g}")
        number += 1
    return "\n".join(lines) + "\n"
