"""The virtual rig at work: a battery of drives through a head and its instruments, to a campaign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.rig.answer import answer_V
from inkjet_env.rig.battery import DriveLine, default_battery
from inkjet_env.rig.displacement import Vibrometer
from inkjet_env.rig.self_induction import SelfInduction
from inkjet_env.rig.strain_gauge import StrainGauge
from inkjet_env.typing import Real

CONDITION = {"temperature_C": 25.0, "back_pressure_kPa": 1.3}
"""The paper keeps the back pressure at 0.9 … 1.7 kPa."""

SIMULATED = "Simulated by the virtual rig, not measured."
"""Begins the description of every campaign that the rig records."""

LOWEST_SNR_dB = -40.0

NOISE_ROOM = 6.0
"""Standard deviations of noise for which the instruments' ranges leave room."""

Instrument = StrainGauge | SelfInduction | Vibrometer

DEFAULT_INSTRUMENTS: dict[str, Instrument] = {
    "strain_gauge": StrainGauge(),
    "self_sensing": SelfInduction(),
    "displacement": Vibrometer(),
}
"""In the order of the sessions: the strain gauge is glued to a ceramic that is not built in."""


def record_campaign(
    printhead: Printhead,
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

    Within each channel the recordings come in random order, so that drift cannot pass for an effect of amplitude.

    Parameters
    ----------
    printhead : Printhead
    seed : int or Generator
        Draws order and noise; the same seed gives the same campaign.
    battery : sequence of DriveLine, optional
        Default: `default_battery` for the head's own frequency.
    strain_gauge, self_induction, vibrometer : optional
        The default instruments are set to the battery's largest signal, as at a bench: U2B's gain, the oscilloscope's
        and the vibrometer's range. Given ones are taken as they are, but for a range of None.
    snr_dB : float, optional
        Instead of the instruments' own noise RMS, that far below the RMS (about its mean) of the channel's largest
        recording; the spectrum keeps its shape. Infinity is no noise. Steps of the converters remain.
    name : str
        The campaign's.

    Returns
    -------
    Campaign
        Recordings r001, r002 … in the order they were taken; the description tells the strain gauge's true gain and
        offset.

    Raises
    ------
    ValueError
        No lines; a signal that leaves an instrument's range; ``snr_dB`` below −40.
    TypeError
        No seed.

    Examples
    --------
    >>> campaign = record_campaign(Printhead.published(), seed=1, snr_dB=60)
    >>> len(campaign.recordings), campaign.recordings[0].channel
    (38, 'strain_gauge')
    """
    if seed is None:
        raise TypeError("seed must be a whole number or a numpy Generator: a campaign can be recorded again; got None.")
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
    recordings: list[Recording] = []
    description = SIMULATED
    for channel in DEFAULT_INSTRUMENTS:
        mine = [line for line in lines if line.channel == channel]
        if not mine:
            continue
        answers = [answer_V(printhead, line) for line in mine]
        instrument = _set_up(channel, given[channel], mine, answers, snr_dB)
        if isinstance(instrument, StrainGauge):
            description += (
                f" Strain gauge: {instrument.gain:.6g} V a hysteretic volt, offset {instrument.offset_V:.6g} V."
            )
        signals = [_signal(instrument, line, answer) for line, answer in zip(mine, answers, strict=True)]
        rms = None if snr_dB is None else float(max(map(np.std, signals))) * 10 ** (-snr_dB / 20)
        shots = rng.permutation(np.repeat(np.arange(len(mine)), [line.repeats for line in mine]))
        first: dict[int, str] = {}
        for shot in shots.tolist():
            line, order = mine[shot], len(recordings) + 1
            noise = instrument.noise
            if rms is not None:
                noise = noise.scaled_to(rms, line.drive_V.size, 1 / line.step_s)
            drawn = noise.draw(rng, line.drive_V.size, 1 / line.step_s)
            recordings.append(
                Recording(
                    name=f"r{order:03d}",
                    time_s=line.time_s,
                    drive_V=line.drive_V,
                    sensor=instrument.converter.quantised(signals[shot] + drawn),
                    unit="um" if channel == "displacement" else "V",
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


def _set_up(
    channel: str, given: Instrument | None, lines: Sequence[DriveLine], answers: Sequence[Real], snr_dB: float | None
) -> Instrument:
    """The given instrument or the default one, fitted to the largest answer where that is left open."""
    if isinstance(given, StrainGauge):
        return given
    instrument = given or DEFAULT_INSTRUMENTS[channel]
    if isinstance(instrument, SelfInduction):  # its range must hold what the compensation leaves, too
        answers = [_signal(instrument, line, answer) for line, answer in zip(lines, answers, strict=True)]
    noise_V = 0.0 if snr_dB is None else max(map(np.std, answers)) * 10 ** (-snr_dB / 20)
    largest_V = max(float(np.abs(answer).max()) for answer in answers) + NOISE_ROOM * float(noise_V)
    return instrument.fitted_to(largest_V or 1.0)


def _signal(instrument: Instrument, line: DriveLine, answer: Real) -> Real:
    """What reaches the converter without noise."""
    if isinstance(instrument, StrainGauge):
        return instrument.signal_V(answer)
    if isinstance(instrument, Vibrometer):
        return instrument.signal_um(answer)
    return instrument.signal_V(answer, line.drive_V, line.step_s, line.initial_state == "periodic")
