"""Checks for suspicious recordings in a campaign that can be read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from inkjet_env.printhead import nearest_name
from inkjet_env.recordings.campaign import Campaign, Source
from inkjet_env.recordings.recording import EXCITATIONS, Recording, brief
from inkjet_env.typing import Real

LARGEST_DRIVE_V = 100.0
"""Rated drive of the ceramic, in volts; a warning above it."""
UNREAL_DRIVE_V = 1000.0
"""Drive in volts above which the unit must be wrong; an error."""
SMALLEST_DRIVE_V = 1.0
"""Largest magnitude of a drive, in volts, below which the unit may be wrong; a warning."""
FEWEST_SAMPLES_A_PERIOD = 10
"""Smallest number of samples per period of the head's resonance; a warning below it."""
SHORTEST_FLAT_TOP = 4
"""Smallest number of equal samples at the maximum that may be clipping."""
SLOWEST_RATES_Hz = {"self_sensing": 20e3, "displacement": 100.0, "strain_gauge": 0.1}
"""Sampling rates of each channel, in hertz, below which there is a warning."""
UNREAL_RATES_Hz = {"self_sensing": 100.0, "displacement": 0.1, "strain_gauge": 0.1}
"""Sampling rates of each channel, in hertz, below which the unit of the times must be wrong; an error."""
FASTEST_RATE_Hz = 1e12
"""Sampling rate in hertz above which the unit of the times must be wrong; an error."""


@dataclass(frozen=True)
class Finding:
    """A doubt about a recording that should be resolved before the campaign is used.

    Parameters
    ----------
    level : {"error", "warning"}
        An error is an impossible unit: nothing should be concluded from the recording. A warning may be harmless.
    recording : str
        Name of the recording.
    file : str
        File of the recording.
    row : int or None
        Row of the file, counted from 1; None if the finding concerns the whole file.
    message : str
        The rule, the value found, and the likely fix.
    """

    level: str
    recording: str
    file: str
    row: int | None
    message: str

    def __str__(self) -> str:
        return f"{self.file}{f', row {self.row}' if self.row else ''}: {self.message}"


def check_campaign(campaign: Campaign, frequency_Hz: float | None = None) -> list[Finding]:
    """List what is suspicious about the recordings of a campaign.

    The checks find clipped sensors and monitors, drives beyond ±100 V, drives and times in a wrong unit, monitors out
    of scale, too few samples per period, and recordings that are not the repeats they claim to be.

    Parameters
    ----------
    campaign : Campaign
        Recordings to check.
    frequency_Hz : float, optional
        Resonance of the head, if it is known.

    Returns
    -------
    list of Finding
        Findings in the order of the recordings; empty if there are none.

    Raises
    ------
    ValueError
        ``frequency_Hz`` is not a positive number.
    """
    if frequency_Hz is not None and not 0 < frequency_Hz < math.inf:
        raise ValueError(f"frequency_Hz must be a positive number; got {frequency_Hz:g} Hz.")
    return [
        Finding(level, recording.name, source.file, None if k is None else source.first_row + k, message)
        for recording in campaign.recordings
        for source in [campaign.sources.get(recording.name, Source(f"{recording.name}.csv"))]
        for level, k, message in (
            *_label_doubts(recording, campaign),
            *_drive_doubts(recording),
            *_time_doubts(recording, frequency_Hz),
            *_clipping_doubts(recording),
        )
    ]


# A doubt is a level, a sample counted from 0 (None for the whole recording), and a message.
Doubts = Iterator[tuple[str, int | None, str]]


def _label_doubts(recording: Recording, campaign: Campaign) -> Doubts:
    if recording.excitation not in EXCITATIONS:
        yield (
            "warning",
            None,
            f"excitation {brief(recording.excitation)} is not one of {', '.join(EXCITATIONS)}."
            f"{nearest_name(recording.excitation[:60], EXCITATIONS)}",
        )
    if recording.repeat_of is not None:
        first = campaign[recording.repeat_of]
        if recording.channel != first.channel or not _same_drive(recording, first):
            yield (
                "warning",
                None,
                f"repeats {first.name}, but has another channel, sampling or drive. Correct repeat_of: noise is "
                "estimated from repeats.",
            )


def _same_drive(one: Recording, other: Recording) -> bool:
    if len(one.drive_V) != len(other.drive_V) or abs(one.step_s / other.step_s - 1) > 1e-6:
        return False
    return bool(np.max(np.abs(one.drive_V - other.drive_V)) <= 0.01 * np.max(np.abs(other.drive_V)))


def _drive_doubts(recording: Recording) -> Doubts:
    size_V = np.abs(recording.drive_V)
    largest_V = float(np.max(size_V))
    if largest_V > LARGEST_DRIVE_V:
        yield (
            "error" if largest_V > UNREAL_DRIVE_V else "warning",
            int(np.argmax(size_V > LARGEST_DRIVE_V)),
            f"drive_V should be within ±{LARGEST_DRIVE_V:g} V; it goes to {largest_V:g} V. "
            "Check the unit, volts, and the head's limit.",
        )
    elif 0 < largest_V < SMALLEST_DRIVE_V:
        yield (
            "warning",
            int(np.argmax(size_V)),
            f"drive_V is at most {largest_V:g} V, where tens of volts are usual. Check the unit: kilovolts, or the "
            "generator's level before the amplifier?",
        )
    if recording.drive_monitor_V is not None and largest_V > 0:
        ratio = float(np.ptp(recording.drive_monitor_V) / max(np.ptp(recording.drive_V), np.finfo(float).tiny))
        if not 1 / 3 < ratio < 3:
            yield (
                "warning",
                None,
                f"drive_monitor_V has {ratio:.3g} times the drive's range. Check the probe's attenuation and the unit.",
            )


def _time_doubts(recording: Recording, frequency_Hz: float | None) -> Doubts:
    rate_Hz = recording.sample_rate_Hz
    hint = "Check the unit, seconds: microseconds or milliseconds?"
    if rate_Hz < SLOWEST_RATES_Hz[recording.channel]:
        unreal = rate_Hz < UNREAL_RATES_Hz[recording.channel]
        low = f"implausibly low for channel {recording.channel}"
        if recording.channel == "displacement" and not unreal:
            low = "too low for a displacement to show the resonance; slow loops and steps show the hysteresis alone"
        yield "error" if unreal else "warning", None, f"the sample rate of {rate_Hz:.4g} Hz is {low}. {hint}"
    elif rate_Hz > FASTEST_RATE_Hz:
        yield "error", None, f"the sample rate of {rate_Hz:.4g} Hz is implausibly high. {hint}"
    elif frequency_Hz is not None and recording.channel != "strain_gauge":
        samples = rate_Hz / frequency_Hz
        if samples < FEWEST_SAMPLES_A_PERIOD:
            yield (
                "warning",
                None,
                f"{samples:.3g} samples a period of {frequency_Hz:.4g} Hz; at least {FEWEST_SAMPLES_A_PERIOD} are "
                "needed. Sample faster, or check time_s's unit, seconds.",
            )


def _clipping_doubts(recording: Recording) -> Doubts:
    for label, values in (
        (recording.sensor_column, recording.sensor),
        ("drive_monitor_V", recording.drive_monitor_V),
    ):
        if values is None:
            continue
        for sign in (1.0, -1.0):
            top = _flat_top(sign * values)
            # While the drive is constant, a monitor and a slow sensor may rest at their extreme.
            follows = recording.channel == "strain_gauge" or label == "drive_monitor_V"
            if top is None or (follows and np.ptp(recording.drive_V[top]) == 0):
                continue
            yield (
                "warning",
                top.start,
                f"{label} stays at its {'maximum' if sign > 0 else 'minimum'}, {values[top.start]:.6g}, for "
                f"{top.stop - top.start} samples: clipped? Check the instrument's range.",
            )


def _flat_top(values: Real) -> slice | None:
    """Longest run of samples exactly at the maximum, if clipping explains it and a smooth signal does not; else None.

    A coarsely digitised smooth peak is flat too, but hardly longer on its highest level than on the next one; a clipped
    peak is. A signal that rests at its maximum before or after is not clipped.
    """
    at_top = values == np.max(values)
    below = values[~at_top]
    if at_top[0] or at_top[-1] or len(below) == 0:
        return None
    edges = np.flatnonzero(np.diff(at_top.astype(np.int8)))
    starts, stops = edges[::2] + 1, edges[1::2] + 1
    k = int(np.argmax(stops - starts))
    if stops[k] - starts[k] < SHORTEST_FLAT_TOP or at_top.sum() < 4 * np.sum(below == np.max(below)):
        return None
    return slice(int(starts[k]), int(stops[k]))
