"""Where repeatable residual power of the base model sits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, eq=False)
class Location:
    """Where repeatable residual power of the base model sits; empty where it sits nowhere.

    Attributes
    ----------
    recordings : tuple of str
        Those with significantly more than noise.
    time_s, frequency_Hz, drive_V : tuple of (low, high)
        Stretches.
    sentence : str
    tables : dict of str to tuple of rows
        Each view (time, frequency, amplitude, slope, sign, pulse, order, distortion): rows of (label, power over noise,
        z), for the report.
    """

    recordings: tuple[str, ...] = ()
    time_s: tuple[tuple[float, float], ...] = ()
    frequency_Hz: tuple[tuple[float, float], ...] = ()
    drive_V: tuple[tuple[float, float], ...] = ()
    sentence: str = "Nothing is left beyond the noise."
    tables: Mapping[str, tuple[tuple[str, float, float], ...]] = field(default_factory=dict)
