"""Strain-gauge rig for the hysteresis: bridge, amplifiers, converter (Zhu et al. 2024, section 3.1 and Fig. 4).

An active gauge on the ceramic and a dummy beside it are two arms of a Wheatstone bridge; two resistors and a
potentiometer are the others. The instrumentation amplifier's output is zeroed (U2A), amplified (U2B) and shifted into
the converter's range (U2D). All stages are linear, so the recorded voltage is ``gain × hysteretic drive + offset``. The
paper prints the circuit and 350 Ω; the other values are those of ordinary parts, each with its source below.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.rig.converter import Converter
from inkjet_env.rig.noise import Noise, thermal_density
from inkjet_env.typing import Real

STM32 = Converter(0.0, 3.3, 12)
"""Converter of an STM32 microcontroller: 0 … 3.3 V, 12 bits."""

FILL = 0.75
"""Share of the converter's half range that `StrainGauge.fitted_to` lets the signal fill."""


@dataclass(frozen=True)
class StrainGauge:
    """The strain-gauge rig.

    The nonlinearity of the bridge (half the relative change of resistance, 1e-4 of the reading) and the lag of the
    filter (0.2 % of the swing at 5 rad/s) are neglected.

    Parameters
    ----------
    strain_per_V : float
        Strain of the ceramic per hysteretic volt. 0.86e-6: d31 = −171 pm/V of PZT-5A across 0.2 mm.
    gauge_factor : float
        Relative change of resistance per strain. 2.1: constantan foil gauges.
    gauge_ohm : float
        Resistance of both gauges; 350 Ω in the paper. The source resistance of the bridge is the same.
    excitation_V : float
        Voltage across the bridge. 5 V is 18 mW per gauge.
    imbalance : float
        Relative difference of resistance between the arms that the potentiometer leaves. 50 ppm: a tenth of a turn of a
        ten-turn trimmer across 0.5 %.
    instrumentation_gain : float
        Gain of the instrumentation amplifier. 501: INA128, ``1 + 50 kΩ / R_G`` with 100 Ω.
    instrumentation_offset_V : float
        Offset at its input; 10 µV typical (INA128).
    zero_V : float
        Voltage that U2A subtracts from the instrumentation amplifier's output.
    stage_gain : float
        Gain of U2B.
    shift_V : float
        Voltage that U2D adds: the middle of the converter's range.
    amplifier_noise_V_per_rtHz, noise_corner_Hz : float
        White density and 1/f corner at the instrumentation amplifier's input: 8 nV/√Hz, and 1/f below 2 Hz, together
        the 0.2 µV peak to peak in 0.1 … 10 Hz of the INA128's data sheet. The noise of the op-amps after it (LM358,
        40 nV/√Hz) counts only 1/501.
    bandwidth_Hz : float
        Single pole before the converter; its noise bandwidth is π/2 times as wide.
    temperature_K : float
        Temperature of the bridge, for its thermal noise.
    converter : Converter
        Analogue-to-digital converter. Default: 0 … 3.3 V, 12 bits, that of an STM32.

    Examples
    --------
    >>> rig = StrainGauge()
    >>> round(rig.gain * 1e3, 2), round(rig.offset_V, 3)
    (11.31, 1.663)
    """

    strain_per_V: float = 0.86e-6
    gauge_factor: float = 2.1
    gauge_ohm: float = 350.0
    excitation_V: float = 5.0
    imbalance: float = 50e-6
    instrumentation_gain: float = 501.0
    instrumentation_offset_V: float = 10e-6
    zero_V: float = 0.035
    stage_gain: float = 10.0
    shift_V: float = 1.65
    amplifier_noise_V_per_rtHz: float = 8e-9
    noise_corner_Hz: float = 2.0
    bandwidth_Hz: float = 400.0
    temperature_K: float = 298.0
    converter: Converter = STM32

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gain) and self.gain != 0):
            raise ValueError(
                f"the strain-gauge rig's gain must be finite and not 0; its factors give {self.gain!r} V/V. "
                "Check strain_per_V, gauge_factor, excitation_V and the two gains."
            )

    @property
    def bridge_V_per_V(self) -> float:
        """Bridge voltage per hysteretic volt: a quarter of the excitation counts, since one arm of four is active."""
        return self.excitation_V / 4 * self.gauge_factor * self.strain_per_V

    @property
    def gain(self) -> float:
        """True gain: recorded volts per hysteretic volt."""
        return self.bridge_V_per_V * self.instrumentation_gain * self.stage_gain

    @property
    def offset_V(self) -> float:
        """True offset: the recorded voltage of the demagnetised ceramic at rest."""
        at_input = self.excitation_V / 4 * self.imbalance + self.instrumentation_offset_V
        return self.stage_gain * (self.instrumentation_gain * at_input - self.zero_V) + self.shift_V

    @property
    def noise(self) -> Noise:
        """Noise at the converter in volts: thermal noise of the bridge, and the amplifier's."""
        amplifier, bridge = self.amplifier_noise_V_per_rtHz, thermal_density(self.gauge_ohm, self.temperature_K)
        white = math.hypot(amplifier, bridge)
        amplification = self.instrumentation_gain * self.stage_gain
        corner = self.noise_corner_Hz * (amplifier / white) ** 2 if white > 0 else 0.0  # a resistor has no 1/f
        return Noise(white * amplification, math.pi / 2 * self.bandwidth_Hz, corner)

    def signal_V(self, hysteretic_V: ArrayLike) -> Real:
        """Voltage at the converter, without noise and steps, for a hysteretic drive in volts, same shape."""
        return self.gain * np.asarray(hysteretic_V, dtype=np.float64) + self.offset_V

    def fitted_to(self, largest_V: float) -> StrainGauge:
        """The rig with U2B's gain set so that hysteretic drives of ``±largest_V`` fill three quarters of the range."""
        half_range = (self.converter.high - self.converter.low) / 2
        return replace(self, stage_gain=abs(self.stage_gain * FILL * half_range / (self.gain * largest_V)))
