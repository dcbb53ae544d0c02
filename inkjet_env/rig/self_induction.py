"""Self-induction rig for the dynamics: current subtractor and converter (Zhu et al. 2024, section 3.2 and Fig. 6).

The current of the head is ``C_e dU/dt`` plus the current induced by its deflection. A second amplifier drives a
compensating capacitor with the same voltage; the difference of the two currents flows through a resistor. With equal
capacitors the output is the self-sensed signal ``b1 s / (s² + a1 s + a0)`` on the hysteretic drive; otherwise a term
proportional to ``dU/dt`` is added. The paper prints the circuit without values; those here are of ordinary parts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.rig.converter import Converter
from inkjet_env.rig.noise import Noise, thermal_density
from inkjet_env.typing import Real


@dataclass(frozen=True)
class SelfInduction:
    """The self-induction rig.

    Parameters
    ----------
    capacitance_F, compensating_F : float
        Equivalent capacitance of the head, and the capacitor that compensates it. 2 nF: tube heads have 1 … 5 nF.
    sensing_ohm : float
        Resistor of the current-to-voltage converter; the head's ``b1`` already contains it.
    bandwidth_Hz : float
        Single pole of the sensing amplifier on the signal; infinite by default, as in a recording corrected for its
        known instrument. A pole at B delays the signal by 1/2πB, a relative error of f/B at the frequency f: with
        100 MHz 5e-4 at 50 kHz, which the repeats of a campaign already resolve. See `bandwidth_error`.
    amplifier_noise_V_per_rtHz, noise_bandwidth_Hz : float
        Density and bandwidth of the amplifier's noise at the output. 250 nV/√Hz: a 25 nV/√Hz high-voltage op-amp at a
        noise gain of 10.
    range_V : float or None
        ± range of the oscilloscope; None lets `fitted_to` choose it.
    bits : int or None
        Resolution of the oscilloscope; None is without steps.
    noise_of_range : float
        RMS of the oscilloscope's own noise over ``range_V``. 1e-4: a 16-bit one with 12.5 effective bits.
    temperature_K : float
        Temperature of the sensing resistor, for its thermal noise.

    Examples
    --------
    >>> round(SelfInduction(compensating_F=1.98e-9).feedthrough_s * 1e9, 6)  # volts per V/ns
    20.0
    """

    capacitance_F: float = 2e-9
    compensating_F: float = 2e-9
    sensing_ohm: float = 1e3
    bandwidth_Hz: float = math.inf
    amplifier_noise_V_per_rtHz: float = 250e-9
    noise_bandwidth_Hz: float = 10e6
    range_V: float | None = None
    bits: int | None = 16
    noise_of_range: float = 1e-4
    temperature_K: float = 298.0

    def __post_init__(self) -> None:
        if not self.bandwidth_Hz > 0:
            raise ValueError(f"bandwidth_Hz must be above 0 Hz, or infinite for none; got {self.bandwidth_Hz!r}.")
        if not math.isfinite(self.feedthrough_s):
            raise ValueError(
                "capacitance_F, compensating_F and sensing_ohm must be finite; got "
                f"{self.capacitance_F!r}, {self.compensating_F!r} and {self.sensing_ohm!r}."
            )

    @property
    def feedthrough_s(self) -> float:
        """Feedthrough, output volts per V/s of drive: ``R (C_e − C_c)``, in seconds; 0 for exact compensation."""
        return self.sensing_ohm * (self.capacitance_F - self.compensating_F)

    @property
    def converter(self) -> Converter:
        """Converter of the oscilloscope; ``ValueError`` before a range is chosen."""
        if self.range_V is None:
            raise ValueError("range_V must be set before recording. Give it, or use fitted_to(largest_V).")
        return Converter(-self.range_V, self.range_V, self.bits)

    @property
    def noise(self) -> Noise:
        """White noise in volts: of resistor and amplifier within their bandwidth, and of the oscilloscope."""
        density = math.hypot(thermal_density(self.sensing_ohm, self.temperature_K), self.amplifier_noise_V_per_rtHz)
        analogue = density * math.sqrt(self.noise_bandwidth_Hz)
        return Noise.white(math.hypot(analogue, self.noise_of_range * self.converter.high))

    def bandwidth_error(self, frequency_Hz: float) -> float:
        """Relative error that the pole causes in a sine: ``|1 − 1/(1 + i f/B)|``."""
        return abs(1 - 1 / complex(1, frequency_Hz / self.bandwidth_Hz))

    def signal_V(self, sensor_V: ArrayLike, drive_V: ArrayLike, step_s: float, periodic: bool) -> Real:
        """Voltage at the oscilloscope without noise and steps.

        Parameters
        ----------
        sensor_V, drive_V : array_like, shape (n,)
            Self-sensed signal of the head and drive, in volts, linear between samples. At a corner the slope of the
            drive is the mean of both sides.
        step_s : float
            Sampling step, in seconds.
        periodic : bool
            Whether the drive repeats, so that the sample after the last is the first; otherwise it is constant before
            and after.

        Returns
        -------
        ndarray, shape (n,)
            Voltage at the samples, in volts.
        """
        signal = np.asarray(sensor_V, dtype=np.float64)
        if self.feedthrough_s != 0.0:
            around = np.pad(np.asarray(drive_V, dtype=np.float64), 1, mode="wrap" if periodic else "edge")
            signal = signal + self.feedthrough_s * (around[2:] - around[:-2]) / (2 * step_s)
        if math.isfinite(self.bandwidth_Hz):
            signal = single_pole(signal, 2 * math.pi * self.bandwidth_Hz * step_s, periodic)
        return signal

    def fitted_to(self, largest_V: float) -> SelfInduction:
        """The rig with the smallest range of 1, 2 or 5 × 10ⁿ V that holds 1.01 ``largest_V``; a given range is kept."""
        if self.range_V is not None:
            return self
        needed_V = 1.01 * largest_V or 1.0
        decade = 10.0 ** math.floor(math.log10(needed_V))
        return replace(self, range_V=next(m * decade for m in (1.0, 2.0, 5.0, 10.0) if m * decade >= needed_V))


def single_pole(signal: Real, step_over_tau: float, periodic: bool) -> Real:
    """``1 / (τs + 1)`` on a signal that is linear between samples, exact at the samples; shape (n,).

    The filter starts in the state after one repetition of the signal, or at rest at the first sample.
    """
    from scipy.signal import lfilter

    kept = math.exp(-step_over_tau)
    mean = -math.expm1(-step_over_tau) / step_over_tau
    before = signal if periodic else signal[:1]
    filtered = lfilter([1 - mean, mean - kept], [1.0, -kept], np.concatenate([before, signal]) - signal[0])
    return filtered[before.size :] + signal[0]
