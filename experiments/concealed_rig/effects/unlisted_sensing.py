"""Outside the catalogue: what sensors and digitisers do that no id stands for."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from experiments.concealed_rig.effects.digitiser import retimed
from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.effects.sensing import slope_V_per_s
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.linear import relaxations
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.play import play_sum_V
from experiments.concealed_rig.resonator import Motion, Resonator


def _heard(effect: Effect, measurement: Measurement) -> bool:
    return bool(effect.strength) and measurement.channel == "self_sensing"


@dataclass(frozen=True)
class SensorHysteresis(Effect):
    """The sensor itself has play: a share of the signal goes through plays of its own; strength is that share.

    Source: M. Brokate, J. Sprekels, Hysteresis and Phase Transitions (1996), chapter 2; P. Horowitz, W. Hill, The Art
    of Electronics (2015) (hysteresis of cores and dielectrics in the signal's path).
    """

    id = "sensor_hysteresis"
    stage = "sensing"
    start = 2e-2
    weakest = 1e-7
    strongest = 0.8

    thresholds_V: tuple[float, ...] = field(default=(0.1,), kw_only=True)
    weights: tuple[float, ...] = field(default=(1.0,), kw_only=True)
    offset_V: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SensorHysteresis":
        """Three plays of 2 … 25 % of the largest signal."""
        return cls(
            variant="plays",
            thresholds_V=tuple((np.sort(rng.uniform(0.02, 0.25, 3)) * situation.largest_V).tolist()),
            weights=tuple(rng.dirichlet(np.full(3, 3.0)).tolist()),
            offset_V=situation.head.self_sensing_offset_V,
        )

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Let a share be late by its plays."""
        if not _heard(self, measurement):
            return signal
        clean = signal - self.offset_V
        plays = play_sum_V(clean, np.array(self.thresholds_V), np.array(self.weights), grid.periodic)
        return signal + self.strength * (plays - clean)

    def parameters(self) -> dict[str, Any]:
        """Share, thresholds and weights."""
        return {"share": self.strength, "thresholds_V": list(self.thresholds_V), "weights": list(self.weights)}


@dataclass(frozen=True)
class GainFlicker(Effect):
    """The sensor's gain wanders within each recording, with a memory of 40 … 250 µs; strength is its RMS change.

    Source: P. Horowitz, W. Hill, The Art of Electronics (2015) (fluctuating bias of a multiplying stage); J. S. Bendat,
    A. G. Piersol, Random Data (2010) (multiplicative noise).
    """

    id = "gain_flicker"
    stage = "sensing"
    by_chance = True
    start = 1e-2
    weakest = 1e-7
    strongest = 0.5

    memory_s: float = field(default=1e-4, kw_only=True)
    offset_V: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "GainFlicker":
        """A memory of 40 … 250 µs."""
        memory = float(10 ** rng.uniform(-4.4, -3.6))
        return cls(variant="relaxing", memory_s=memory, offset_V=situation.head.self_sensing_offset_V)

    def added(
        self, signal: np.ndarray, slope: np.ndarray, measurement: Measurement, rng: np.random.Generator
    ) -> np.ndarray:
        """Signal times the wandering gain, an autoregression of first order that starts in its steady state."""
        white = rng.standard_normal(signal.size)
        if not _heard(self, measurement):
            return np.zeros_like(signal)
        keep = np.exp(-measurement.step_s / self.memory_s)
        white[1:] *= np.sqrt(1 - keep**2)
        return self.strength * lfilter([1.0], [1.0, -keep], white) * (signal - self.offset_V)

    def parameters(self) -> dict[str, Any]:
        """RMS and memory."""
        return {"gain_rms": self.strength, "memory_s": self.memory_s}


@dataclass(frozen=True)
class MissedAcquisition(Effect):
    """Now and then the converter has not settled and keeps a part of the sample before; strength is that part.

    Source: W. Kester, Data Conversion Handbook (Analog Devices, 2005), chapter 2 (acquisition time, sparkle codes).
    """

    id = "missed_acquisition"
    stage = "sensing"
    by_chance = True
    start = 5e-2
    weakest = 1e-6
    strongest = 1.0

    share: float = field(default=0.05, kw_only=True)
    back: int = field(default=1, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "MissedAcquisition":
        """3 … 20 % of the samples, one to four samples back (interleaved converters keep an older one)."""
        return cls(variant="kept_charge", share=float(rng.uniform(0.03, 0.2)), back=int(rng.integers(1, 5)))

    def added(
        self, signal: np.ndarray, slope: np.ndarray, measurement: Measurement, rng: np.random.Generator
    ) -> np.ndarray:
        """What the samples that are not settled lack."""
        missed = rng.random(signal.size) < self.share
        if not _heard(self, measurement):
            return np.zeros_like(signal)
        before = np.concatenate((np.full(self.back, signal[0]), signal[: -self.back]))
        return self.strength * np.where(missed, before - signal, 0.0)

    def parameters(self) -> dict[str, Any]:
        """Part that is kept, share of the samples, how many samples back."""
        return {"kept": self.strength, "share": self.share, "samples_back": self.back}


@dataclass(frozen=True)
class DopplerDelay(Effect):
    """The delay of the signal's path follows the signal: y(t − D y/Y); strength is the delay at the largest signal.

    Phase that follows the level: a sensor that moves with what it hears, or a stage whose group delay depends on its
    level.

    Source: G. L. Beers, H. Belar, Proc. IRE 31 (1943) 132 (frequency modulation by motion); M. J. Hawksford, J. Audio
    Eng. Soc. 47 (1999) 430 (level-dependent delay).
    """

    id = "doppler_delay"
    stage = "sensing"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.3

    sign: float = field(default=1.0, kw_only=True)
    period_s: float = field(default=2e-5, kw_only=True)
    largest_V: float = field(default=5.0, kw_only=True)
    offset_V: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "DopplerDelay":
        """Of either sign; in periods of the resonance."""
        return cls(
            variant="level",
            sign=float(rng.choice([-1.0, 1.0])),
            period_s=1 / situation.head.resonance_Hz,
            largest_V=situation.largest_V,
            offset_V=situation.head.self_sensing_offset_V,
        )

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """The signal at instants that follow it."""
        if not _heard(self, measurement):
            return signal
        late = self.sign * self.strength * self.period_s / grid.step_s * (signal - self.offset_V) / self.largest_V
        return retimed(signal, np.arange(signal.size) - late, grid, True)

    def parameters(self) -> dict[str, Any]:
        """Delay a volt of signal."""
        return {"delay_s_per_V": self.sign * self.strength * self.period_s / self.largest_V}


@dataclass(frozen=True)
class RectifiedPickup(Effect):
    """A protection diode rectifies what the edges couple in: |dU/dt| smoothed; strength is its height over the signal.

    Source: H. W. Ott, Electromagnetic Compatibility Engineering (2009), chapter 12 (rectification of interference in
    input stages).
    """

    id = "rectified_pickup"
    stage = "sensing"
    start = 2e-2
    weakest = 1e-7
    strongest = 2.0

    gain_s: float = field(default=5e-8, kw_only=True)
    time_s: float = field(default=2e-6, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "RectifiedPickup":
        """Smoothed over 0.5 … 8 µs."""
        gain = float(rng.choice([-1.0, 1.0])) * situation.largest_V / situation.steepest_V_per_s
        return cls(variant="smoothed", gain_s=gain, time_s=float(rng.uniform(5e-7, 8e-6)))

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Add what is rectified."""
        if not _heard(self, measurement):
            return signal
        edges = np.abs(slope_V_per_s(applied_V, grid))
        smooth = relaxations(edges, np.array([self.time_s]), grid.step_s, grid.periodic)[0]
        return signal + self.strength * self.gain_s * smooth

    def parameters(self) -> dict[str, Any]:
        """Sensor volts for each V/s, and the smoothing time."""
        return {"gain_s": self.strength * self.gain_s, "time_s": self.time_s}


@dataclass(frozen=True)
class NonlinearEcho(Effect):
    """A wave returns with the square of its size, y|y|/Y: a reflector that opens under pressure; strength is its share.

    Source: M. F. Hamilton, D. T. Blackstock, Nonlinear Acoustics (1998), chapters 4 and 5 (reflection at bubbly and
    compliant ends).
    """

    id = "nonlinear_echo"
    stage = "resonator"
    start = 2e-2
    weakest = 1e-7
    strongest = 2.0

    delay_s: float = field(default=2e-5, kw_only=True)
    sign: float = field(default=1.0, kw_only=True)
    largest_V: float = field(default=100.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "NonlinearEcho":
        """Delays of 12 … 45 µs."""
        return cls(
            variant="square",
            delay_s=float(rng.uniform(1.2e-5, 4.5e-5)),
            sign=float(rng.choice([-1.0, 1.0])),
            largest_V=situation.largest_speed_V,
        )

    def on_motion(
        self, motion: Motion, hysteretic_V: np.ndarray, resonator: Resonator, grid: Grid, order: int
    ) -> Motion:
        """Add what returns."""
        if not self.strength:
            return motion
        steps = np.arange(motion.speed_V.size) - self.delay_s / grid.step_s
        share = self.sign * self.strength / self.largest_V

        def returned(y: np.ndarray) -> np.ndarray:
            before = retimed(y, steps, grid, True)
            return share * before * np.abs(before)

        return replace(
            motion,
            deflection_V=motion.deflection_V + returned(motion.deflection_V),
            speed_V=motion.speed_V + returned(motion.speed_V),
        )

    def parameters(self) -> dict[str, Any]:
        """Delay, and the share at the largest speed."""
        return {"delay_s": self.delay_s, "share_at_largest": self.sign * self.strength}


@dataclass(frozen=True)
class LockedInterference(Effect):
    """A burst at a fixed time after the trigger, whatever is driven: a strobe or a valve; strength is its height.

    Source: H. W. Ott, Electromagnetic Compatibility Engineering (2009) (switching transients of synchronised
    equipment).
    """

    id = "locked_interference"
    stage = "sensing"
    start = 1e-2
    weakest = 1e-7
    strongest = 2.0

    start_share: float = field(default=0.2, kw_only=True)
    frequency_Hz: float = field(default=1e5, kw_only=True)
    decay_s: float = field(default=3e-5, kw_only=True)
    largest_V: float = field(default=5.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "LockedInterference":
        """Some time in the first 70 % of a recording; a ringing of 0.4 … 4 times the resonance."""
        return cls(
            variant="ringing",
            start_share=float(rng.uniform(0.02, 0.7)),
            frequency_Hz=float(situation.head.resonance_Hz * 10 ** rng.uniform(-0.4, 0.6)),
            decay_s=float(10 ** rng.uniform(-5, -4)),
            largest_V=situation.largest_V,
        )

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Add the burst."""
        if not _heard(self, measurement):
            return signal
        t = grid.step_times_s - self.start_share * 8e-4
        burst = np.where(
            t > 0, np.exp(-np.maximum(t, 0) / self.decay_s) * np.sin(2 * np.pi * self.frequency_Hz * t), 0.0
        )
        return signal + self.strength * self.largest_V * burst

    def parameters(self) -> dict[str, Any]:
        """Height, start, frequency and decay."""
        named = {"height_V": self.strength * self.largest_V, "start_s": self.start_share * 8e-4}
        return {**named, "frequency_Hz": self.frequency_Hz, "decay_s": self.decay_s}


@dataclass(frozen=True)
class AutomaticGain(Effect):
    """The sensing amplifier turns its gain down after large signals and up again: y/(1 + s e/Y), e the relaxed |y|.

    Source: P. Horowitz, W. Hill, The Art of Electronics (2015) (automatic gain control); D. Giannoulis, M. Massberg,
    J. D. Reiss, J. Audio Eng. Soc. 60 (2012) 399 (compressors with release).
    """

    id = "automatic_gain"
    stage = "sensing"
    start = 2e-2
    weakest = 1e-7
    strongest = 5.0

    time_s: float = field(default=5e-5, kw_only=True)
    largest_V: float = field(default=5.0, kw_only=True)
    offset_V: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "AutomaticGain":
        """Within 20 … 200 µs."""
        return cls(
            variant="feed_forward",
            time_s=float(10 ** rng.uniform(-4.7, -3.7)),
            largest_V=situation.largest_V,
            offset_V=situation.head.self_sensing_offset_V,
        )

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Turn the gain."""
        if not _heard(self, measurement):
            return signal
        clean = signal - self.offset_V
        level = relaxations(np.abs(clean), np.array([self.time_s]), grid.step_s, grid.periodic)[0]
        return self.offset_V + clean / (1 + self.strength * level / self.largest_V)

    def parameters(self) -> dict[str, Any]:
        """Compression at the largest signal, and its time."""
        return {"compression": self.strength, "time_s": self.time_s}
