"""Recording with the virtual rig: a battery of drives through a head and its instruments, to a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.rig.answer import answer_V
from inkjet_env.rig.battery import DriveLine, default_battery
from inkjet_env.rig.displacement import Vibrometer
from inkjet_env.rig.self_induction import SelfInduction
from inkjet_env.rig.strain_gauge import StrainGauge
from inkjet_env.typing import Real

CONDITION = {"temperature_C": 25.0, "back_pressure_kPa": 1.3}
"""Conditions noted with every recording; the paper keeps the back pressure at 0.9 … 1.7 kPa."""

SIMULATED = "Simulated by the virtual rig, not measured."
"""First sentence of the description of every campaign that the rig records."""

LOWEST_SNR_dB = -40.0
"""Lowest signal-to-noise ratio accepted, in dB."""

NOISE_ROOM = 6.0
"""Margin for noise in the instruments' ranges, in standard deviations."""

Instrument = StrainGauge | SelfInduction | Vibrometer

DEFAULT_INSTRUMENTS: dict[str, Instrument] = {
    "strain_gauge": StrainGauge(),
    "self_sensing": SelfInduction(),
    "displacement": Vibrometer(),
}
"""Instruments in the order of the sessions; the strain gauge is glued to a ceramic that is not built into a head."""


def record_campaign(
    printhead: Printhead | AugmentedPrinthead,
    seed: int | np.random.Generator,
    *,
    battery: Sequence[DriveLine] | None = None,
    strain_gauge: StrainGauge | None = None,
    self_induction: SelfInduction | None = None,
    vibrometer: Vibrometer | None = None,
    snr_dB: float | None = None,
    name: str = "virtual-rig",
) -> Campaign:
    """Record a head with the virtual instruments.

    Within each channel the recordings are in random order, so that drift is not mistaken for an effect of amplitude.

    Parameters
    ----------
    printhead : Printhead or AugmentedPrinthead
        Head to record. Random effects of a head contribute nothing.
    seed : int or Generator
        Source of order and noise; the same seed gives the same campaign.
    battery : sequence of DriveLine, optional
        Lines to record; by default `default_battery` for the head's own frequency.
    strain_gauge, self_induction, vibrometer : optional
        Instruments. The default ones are adjusted to the battery's largest signal, as at a bench: the gain of U2B, the
        ranges of oscilloscope and vibrometer. Given ones are used unchanged, except for a range of None.
    snr_dB : float, optional
        Signal-to-noise ratio: RMS (about its mean) of the channel's largest recording over that of the noise, in dB. It
        replaces the RMS of the instruments' own noise, whose spectrum keeps its shape. Infinity is no noise. The steps
        of the converters remain.
    name : str
        Name of the campaign.

    Returns
    -------
    Campaign
        Recordings r001, r002 … in the order in which they were taken; the description states the strain gauge's true
        gain and offset.

    Raises
    ------
    ValueError
        There are no lines, a signal leaves an instrument's range, or ``snr_dB`` is below −40.
    TypeError
        ``seed`` is missing.

    Examples
    --------
    >>> campaign = record_campaign(Printhead.published(), seed=1, snr_dB=60)
    >>> len(campaign.recordings), campaign.recordings[0].channel
    (38, 'strain_gauge')
    """
    if seed is None:
        raise TypeError(
            "seed must be a whole number or a numpy Generator, so that the campaign can be recorded again; got None."
        )
    if snr_dB is not None and not snr_dB >= LOWEST_SNR_dB:
        raise ValueError(f"snr_dB must be at least {LOWEST_SNR_dB:g} dB, or infinity for no noise; got {snr_dB!r}.")
    lines = default_battery(printhead.frequency_Hz) if battery is None else tuple(battery)
    if not lines:
        raise ValueError("battery must hold at least one line; got none.")
    rng = np.random.default_rng(seed)
    given: dict[str, Instrument | None] = {
        "strain_gauge": strain_gauge,
        "self_sensing": self_induction,
        "displacement": vibrometer,
    }
    changing = isinstance(printhead, AugmentedPrinthead) and any(e.depends_on_order for e, _ in printhead.effects)
    recordings: list[Recording] = []
    description = SIMULATED
    for channel in DEFAULT_INSTRUMENTS:
        mine = [line for line in lines if line.channel == channel]
        if not mine:
            continue
        bench, signals = Bench.set_up(printhead, channel, mine, given[channel], snr_dB)
        if isinstance(bench.instrument, StrainGauge):
            gauge = bench.instrument
            description += f" Strain gauge: {gauge.gain:.6g} V a hysteretic volt, offset {gauge.offset_V:.6g} V."
        shots = rng.permutation(np.repeat(np.arange(len(mine)), [line.repeats for line in mine]))
        first: dict[int, str] = {}
        for shot in shots.tolist():
            line, order = mine[shot], len(recordings) + 1
            signal = bench.signal(line, order) if changing else signals[shot]
            recordings.append(
                Recording(
                    name=f"r{order:03d}",
                    time_s=line.time_s,
                    drive_V=line.drive_V,
                    sensor=bench.recorded(signal, line, rng),
                    unit=bench.unit,
                    channel=channel,
                    excitation=line.excitation,
                    initial_state=line.initial_state,
                    order=order,
                    repeat_of=first.get(shot),
                    condition=CONDITION,
                )
            )
            first.setdefault(shot, f"r{order:03d}")
    return Campaign(name, tuple(recordings), description=description)


@dataclass(frozen=True)
class Bench:
    """A head with one instrument, set up.

    Attributes
    ----------
    printhead : Printhead or AugmentedPrinthead
        The head.
    channel : str
        Channel of the instrument.
    instrument : StrainGauge, SelfInduction or Vibrometer
        The instrument, its range or gain chosen.
    noise_rms : float or None
        RMS of the noise in the recorded unit, whose spectrum is the instrument's; None is the instrument's own.
    """

    printhead: Printhead | AugmentedPrinthead
    channel: str
    instrument: Instrument
    noise_rms: float | None

    @classmethod
    def set_up(
        cls,
        printhead: Printhead | AugmentedPrinthead,
        channel: str,
        lines: Sequence[DriveLine],
        given: Instrument | None = None,
        snr_dB: float | None = None,
        room: float = 1.0,
    ) -> tuple[Bench, list[Real]]:
        """A bench for these lines, and the signal of each, shape (n,), without noise.

        Parameters
        ----------
        printhead, channel, lines
            Head, channel and the lines to record.
        given : instrument, optional
            One in place of the default one.
        snr_dB : float, optional
            As in `record_campaign`.
        room : float
            Range over what these lines need, for others that are higher.
        """
        answers = [answer_V(printhead, line) for line in lines]
        instrument = _set_up(channel, given, lines, answers, snr_dB, room)
        signals = [_signal(instrument, line, answer) for line, answer in zip(lines, answers, strict=True)]
        rms = None if snr_dB is None else float(max(map(np.std, signals))) * 10 ** (-snr_dB / 20)
        return cls(printhead, channel, instrument, rms), signals

    @property
    def unit(self) -> str:
        """Unit of what is recorded."""
        return "um" if self.channel == "displacement" else "V"

    def signal(self, line: DriveLine, order: int) -> Real:
        """Signal of a line at the converter, shape (n,), without noise."""
        return _signal(self.instrument, line, answer_V(self.printhead, line, order))

    def recorded(self, signal: Real, line: DriveLine, rng: np.random.Generator) -> Real:
        """A signal as it is recorded, with noise and the steps of the converter."""
        noise = self.instrument.noise
        if self.noise_rms is not None:
            noise = noise.scaled_to(self.noise_rms, line.drive_V.size, 1 / line.step_s)
        drawn = noise.draw(rng, line.drive_V.size, 1 / line.step_s)
        return self.instrument.converter.quantised(signal + drawn)


def _set_up(
    channel: str,
    given: Instrument | None,
    lines: Sequence[DriveLine],
    answers: Sequence[Real],
    snr_dB: float | None,
    room: float,
) -> Instrument:
    """The given instrument or the default one, with an open range or gain fitted to the largest answer."""
    if isinstance(given, StrainGauge):
        return given
    instrument = given or DEFAULT_INSTRUMENTS[channel]
    if isinstance(instrument, SelfInduction):  # its range must also hold the feedthrough of the compensation
        answers = [_signal(instrument, line, answer) for line, answer in zip(lines, answers, strict=True)]
    noise_V = 0.0 if snr_dB is None else max(map(np.std, answers)) * 10 ** (-snr_dB / 20)
    largest_V = max(float(np.abs(answer).max()) for answer in answers) + NOISE_ROOM * float(noise_V)
    return instrument.fitted_to(room * largest_V or 1.0)


def _signal(instrument: Instrument, line: DriveLine, answer: Real) -> Real:
    """Noise-free signal at the converter, in the recorded unit."""
    if isinstance(instrument, StrainGauge):
        return instrument.signal_V(answer)
    if isinstance(instrument, Vibrometer):
        return instrument.signal_um(answer)
    return instrument.signal_V(answer, line.drive_V, line.step_s, line.initial_state == "periodic")
