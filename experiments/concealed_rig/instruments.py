"""The instruments of a campaign: noise and converter of each channel, and a monitor of the drive, or none."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.concealed_rig.converter import Converter, converted
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.noise import Noise
from experiments.concealed_rig.noise_kinds import drawn_noise


@dataclass(frozen=True)
class Instruments:
    """Instruments by channel.

    Parameters
    ----------
    noise, converter : dict
        By channel.
    monitor : Converter or None
        Of the voltage at the head, on the fast channels.
    monitor_noise_V, monitor_gain : float
    """

    noise: dict[str, Noise]
    converter: dict[str, Converter]
    monitor: Converter | None
    monitor_noise_V: float
    monitor_gain: float

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of the noise by channel."""
        return {channel: noise.sigma for channel, noise in self.noise.items()}

    def monitored_V(self, row: Measurement, applied_V: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
        """What the monitor gives of the voltage at the head, shape (n,), or None."""
        if self.monitor is None or row.channel == "strain_gauge":
            return None
        noise = self.monitor_noise_V * rng.standard_normal(applied_V.size)
        return converted(self.monitor_gain * applied_V + noise, self.monitor)

    def described(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            channel: {
                "noise": noise.described(),
                "converter_bits": self.converter[channel].bits,
                "converter_range": self.converter[channel].range,
            }
            for channel, noise in self.noise.items()
        } | {"drive_monitor": self.monitor is not None}


def drawn_instruments(
    rows: list[Measurement], signals: list[np.ndarray], kind: str, rng: np.random.Generator
) -> Instruments:
    """Draw the instruments for the base plant's signals; a monitor in two cases of five.

    Parameters
    ----------
    rows : list of Measurement
    signals : list of ndarray
        Noise-free, nothing concealed: what is concealed changes no instrument.
    kind : str
        Of noise, on all channels, each with its own numbers.
    rng : numpy.random.Generator
    """
    noise, converter = {}, {}
    for channel in sorted({row.channel for row in rows}):
        own = [s for row, s in zip(rows, signals, strict=True) if row.channel == channel]
        loudest = max(float(np.std(s)) for s in own)
        largest = 1.2 * max(float(np.max(np.abs(s))) for s in own)
        reference = float(np.mean([np.mean((s - np.median(s)) ** 2) for s in own]))
        noise[channel], converter[channel] = drawn_noise(kind, channel, loudest, largest, reference, rng)
    monitored = bool(rng.random() < 0.4)
    bits, level, gain = int(rng.integers(12, 17)), 100 * 10 ** (-rng.uniform(55, 70) / 20), 1 + 0.002 * rng.normal()
    monitor = Converter(200.0, bits) if monitored else None
    return Instruments(noise, converter, monitor, float(level), float(gain))
