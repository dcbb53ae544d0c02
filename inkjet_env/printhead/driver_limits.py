"""What an amplifier or a print controller can do, and where a waveform asks for more."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from inkjet_env.naming import nearest_name
from inkjet_env.typing import Real

SLACK = 1e-9
"""Relative excess over a limit that is rounding."""


@dataclass(frozen=True)
class DriverLimits:
    """Limits of what drives a head; an infinite one is none.

    Attributes
    ----------
    lowest_V, highest_V : float
        Voltage range; a unipolar driver has a lowest or a highest voltage of 0.
    rise_V_per_us, fall_V_per_us : float
        Largest slew rates up and down, in volts per microsecond.
    step_us : float
        Time step in microseconds on which every corner must lie; 0 for none.
    shortest_us, longest_us : float
        Shortest segment, and longest waveform, in microseconds.

    Examples
    --------
    >>> limits = DriverLimits.from_text("lowest_V=0,highest_V=48,rise_V_per_us=20")
    >>> limits.excesses(np.array([0.0, 2e-6, 5e-6, 8e-6]), np.array([0.0, 42.0, 42.0, 0.0]))
    ['rises at 21 V/us from 0 us on; the driver can at most 20 V/us.']
    """

    lowest_V: float = -math.inf
    highest_V: float = math.inf
    rise_V_per_us: float = math.inf
    fall_V_per_us: float = math.inf
    step_us: float = 0.0
    shortest_us: float = 0.0
    longest_us: float = math.inf

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, (int, float)) or math.isnan(value):
                raise ValueError(f"{field.name} must be a number; got {value!r}.")
            if value < 0 and field.name not in ("lowest_V", "highest_V"):
                raise ValueError(f"{field.name} must be at least 0; got {value:g}.")
        if not self.lowest_V < self.highest_V:
            raise ValueError(f"lowest_V must be below highest_V; got {self.lowest_V:g} and {self.highest_V:g}.")

    @classmethod
    def from_values(cls, values: Mapping[str, str | float]) -> DriverLimits:
        """Limits from values by name; ``ValueError`` names what is unknown or no number."""
        known = [field.name for field in fields(cls)]
        found = {}
        for name, value in values.items():
            if name not in known:
                raise ValueError(
                    f"a driver has no limit {name[:40]!r}; there are {', '.join(known)}."
                    f"{nearest_name(name[:40], known)}"
                )
            try:
                found[name] = float(value)
            except ValueError:
                raise ValueError(f"{name} must be a number; got {str(value)[:40]!r}.") from None
        return cls(**found)

    @classmethod
    def from_text(cls, text: str) -> DriverLimits:
        """Limits from ``name=value,name=value``."""
        pairs = [part.partition("=") for part in text.split(",") if part.strip()]
        return cls.from_values({name.strip(): value.strip() for name, _, value in pairs})

    def excesses(self, time_s: Real, drive_V: Real) -> list[str]:
        """Where a waveform asks for more than the driver can, worst places only.

        Parameters
        ----------
        time_s, drive_V : ndarray, shape (n,)
            Corners of the waveform: times in seconds, increasing, and voltages.

        Returns
        -------
        list of str
            A sentence for each limit that is exceeded, without a subject; empty if none is.
        """
        time_us = np.asarray(time_s) * 1e6
        volts = np.asarray(drive_V)
        lasting_us, changes_V = np.diff(time_us), np.diff(volts)
        moving = (lasting_us > 0) | (changes_V != 0)  # a corner that is there twice is no segment
        lasting_us, changes_V = lasting_us[moving], changes_V[moving]
        time_us = np.append(time_us[:-1][moving], time_us[-1])
        with np.errstate(divide="ignore"):
            slews = changes_V / lasting_us
        told = []
        if volts.max() > self.highest_V + SLACK * max(abs(self.highest_V), 1.0):
            told.append(f"goes to {volts.max():.6g} V; the driver's highest voltage is {self.highest_V:g} V.")
        if volts.min() < self.lowest_V - SLACK * max(abs(self.lowest_V), 1.0):
            told.append(f"goes to {volts.min():.6g} V; the driver's lowest voltage is {self.lowest_V:g} V.")
        for slew, limit, word in ((slews, self.rise_V_per_us, "rises"), (-slews, self.fall_V_per_us, "falls")):
            k = int(np.argmax(slew))
            if slew[k] > limit * (1 + SLACK):
                told.append(
                    f"{word} at {slew[k]:.6g} V/us from {time_us[k]:.6g} us on; the driver can at most {limit:g} V/us."
                )
        k = int(np.argmin(lasting_us))
        if lasting_us[k] < self.shortest_us * (1 - SLACK):
            told.append(
                f"has a segment of {lasting_us[k]:.6g} us at {time_us[k]:.6g} us; the driver's shortest is "
                f"{self.shortest_us:g} us."
            )
        if self.step_us > 0:
            off_us = np.abs(time_us - self.step_us * np.rint(time_us / self.step_us))
            k = int(np.argmax(off_us))
            if off_us[k] > 1e-6 * self.step_us:
                told.append(
                    f"has a corner at {time_us[k]:.6g} us; the driver's corners lie on steps of {self.step_us:g} us."
                )
        length_us = float(time_us[-1] - time_us[0])
        if length_us > self.longest_us * (1 + SLACK):
            told.append(f"lasts {length_us:.6g} us; the driver's longest waveform lasts {self.longest_us:g} us.")
        return told
