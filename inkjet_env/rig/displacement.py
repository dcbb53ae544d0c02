"""Laser vibrometer: position of the head, ``b0 / (s² + a1 s + a0)`` on the hysteretic drive, in micrometres."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.rig.converter import Converter
from inkjet_env.rig.noise import Noise
from inkjet_env.typing import Real


@dataclass(frozen=True)
class Vibrometer:
    """A vibrometer with a displacement decoder.

    Parameters
    ----------
    um_per_V : float
        Static deflection per hysteretic volt, ``b0 / a0``. 2 nm/V: a piezo diaphragm moves 0.1 … 0.2 µm at 50 … 100 V.
    offset_um : float
        Reading of the decoder when the head is demagnetised and at rest.
    noise_um_per_rtHz, noise_bandwidth_Hz : float
        Density and bandwidth of the white noise. 0.1 pm/√Hz through 10 MHz, which is 0.3 nm RMS: a laser Doppler
        vibrometer on a good surface.
    range_um : float or None
        ± range of the decoder; None lets `fitted_to` choose it.
    bits : int or None
        Resolution of its digitiser, 16; None is without steps.
    """

    um_per_V: float = 2e-3
    offset_um: float = 0.01
    noise_um_per_rtHz: float = 1e-7
    noise_bandwidth_Hz: float = 10e6
    range_um: float | None = None
    bits: int | None = 16

    def __post_init__(self) -> None:
        if not (math.isfinite(self.um_per_V) and self.um_per_V != 0 and math.isfinite(self.offset_um)):
            raise ValueError(
                f"um_per_V must be finite and not 0, offset_um finite; got {self.um_per_V!r} and {self.offset_um!r}."
            )

    @property
    def converter(self) -> Converter:
        """Converter of the digitiser; ``ValueError`` before a range is chosen."""
        if self.range_um is None:
            raise ValueError("range_um must be set before recording. Give it, or use fitted_to(largest_V).")
        return Converter(-self.range_um, self.range_um, self.bits)

    @property
    def noise(self) -> Noise:
        """White noise, in µm."""
        return Noise(self.noise_um_per_rtHz, self.noise_bandwidth_Hz)

    def signal_um(self, deflection_V: ArrayLike) -> Real:
        """Position in µm, without noise and steps, of a deflection in volts (see `answer.deflection_V`), same shape."""
        return self.um_per_V * np.asarray(deflection_V, dtype=np.float64) + self.offset_um

    def fitted_to(self, largest_V: float) -> Vibrometer:
        """The vibrometer with a range a quarter wider than deflections of ``±largest_V`` need; a given range stays."""
        if self.range_um is not None:
            return self
        return replace(self, range_um=1.25 * (abs(self.um_per_V) * largest_V + abs(self.offset_um)))
