"""An arbitrary waveform generator with the amplifier behind it, which drives the head."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from inkjet_env.rig.visa.commands import GeneratorCommands
from inkjet_env.rig.visa.instrument import Instrument
from inkjet_env.typing import Real


@dataclass(frozen=True)
class Generator:
    """A generator and its amplifier.

    Parameters
    ----------
    address : str
        VISA address.
    gain : float
        Volts at the head per volt of the generator into a high impedance; negative for an amplifier that inverts.
    channel : int
        Output of the generator.
    points_per_step : int
        Points of the generator per sampling step of a request. The generator holds each point, and a drive is linear
        between its samples: the more points, the closer they are. Their rate must be within the generator's range.
    commands : GeneratorCommands
        Its commands.
    """

    address: str
    gain: float
    channel: int = 1
    points_per_step: int = 8
    commands: GeneratorCommands = field(default_factory=GeneratorCommands)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.gain) and self.gain != 0):
            raise ValueError(f"gain must be finite and not 0, in volts at the head per volt; got {self.gain!r}.")
        if self.points_per_step < 1:
            raise ValueError(f"points_per_step must be at least 1; got {self.points_per_step}.")

    def held_V(self, drive_V: Real, step_s: float, periodic: bool) -> Real:
        """Drive at the middle of each of the generator's points, shape (points_per_step · n,), in volts.

        Parameters
        ----------
        drive_V : ndarray, shape (n,)
            Drive at the samples, linear between them.
        step_s : float
            Sampling step, in seconds.
        periodic : bool
            Whether the sample after the last is the first; otherwise the drive stays at its last sample.
        """
        n, points = drive_V.size, self.points_per_step * drive_V.size
        middle_s = step_s * (np.arange(points) + 0.5) / self.points_per_step
        time_s = step_s * np.arange(n + 1)
        return np.interp(middle_s, time_s, np.append(drive_V, drive_V[0 if periodic else -1]))

    def load(self, link: Instrument, waves_V: Mapping[str, Real]) -> float:
        """Switch the output off and upload waveforms, given by name in volts at the head; their scale.

        Returns
        -------
        float
            Volts between the generator's values −1 and 1. It is the same for all, so that going from one to another
            switches no range.
        """
        self._send(link, self.commands.set_up)
        peak_V = max(float(np.abs(wave_V).max()) for wave_V in waves_V.values()) / abs(self.gain) or 1.0
        for name, wave_V in waves_V.items():
            values = ",".join(f"{value:.6f}" for value in (wave_V / (self.gain * peak_V)).tolist())
            self._send(link, (self.commands.upload,), name=name, values=values)
        return 2 * peak_V

    def select(self, link: Instrument, name: str, rate_Hz: float, peak_to_peak_V: float, repeat: bool) -> None:
        """Choose an uploaded waveform; one that repeats begins once the output is on, another one waits for `fire`."""
        mode = self.commands.repeat if repeat else self.commands.once
        self._send(link, mode)
        self._send(link, self.commands.select, name=name, rate_Hz=rate_Hz, peak_to_peak_V=peak_to_peak_V)

    def output(self, link: Instrument, on: bool, checked: bool = True) -> None:
        """Switch the output on or off."""
        command = self.commands.output_on if on else self.commands.output_off
        link.send(command.format(channel=self.channel), checked)

    def fire(self, link: Instrument) -> None:
        """Put the selected waveform out once."""
        link.send(self.commands.fire.format(channel=self.channel))

    def _send(self, link: Instrument, templates: tuple[str, ...], **values: object) -> None:
        for template in templates:
            link.send(template.format(channel=self.channel, **values))
