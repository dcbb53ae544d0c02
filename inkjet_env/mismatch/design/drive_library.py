"""Candidate drives of a next recording, in words and as excitations, scaled to the head and to a campaign's drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.localization.views import largest_V
from inkjet_env.mismatch.settings import DesignSettings
from inkjet_env.plant import Excitation
from inkjet_env.plant.wording import with_prefix
from inkjet_env.typing import Real


@dataclass(frozen=True)
class Train:
    """A train of trapezoidal pulses, each from rest.

    Attributes
    ----------
    levels_V : tuple of float
        Voltage of each pulse.
    edge_s, dwell_s : float
        Duration of each edge and of each dwell, the same for every pulse.
    gap_s : float
        Time from the end of one pulse to the start of the next; 0: from level to level without rest.
    """

    levels_V: tuple[float, ...]
    edge_s: float
    dwell_s: float
    gap_s: float = 0.0

    @property
    def corners(self) -> tuple[list[float], list[float]]:
        """Times from the start of the first edge, in seconds, and voltages of all corners."""
        time_s, drive_V, now_s = [0.0], [0.0], 0.0
        for k, level in enumerate(self.levels_V):
            for length_s, value in ((self.edge_s, level), (self.dwell_s, level)):
                now_s += length_s
                time_s.append(now_s)
                drive_V.append(value)
            if self.gap_s or k == len(self.levels_V) - 1:
                for length_s in (self.edge_s, self.gap_s):
                    now_s += length_s
                    time_s.append(now_s)
                    drive_V.append(0.0)
        return time_s, drive_V

    @property
    def words(self) -> str:
        """The pulses in words, as they are set at a generator."""
        shape = f"(edges {with_prefix(self.edge_s, 's')}, dwell {with_prefix(self.dwell_s, 's')})"
        first, *more = (with_prefix(level, "V") for level in self.levels_V)
        if not more:
            return f"a pulse of {first} {shape}"
        if self.gap_s:
            return (
                f"pulses of {first} and {' and '.join(more)} with {with_prefix(self.gap_s, 's')} between them {shape}"
            )
        return f"a pulse from {first} to {' to '.join(more)} {shape}"

    @property
    def rounded(self) -> Train:
        """The train rounded to two digits, as it would be set; levels are rounded towards zero."""
        levels = tuple(_towards_zero(level) for level in self.levels_V)
        return Train(levels, *(float(f"{v:.2g}") for v in (self.edge_s, self.dwell_s, self.gap_s)))


def _towards_zero(level_V: float) -> float:
    """A level rounded to two digits."""
    unit = 10.0 ** (math.floor(math.log10(abs(level_V))) - 1)
    return float(f"{math.trunc(level_V / unit * (1 + 1e-12)) * unit:.2g}")


@dataclass(frozen=True, eq=False)
class Proposal:
    """A recording that could be taken.

    Attributes
    ----------
    words : str
        The drive in words: "under a pulse of …".
    excitation : Excitation
        The drive itself, its channel, sampling step and initial state.
    train : Train or None
        The pulses that it consists of, which may still be changed; None if it does not consist of pulses.
    """

    words: str
    excitation: Excitation
    train: Train | None = None


@dataclass(frozen=True)
class Bench:
    """The range of drives that a campaign has used, and what it can record on one channel.

    Attributes
    ----------
    channel, initial_state : str
        Channel, and initial state of its recordings: "periodic" or "demagnetised".
    step_s, period_s : float
        Sampling step and period of the head's resonance.
    high_V, low_V : float
        Largest drive of each sign; 0 if the campaign does not use that sign.
    order : int
        Order of the next recording within the session.
    neighbour : bool
        Whether the neighbouring channel can be driven.
    settings : DesignSettings
        Lengths of the drives.
    quasi_static : bool
        Whether the campaign records a displacement too slowly for the resonator to show.
    """

    channel: str
    initial_state: str
    step_s: float
    period_s: float
    high_V: float
    low_V: float
    order: int
    neighbour: bool
    settings: DesignSettings
    quasi_static: bool = False

    def excitation(self, drive_V: Real, initial_state: str = "", neighbour_V: Real | None = None) -> Excitation:
        """An excitation of this channel.

        Parameters
        ----------
        drive_V : ndarray, shape (n,)
            Drive.
        initial_state : str
            Initial state; that of the bench if empty.
        neighbour_V : ndarray, shape (n,), optional
            Drive of the neighbouring channel; 0 V unless given, if that channel can be driven.
        """
        if neighbour_V is None and self.neighbour:
            neighbour_V = np.zeros(drive_V.size)
        state = initial_state or self.initial_state
        return Excitation(
            self.channel, state, self.step_s, drive_V, self.order, neighbour_V, quasi_static=self.quasi_static
        )

    def samples(self, periods: float) -> int:
        """Number of samples in a number of resonance periods: at least 16, at most `DesignSettings.most_samples`."""
        return min(max(round(periods * self.period_s / self.step_s), 16), self.settings.most_samples)

    def pulses(self, train: Train, periods: float | None = None) -> Proposal:
        """A train, rounded, in a window of that many resonance periods, or a longer one if it does not fit.

        The window is `DesignSettings.pulse_window` unless given.
        """
        train = train.rounded
        time_s, drive_V = train.corners
        window = self.samples(self.settings.pulse_window if periods is None else periods)
        samples = max(window, math.ceil((time_s[-1] + self.period_s) / self.step_s))
        before_s = min(0.2 * self.period_s, 0.02 * samples * self.step_s)
        drive = np.interp(self.step_s * np.arange(samples), before_s + np.array(time_s), drive_V)
        return Proposal(f"under {train.words}{self._timing_words(samples)}", self.excitation(drive), train)

    def changed(self, train: Train, periods: float, height: float, times: Sequence[float]) -> Proposal | None:
        """A train with its height and times multiplied; None beyond the drives that the campaign has used.

        Parameters
        ----------
        train : Train
            The original pulses.
        periods : float
            Length of the window, in resonance periods.
        height : float
            Factor of the levels.
        times : sequence of float
            Factors of edges and dwells, and of the gap if there is one.
        """
        edge, dwell, gap = (*times, 1.0)[:3]
        levels = tuple(height * level for level in train.levels_V)
        train = Train(levels, edge * train.edge_s, dwell * train.dwell_s, gap * train.gap_s).rounded
        within = self.low_V <= min(train.levels_V) and max(train.levels_V) <= self.high_V
        long_s = train.corners[0][-1]
        if (
            not within
            or min(train.edge_s, train.dwell_s) < self.step_s
            or long_s > self.settings.most_samples * self.step_s / 2
        ):
            return None
        return self.pulses(train, periods)

    def _timing_words(self, samples: int) -> str:
        if self.initial_state == "periodic":
            return f", repeated every {with_prefix(samples * self.step_s, 's')}"
        return f", once, recorded for {with_prefix(samples * self.step_s, 's')}"


def benches(observed: Sequence[ObservedRecording], frequency_Hz: float, settings: DesignSettings) -> list[Bench]:
    """One bench for each channel of a campaign, at the channel's most frequent sampling step.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        The campaign's recordings.
    frequency_Hz : float
        Resonance frequency of the head.
    settings : DesignSettings
        Lengths of the drives.
    """
    high = max(float(o.excitation.drive_V.max()) for o in observed)
    low = min(float(o.excitation.drive_V.min()) for o in observed)
    most = max(largest_V(o) for o in observed)
    found = []
    for channel in sorted({o.channel for o in observed}):
        mine = [o for o in observed if o.channel == channel]
        keys = [o.noise_key for o in mine]
        usual = max(sorted(set(keys)), key=keys.count)
        excitation = next(o.excitation for o in mine if o.noise_key == usual)
        states = {o.excitation.initial_state for o in mine}
        found.append(
            Bench(
                channel,
                "periodic" if "periodic" in states else "demagnetised",
                excitation.step_s,
                1 / frequency_Hz,
                high if high > settings.sign_used * most else 0.0,
                low if low < -settings.sign_used * most else 0.0,
                1 + max(o.excitation.order for o in observed),
                any(o.excitation.neighbour_V is not None for o in mine),
                settings,
                excitation.quasi_static,
            )
        )
    return found


def library(bench: Bench) -> list[Proposal]:
    """Candidate drives of a channel, chosen so that every effect shows under one or another of them."""
    slow = bench.quasi_static or bench.channel == "strain_gauge"
    return slow_library(bench) if slow else fast_library(bench)


def fast_library(bench: Bench) -> list[Proposal]:
    """Candidate drives of a fast channel: pulses, pairs, repetition rates, multisines, a step, silence."""
    period_s, most = bench.period_s, max(bench.high_V, -bench.low_V)
    steep = max(0.03 * period_s, bench.step_s)
    usual = max(0.15 * period_s, bench.step_s)
    found = []
    levels = [v for v in (bench.high_V, bench.low_V) if v]
    for level in levels:
        for height in (1.0, 0.4):
            for edge_s in (steep, usual, 1.5 * period_s):
                found.append(bench.pulses(Train((height * level,), edge_s, 0.35 * period_s)))
        found.append(bench.pulses(Train((level,), usual, 3 * period_s)))
        for gap in (0.5, 1.0, 1.5, 3.25):
            for second in (1.0, 0.5):
                pair = Train((level, second * level), usual, 0.35 * period_s, gap * period_s)
                found.append(bench.pulses(pair))
        for window in (3, 6, 40):
            found.append(bench.pulses(Train((0.6 * level,), usual, 0.35 * period_s), window))
    if len(levels) == 2:
        for first, second in (levels, levels[::-1]):
            for edge_s in (steep, usual):
                found.append(bench.pulses(Train((first, second), edge_s, 0.35 * period_s)))
        for level in (0.95 * min(map(abs, levels)), 0.4 * min(map(abs, levels))):
            for last in (2.5, 8.0):
                found.append(_multisine(bench, float(f"{level:.2g}"), last))
    n = bench.samples(bench.settings.pulse_window)
    for level in levels:
        drive = np.interp(np.arange(n) * bench.step_s, [0.2 * period_s, 0.2 * period_s + usual], [0, level])
        words = (
            f"under a step to {with_prefix(level, 'V')} in {with_prefix(usual, 's')}, held, from the demagnetised state"
        )
        found.append(Proposal(words, bench.excitation(drive, "demagnetised")))
    silence = np.zeros(bench.samples(bench.settings.multisine_window))
    words = f"with zero drive for {with_prefix(silence.size * bench.step_s, 's')}"
    found.append(Proposal(words, bench.excitation(silence, "demagnetised")))
    if bench.neighbour:
        pulse = bench.pulses(Train((most if bench.high_V else -most,), usual, 0.35 * period_s))
        alone = replace(
            pulse.excitation, drive_V=np.zeros(pulse.excitation.samples), neighbour_V=pulse.excitation.drive_V, cache={}
        )
        words = f"with this channel at 0 V and the neighbouring channel {pulse.words}"
        found.append(Proposal(words, alone))
    return found


def probe_library(bench: Bench) -> list[Proposal]:
    """Pulses sampled so fast that a probe at the head shows what happens within an edge, or within a lag."""
    settings, period_s = bench.settings, bench.period_s
    within_edge = settings.probe_window / settings.probe_samples
    levels = tuple(v for v in (bench.high_V, bench.low_V) if v)
    found = []
    for step, window, dwells, gaps in (
        (within_edge, settings.probe_window, (0.35, 0.85), (0.35, 0.85)),
        (settings.finest_probe_step, 0.0, (0.35,), (0.35,)),
    ):
        fine = replace(bench, step_s=float(f"{step * period_s:.2g}"))
        steep = max(0.03 * period_s, fine.step_s)
        for height in (1.0, 0.7, 0.4):
            high = tuple(height * level for level in levels)
            for dwell in dwells:
                trains = [Train(high[:1], steep, dwell * period_s)]
                if len(high) > 1:
                    trains += [Train(high, steep, dwell * period_s, gap * period_s) for gap in gaps]
                found += [fine.pulses(train, window) for train in trains]
    return found


def slow_library(bench: Bench) -> list[Proposal]:
    """Candidate drives of a slow channel: loops at three rates, step and hold, nested loops, silence."""
    most = max(bench.high_V, -bench.low_V)
    slow, hold = bench.settings.slow_samples, bench.settings.hold_samples
    phase = 2 * np.pi * np.arange(slow) / slow
    middle, half = (bench.high_V + bench.low_V) / 2, (bench.high_V - bench.low_V) / 2
    found = []
    for turns in (1, 4, 16):
        drive = middle - half * np.cos(turns * phase)
        step_s = bench.step_s
        words = (
            f"under a sine from {with_prefix(bench.low_V, 'V')} to {with_prefix(bench.high_V, 'V')} with a period of "
        )
        found.append(Proposal(words + with_prefix(step_s * slow / turns, "s"), bench.excitation(drive, "periodic")))
    for level in (v for v in (bench.high_V, bench.low_V) if v):
        for height in (1.0, 0.5):
            drive = np.full(hold, height * level)
            drive[:10] = 0.0
            held_s = (hold - 10) * bench.step_s
            words = f"under a step to {with_prefix(height * level, 'V')}, held for {with_prefix(held_s, 's')}"
            found.append(Proposal(words, bench.excitation(drive, "demagnetised")))
    corners = np.array([0, bench.high_V, bench.low_V, bench.high_V, middle, bench.high_V, 0])
    nested = np.interp(np.linspace(0, corners.size - 1, slow), np.arange(corners.size), corners)
    words = f"under nested loops up to {with_prefix(most, 'V')} in {with_prefix(slow * bench.step_s, 's')}"
    found.append(Proposal(words, bench.excitation(nested, "demagnetised")))
    silence_s = with_prefix(slow * bench.step_s, "s")
    found.append(Proposal(f"with zero drive for {silence_s}", bench.excitation(np.zeros(slow), "demagnetised")))
    return found


def _multisine(bench: Bench, peak_V: float, last: float) -> Proposal:
    """A multisine with odd lines of equal amplitude up to ``last`` times the resonance.

    Schroeder's phases keep its peak low.
    """
    n = bench.samples(bench.settings.multisine_window)
    highest = max(min(int(last * n * bench.step_s / bench.period_s), int(bench.settings.highest_line * n)), 3)
    line = np.arange(3, highest + 1, 2)
    spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
    spectrum[line] = np.exp(-1j * np.pi * np.arange(line.size) * np.arange(1, line.size + 1) / line.size)
    drive = np.fft.irfft(spectrum, n)
    lowest_Hz, highest_Hz = line[0] / (n * bench.step_s), line[-1] / (n * bench.step_s)
    words = (
        f"under a multisine of {with_prefix(peak_V, 'V')} peak with lines from {with_prefix(lowest_Hz, 'Hz')} to "
        f"{with_prefix(highest_Hz, 'Hz')}, {with_prefix(2 / (n * bench.step_s), 'Hz')} apart"
    )
    return Proposal(words, bench.excitation(peak_V * drive / np.abs(drive).max(), "periodic"))
