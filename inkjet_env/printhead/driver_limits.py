"""What an amplifier or a print controller can do, and where a waveform asks for more."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from inkjet_env.naming import nearest_name
from inkjet_env.typing import Real

PARAMETER_NAMES = ("U1", "U2", "t1", "t2", "t3", "t4", "t5")
MOST_BITS = 32
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
        Largest slew rates up and down, in volts per microsecond; above 0.
    step_us : float
        Time step in microseconds on which every corner must lie; 0 for none.
    shortest_us, longest_us : float
        Shortest segment, and longest waveform, in microseconds.
    bits : int
        Resolution of the driver's digital-to-analog converter: every corner's voltage is a multiple of the range from
        ``lowest_V`` to ``highest_V``, which must be finite, over ``2**bits``; 0 for none.

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
    bits: int = 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, (int, float)) or math.isnan(value):
                raise ValueError(f"{field.name} must be a number; got {value!r}.")
            if value < 0 and field.name not in ("lowest_V", "highest_V"):
                raise ValueError(f"{field.name} must be at least 0; got {value:g}.")
        for name in ("rise_V_per_us", "fall_V_per_us", "longest_us"):
            if getattr(self, name) == 0:
                raise ValueError(f"{name} must be above 0; got 0. Leave it out if there is no such limit.")
        if self.bits > MOST_BITS or self.bits != int(self.bits):
            raise ValueError(f"bits must be a whole number of at most {MOST_BITS}; got {self.bits:g}.")
        object.__setattr__(self, "bits", int(self.bits))
        if self.bits and not math.isfinite(self.highest_V - self.lowest_V):
            raise ValueError("bits need the converter's range: give lowest_V and highest_V too.")
        if not self.lowest_V < self.highest_V:
            raise ValueError(f"lowest_V must be below highest_V; got {self.lowest_V:g} and {self.highest_V:g}.")

    @property
    def step_V(self) -> float:
        """Step of the converter in volts; 0 for none."""
        return (self.highest_V - self.lowest_V) / 2**self.bits if self.bits else 0.0

    def as_json(self) -> dict[str, float]:
        """The limits that there are, by name."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}

    @classmethod
    def from_values(cls, values: Mapping[str, str | float]) -> DriverLimits:
        """Limits from values by name; ``ValueError`` names what is unknown or no number."""
        known = [field.name for field in fields(cls)]
        found: dict[str, Any] = {}
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
        if self.step_V > 0:
            off_V = np.abs(volts - self.step_V * np.rint(volts / self.step_V))
            k = int(np.argmax(off_V))
            if off_V[k] > 1e-6 * self.step_V:
                told.append(f"goes to {volts[k]:.6g} V; the driver's voltages are multiples of {self.step_V:.6g} V.")
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

    def within(self, low: Real, high: Real) -> tuple[Real, Real]:
        """Ends of the part of a search box in which a driver's waveforms lie.

        Parameters
        ----------
        low, high : ndarray, shape (7,)
            Ends of the box, in volts and seconds, order ``U1 U2 t1 t2 t3 t4 t5``.

        Returns
        -------
        low, high : ndarray, shape (7,)
            The same, on the driver's steps. The waveform with the least voltages and durations is legal.

        Raises
        ------
        ValueError
            No waveform of the box is within the limits; the sentence says what excludes them.
        """
        if not self.lowest_V <= 0 <= self.highest_V:
            raise ValueError(
                f"a waveform starts and ends at 0 V, which a driver from {self.lowest_V:g} to {self.highest_V:g} V "
                "cannot give."
            )
        step_s = 1e-6 * self.step_us
        least, most = np.array(low), np.array(high)
        for k in range(7):
            bottom, top = (self.lowest_V, self.highest_V) if k < 2 else (1e-6 * self.shortest_us, math.inf)
            step = self.step_V if k < 2 else step_s
            least[k], most[k] = _up(max(low[k], bottom), step), -_up(-min(high[k], top), step)
        needed = least.copy()
        for k, volts, V_per_us in (
            (2, least[0], self.rise_V_per_us),
            (4, least[0] - most[1], self.fall_V_per_us),
            (6, -most[1], self.rise_V_per_us),
        ):
            needed[k] = max(needed[k], _up(1e-6 * volts / V_per_us, step_s))
        for k, name in enumerate(PARAMETER_NAMES):
            unit = "V" if k < 2 else "s"
            if needed[k] > most[k] + SLACK * abs(most[k]):
                raise ValueError(
                    f"no {name} of the search box, {low[k]:g} to {high[k]:g} {unit}, is within the driver's limits: "
                    f"the least that it can do is {needed[k]:.6g} {unit}. Widen the box, or leave out a limit."
                )
        total_us = 1e6 * float(needed[2:].sum())
        if total_us > self.longest_us * (1 + SLACK):
            raise ValueError(
                f"the shortest waveform of the search box lasts {total_us:.6g} us, longer than longest_us, "
                f"{self.longest_us:g}. Lower the box's durations, or raise longest_us."
            )
        return least, most

    def made_legal(self, waveforms: Real, low: Real, high: Real) -> Real:
        """Legal waveforms in place of any, as `Bounds` describes them.

        Parameters
        ----------
        waveforms : ndarray, shape (7,) or (n, 7)
            Waveforms of the search box, in volts and seconds.
        low, high : ndarray, shape (7,)
            What `within` returned for that box.

        Returns
        -------
        ndarray, same shape
            The legal ones; a row does not depend on the others.
        """
        from inkjet_env.printhead.compiled_limits import make_legal

        legal = np.array(waveforms, dtype=np.float64)
        make_legal(
            np.atleast_2d(legal), low, high, 1e6 * self.rise_V_per_us, 1e6 * self.fall_V_per_us, self.step_V,
            1e-6 * self.step_us, 1e-6 * self.longest_us,
        )  # fmt: skip
        return legal


def _up(value: float, step: float) -> float:
    """The least multiple of a step that is not below a value but for rounding; the value itself if the step is 0."""
    return value if step == 0 else math.ceil(value / step - SLACK) * step
