"""Drives of a good campaign, each with its purpose."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from inkjet_env.printhead import DriverLimits, check_name
from inkjet_env.printhead.hysteresis import INITIAL_STATES
from inkjet_env.printhead.sampled import check_samples
from inkjet_env.recordings.recording import CHANNELS
from inkjet_env.typing import Real

EXPECTED_FREQUENCY_Hz = 50e3
"""Expected resonance of a head, in hertz."""
SAMPLES_A_PERIOD = 100
"""Samples per period of the expected resonance; the sampling rate is rounded to two digits."""

LARGEST_DRIVE_V = 100.0
"""Rated voltage of the ceramic, in volts (Zhu et al. 2024, section 2.3)."""

MULTISINE_PERIODS = 40
MULTISINE_LAST_LINE = 101
"""A repetition of a multisine lasts 40 periods of the expected resonance f0; lines 3, 5 … 101 are 0.075 … 2.525 f0."""

SLOW_SAMPLES = 1200
"""Samples per period of a slow loop; a multiple of four, so that the extremes of the drive are sampled."""


@dataclass(frozen=True, eq=False)
class DriveLine:
    """One line of a battery: a drive and how it is applied.

    Parameters
    ----------
    label : str
        Label, unique within the channel and valid in a file name.
    channel : {"self_sensing", "strain_gauge", "displacement"}
        Sensor to record.
    excitation : str
        Kind of drive, as in a `Recording`.
    initial_state : {"periodic", "demagnetised"}
        ``periodic``: the samples are exactly one repetition; the sample after the last is the first. ``demagnetised``:
        the ceramic has been demagnetised, and the head is at rest.
    step_s : float
        Sampling step, in seconds.
    drive_V : ndarray, shape (n,)
        Drive at the samples in volts, linear between them; within ±100 V.
    purpose : str
        Purpose of the line, in words.
    repeats : int
        Number of recordings to take of it, at least 1.
    """

    label: str
    channel: str
    excitation: str
    initial_state: str
    step_s: float
    drive_V: Real = field(repr=False)
    purpose: str
    repeats: int = 1

    def __post_init__(self) -> None:
        check_name("channel", self.channel, CHANNELS)
        check_name("initial_state", self.initial_state, INITIAL_STATES)
        _, drive = check_samples(self.step_s * np.arange(np.size(self.drive_V)), self.drive_V)
        if np.abs(drive).max() > LARGEST_DRIVE_V:
            raise ValueError(
                f"line {self.label}: drive_V must be within ±{LARGEST_DRIVE_V:g} V, what the ceramic is rated for; "
                f"got {drive[np.argmax(np.abs(drive))]:g} V. Lower it."
            )
        if self.repeats < 1:
            raise ValueError(f"line {self.label}: repeats must be at least 1; got {self.repeats}.")
        object.__setattr__(self, "drive_V", drive)

    @property
    def time_s(self) -> Real:
        """Times of the samples in seconds from 0 s, shape (n,)."""
        return np.asarray(self.step_s * np.arange(self.drive_V.size), dtype=np.float64)

    @property
    def repetition_period_s(self) -> float | None:
        """Time from one repetition to the next, in seconds; None if the drive is applied once."""
        return self.step_s * self.drive_V.size if self.initial_state == "periodic" else None


def default_battery(frequency_Hz: float = EXPECTED_FREQUENCY_Hz) -> tuple[DriveLine, ...]:
    """Lines for the strain gauge, then for self-sensing with a head expected to ring at ``frequency_Hz``."""
    return strain_gauge_battery() + self_sensing_battery(frequency_Hz)


def battery_within(lines: Sequence[DriveLine], limits: DriverLimits) -> tuple[DriveLine, ...]:
    """Lines within a driver's voltages, all scaled by one factor so that their amplitudes stay apart.

    For a unipolar driver, drives of the other sign are turned round; repeated drives of both signs are moved to one
    side, and those that are applied once are left out.

    Parameters
    ----------
    lines : sequence of DriveLine
        The lines.
    limits : DriverLimits
        Of its limits, the voltages count.

    Raises
    ------
    ValueError
        The driver's range does not hold 0 V, at which a head rests.
    """
    if not limits.lowest_V <= 0 <= limits.highest_V:
        raise ValueError(
            f"the driver's range must hold 0 V, at which a head rests; it goes from {limits.lowest_V:g} to "
            f"{limits.highest_V:g} V."
        )
    possible: list[tuple[DriveLine, Real]] = []
    for line in lines:
        drive_V = line.drive_V
        low_V, high_V = min(float(drive_V.min()), 0.0), max(float(drive_V.max()), 0.0)
        if (high_V == 0 or limits.highest_V > 0) and (low_V == 0 or limits.lowest_V < 0):
            possible.append((line, drive_V))
        elif low_V == 0 or high_V == 0:
            possible.append((line, -drive_V))
        elif line.initial_state == "periodic":
            possible.append((line, drive_V - (high_V if limits.highest_V == 0 else low_V)))
    ends_V = [(float(drive_V.min()), float(drive_V.max())) for _, drive_V in possible]
    lowest_V, highest_V = min(low for low, _ in ends_V), max(high for _, high in ends_V)
    factor = min(
        1.0,
        min(limits.highest_V, LARGEST_DRIVE_V) / highest_V if highest_V > 0 else 1.0,
        max(limits.lowest_V, -LARGEST_DRIVE_V) / lowest_V if lowest_V < 0 else 1.0,
    )
    if factor == 1.0:
        return tuple(replace(line, drive_V=drive_V) for line, drive_V in possible)
    return tuple(
        replace(line, label=f"{line.label}-times-{factor:.2g}", drive_V=factor * drive_V) for line, drive_V in possible
    )


def self_sensing_battery(frequency_Hz: float = EXPECTED_FREQUENCY_Hz) -> tuple[DriveLine, ...]:
    """Fast lines for self-sensing; all times scale with the expected resonance, which must be above 0 Hz."""
    if not (math.isfinite(frequency_Hz) and frequency_Hz > 0):
        raise ValueError(f"frequency_Hz must be finite and above 0 Hz; got {frequency_Hz!r}.")
    step_s = 1 / float(f"{SAMPLES_A_PERIOD * frequency_Hz:.1e}")
    period = SAMPLES_A_PERIOD
    lines: list[DriveLine] = []

    def add(
        label: str, excitation: str, drive_V: Real, purpose: str, repeats: int = 1, initial_state: str = "periodic"
    ) -> None:
        lines.append(DriveLine(label, "self_sensing", excitation, initial_state, step_s, drive_V, purpose, repeats))

    window, repetition = 16 * period, MULTISINE_PERIODS * period
    for level, repeats in ((20, 1), (40, 1), (60, 3), (80, 1), (100, 1)):
        purpose = "amplitude steps: does frequency, damping or gain change with amplitude?"
        if repeats > 1:
            purpose += " Its repeats show noise and drift."
        add(f"trapezoid-{level}V", "trapezoid", _trapezoids(window, (20, 15, 35, level)), purpose, repeats)
    for level in (-40, -100):
        purpose = "the other sign: are both branches alike?"
        add(f"trapezoid-minus{-level}V", "trapezoid", _trapezoids(window, (20, 15, 35, level)), purpose)
    steep = _trapezoids(window, (20, 3, 47, 80))
    add("trapezoid-steep", "trapezoid", steep, "steep edges: does the amplifier follow? What comes with dU/dt?")
    gentle = _trapezoids(window, (20, 150, 50, 80))
    add("trapezoid-gentle", "trapezoid", gentle, "gentle edges against steep ones at the same level")
    often = _trapezoids(6 * period, (20, 15, 35, 60))
    add("trapezoid-often", "trapezoid", often, "fired again before it has decayed: ringing carried over, refill")
    for label, corners, purpose, repeats in (
        ("full", ((15, 100), (35, 100), (30, -100), (35, -100), (15, 0)), "the largest swing, beyond slow loops", 2),
        ("quiet", ((5, 100), (54, 100), (71, -100), (50, -100), (103, 0)), "as an optimiser would choose it", 1),
        ("uneven", ((15, 55), (60, 55), (20, -90), (25, -90), (30, 0)), "unequal halves, for validation", 1),
    ):
        add(f"bipolar-{label}", "bipolar", _polyline(window, ((20, 0), *corners)), purpose, repeats)
    for gap, second in ((50, 60), (150, 90), (325, 60)):
        pair = _trapezoids(window, (20, 15, 35, 80), (20 + 65 + gap, 15, 35, second))
        purpose = "the second pulse meets the first one's ringing: memory, echoes, minor loops"
        add(f"pulse-pair-{gap / period:.2f}T", "pulse_pair", pair, purpose)
    for level, phases, repeats in ((25, 0, 1), (50, 0, 1), (95, 0, 3), (95, 1, 1)):
        drive = odd_multisine(repetition, MULTISINE_LAST_LINE, level, np.random.default_rng(phases))
        purpose = "odd random-phase multisine: frequency response; what appears on even lines is even distortion"
        add(f"multisine-{level}V-{'ab'[phases]}", "multisine", drive, purpose, repeats)
    for label, excitation, drive in (
        ("step", "step", _polyline(window, ((20, 0), (10, 60)))),
        ("first-trapezoid", "trapezoid", _trapezoids(window, (20, 15, 35, 80))),
        ("first-bipolar", "bipolar", _polyline(window, ((20, 0), (15, 80), (35, 80), (30, -80), (35, -80), (15, 0)))),
    ):
        add(label, excitation, drive, "the first pulse after demagnetisation: virgin curve", 1, "demagnetised")
    add("zero", "zero", np.zeros(repetition), "no drive: noise, offset, hum", 2, "demagnetised")
    return tuple(lines)


def strain_gauge_battery() -> tuple[DriveLine, ...]:
    """Slow lines for the strain gauge, which show the hysteresis and any creep."""
    lines = []
    for omega, repeats in ((0.5, 1), (1.0, 2), (5.0, 1)):
        drive = 90 * np.sin(2 * np.pi * np.arange(SLOW_SAMPLES) / SLOW_SAMPLES)
        step_s = 2 * np.pi / omega / SLOW_SAMPLES
        purpose = f"slow loop 90 sin({omega:g} t): the branch law; three rates tell whether the loop widens with rate"
        lines.append(DriveLine(f"loop-{omega:g}", "strain_gauge", "sine", "periodic", step_s, drive, purpose, repeats))
    reversals = _ramps((0, 90, -90, 90, -60, 90, -30, 90, 0, 90, 30, 90, -90, 0), volts_a_sample=0.6)
    staircase = _staircase(((0, 1), (30, 3), (60, 3), (90, 20), (0, 5), (-90, 10), (-45, 3), (0, 3)), step_s=0.01)
    silence = np.zeros(SLOW_SAMPLES)
    for label, excitation, drive, purpose, repeats in (
        ("minor-loops", "minor_loops", reversals, "virgin curve and nested loops: memory of turning points", 1),
        ("staircase", "step", staircase, "step and hold, 20 s at 90 V: creep over three decades of time", 1),
        ("zero", "zero", silence, "no drive: noise, offset, drift", 2),
    ):
        lines.append(DriveLine(label, "strain_gauge", excitation, "demagnetised", 0.01, drive, purpose, repeats))
    return tuple(lines)


def displacement_battery(frequency_Hz: float = EXPECTED_FREQUENCY_Hz) -> tuple[DriveLine, ...]:
    """Lines for a vibrometer, a selection of those for self-sensing; not in the default battery."""
    chosen = ("trapezoid-60V", "trapezoid-minus100V", "bipolar-full", "multisine-50V-a", "step", "zero")
    return tuple(
        replace(line, channel="displacement") for line in self_sensing_battery(frequency_Hz) if line.label in chosen
    )


def odd_multisine(samples: int, last_line: int, peak_V: float, rng: np.random.Generator) -> Real:
    """One repetition of a multisine: lines 3, 5, 7 … ``last_line`` with equal amplitudes and random phases.

    Parameters
    ----------
    samples : int
        Number of samples in one repetition.
    last_line : int
        Highest line, an odd multiple of the repetition rate, below ``samples / 2``.
    peak_V : float
        Largest magnitude at the samples, in volts.
    rng : Generator
        Source of the random phases.

    Returns
    -------
    ndarray, shape (samples,)
        The drive, in volts.
    """
    line = np.arange(3, last_line + 1, 2)
    spectrum = np.zeros(samples // 2 + 1, dtype=np.complex128)
    spectrum[line] = np.exp(2j * np.pi * rng.random(line.size))
    drive = np.fft.irfft(spectrum, samples)
    return peak_V * drive / np.abs(drive).max()


def _polyline(samples: int, steps: Sequence[tuple[int, float]]) -> Real:
    """Drive that goes linearly from 0 V to each level in the given number of samples, and stays at the last."""
    at, levels = np.cumsum([0, *(count for count, _ in steps)]), [0.0, *(level for _, level in steps)]
    return np.interp(np.arange(samples), at, levels)


def _trapezoids(samples: int, *pulses: tuple[int, int, int, float]) -> Real:
    """Sum of trapezoidal pulses (start, edge, dwell, level), the first three in samples and the level in volts."""
    total = np.zeros(samples)
    for start, edge, dwell, level in pulses:
        total += _polyline(samples, ((start, 0), (edge, level), (dwell, level), (edge, 0)))
    return total


def _ramps(levels: Sequence[float], volts_a_sample: float) -> Real:
    """Drive from level to level at a constant rate; every level falls on a sample."""
    pieces = [np.array([float(levels[0])])]
    for start, end in itertools.pairwise(levels):
        pieces.append(np.linspace(start, end, round(abs(end - start) / volts_a_sample) + 1)[1:])
    return np.concatenate(pieces)


def _staircase(holds: Sequence[tuple[float, float]], step_s: float) -> Real:
    """Drive that holds each level for the given number of seconds, with edges of one sampling step."""
    return np.concatenate([np.full(round(seconds / step_s), float(level)) for level, seconds in holds])
