"""Location of the base model's repeatable residual power."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, eq=False)
class Location:
    """Location of the base model's repeatable residual power; empty if the verdict is "none".

    Attributes
    ----------
    recordings : tuple of str
        Names of the recordings whose residuals exceed the noise significantly, strongest first.
    time_s, frequency_Hz, drive_V : tuple of (low, high)
        Intervals of time from a recording's start, of frequency, and of the recordings' largest drive: all in which the
        residuals exceed the noise, with the largest surplus power first. Times of recordings with another channel or
        sampling step are intervals of their own.
    sentence : str
        The location in words.
    tables : dict of str to tuple of rows
        For each view (time, frequency, amplitude, slope, sign, pulse, order, distortion, …), for the report: rows of
        (label, power relative to noise, standard deviations z).
    by_recording : dict of str to (time_s, frequency_Hz)
        The same intervals for each of ``recordings`` by itself, if it has any.
    """

    recordings: tuple[str, ...] = ()
    time_s: tuple[tuple[float, float], ...] = ()
    frequency_Hz: tuple[tuple[float, float], ...] = ()
    drive_V: tuple[tuple[float, float], ...] = ()
    sentence: str = "No residual exceeds the noise significantly."
    tables: Mapping[str, tuple[tuple[str, float, float], ...]] = field(default_factory=dict)
    by_recording: Mapping[str, tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]]] = field(
        default_factory=dict
    )
