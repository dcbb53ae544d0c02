"""The kinds of noise that a case may carry, each drawn anew for each channel; none of them is a law of a catalogue.

No kind has a coherent line (that is a hum) or a spectrum that falls with the square of the frequency down to that of
the recording (that is a drift). Times are drawn in nominal sampling intervals of the channel and kept in seconds, so
that a recording at another rate has the same physical noise.
"""

from dataclasses import replace

import numpy as np

from experiments.concealed_rig.converter import Converter, drawn_converter
from experiments.concealed_rig.noise import Colour, Noise

AUTOREGRESSIONS = ("first_order", "second_order", "third_order", "fourth_order")
COLOURED = (*AUTOREGRESSIONS, "fading_memory", "slow_memories", "flicker", "bumps")
ROUNDED = ("rounding", "dithered_rounding")
SHAPED = ("heavy_tails", "spikes", "grows_with_signal", "level_by_recording")
NOISES = ("white", *COLOURED, *SHAPED, *ROUNDED, "mixture")
NOMINAL_STEP_S = {"self_sensing": 4e-7, "displacement": 4e-7, "strain_gauge": 1e-3}
RECORDING = 2000  # samples
QUIETEST_DB, LOUDEST_DB = 60.0, 40.0


def _pair(radius: float, angle: float) -> list[complex]:
    pole = np.log(radius) + 1j * angle
    return [complex(pole), complex(np.conj(pole))]


def _autoregression(order: int, rng: np.random.Generator) -> list[complex]:
    """Poles a sampling interval: as many pairs as fit, and a real one."""
    poles: list[complex] = []
    for _ in range(order // 2):
        poles += _pair(rng.uniform(0.3, 0.85), rng.uniform(0.15, 0.8) * np.pi)
    return poles + [complex(np.log(rng.uniform(0.2, 0.8)))] * (order % 2)


def drawn_colours(kind: str, step_s: float, rng: np.random.Generator) -> tuple[Colour, ...]:
    """The coloured parts of a kind, whose shares add up to less than 1; none of a kind that has no memory.

    Parameters
    ----------
    kind : str
        Of `NOISES`.
    step_s : float
        Nominal sampling interval of the channel.
    rng : numpy.random.Generator
    """
    parts: list[tuple[float, list[complex]]] = []
    if kind in AUTOREGRESSIONS:
        parts = [(rng.uniform(0.7, 0.97), _autoregression(1 + AUTOREGRESSIONS.index(kind), rng))]
    elif kind == "fading_memory":
        # 5 … 100 µs of the fast channels; 30 … 70 % of the RMS.
        memory = np.exp(rng.uniform(np.log(12.5), np.log(250)))
        parts = [(rng.uniform(0.3, 0.7) ** 2, [complex(-1 / memory)])]
    elif kind == "slow_memories":
        memories = np.geomspace(15, RECORDING / 6, int(rng.integers(3, 6)))
        shares = rng.uniform(0.3, 0.7) * rng.dirichlet(np.full(memories.size, 3.0))
        parts = [(share, [complex(-1 / memory)]) for share, memory in zip(shares, memories, strict=True)]
    elif kind == "flicker":
        # Equal parts at equal ratios of time are 1/f in between (McWhorter's superposition).
        memories = np.geomspace(0.3, RECORDING, 13)
        share = rng.uniform(0.4, 0.9) / memories.size
        parts = [(share, [complex(-1 / memory)]) for memory in memories]
    elif kind == "bumps":
        count = int(rng.integers(1, 3))
        for _ in range(count):
            # Ten times as wide as a line would be, at least: noise, whose phase is lost within a tenth of a recording.
            width, frequency = rng.uniform(10, 40) / RECORDING, rng.uniform(0.03, 0.35)
            pole = -np.pi * width + 2j * np.pi * frequency
            parts.append((rng.uniform(0.3, 0.7) / count, [complex(pole), complex(np.conj(pole))]))
    return tuple(Colour(float(share), tuple(pole / step_s for pole in poles)) for share, poles in parts)


def _shaped(noise: Noise, kind: str, step_s: float, reference: float, rng: np.random.Generator) -> Noise:
    if kind == "heavy_tails":
        return replace(noise, tail_freedom=float(rng.uniform(2.5, 6.0)))
    if kind == "spikes":
        likely = 10 ** rng.uniform(-3.3, -2.5)
        size = float(rng.uniform(5.0, min(15.0, np.sqrt(0.5 / likely))))
        return replace(noise, spikes_per_s=float(likely / step_s), spike_size=size)
    if kind == "grows_with_signal":
        return replace(noise, growth=float(rng.uniform(0.3, 0.9)), reference=reference)
    if kind == "level_by_recording":
        return replace(noise, spread=float(rng.uniform(0.2, 0.6)))
    return noise


def _rounded(largest_rms: float, largest: float, kind: str, rng: np.random.Generator) -> tuple[Noise, Converter]:
    """Eight, ten or twelve bits, a triangular dither of half a step or none, and noise of 0.1 … 0.6 steps or 60 dB.

    Eight bits are 36 dB below the signal: the range is the signal's own, with its headroom.
    """
    bits = int(rng.choice([8, 10, 12]))
    converter = Converter(float(rng.uniform(1.0, 1.1)) * largest, bits)
    step = converter.step
    dither = step / 2 if kind == "dithered_rounding" else 0.0
    analogue = max(step * rng.uniform(0.1, 0.6), largest_rms * 10 ** (-QUIETEST_DB / 20))
    variances = np.array([analogue**2, dither**2 / 6, step**2 / 12])
    total = float(np.sum(variances))
    share = float(variances[1] + variances[2]) / total
    return Noise(float(np.sqrt(total)), rounding_share=share, dither=dither), converter


def drawn_noise(
    kind: str, channel: str, largest_rms: float, largest: float, reference: float, rng: np.random.Generator
) -> tuple[Noise, Converter]:
    """Draw noise and converter of a channel, 40 … 60 dB below the channel's largest recording.

    Parameters
    ----------
    kind : str
        Of `NOISES`. A mixture is of two others.
    channel : str
    largest_rms, largest : float
        RMS of the channel's largest recording, and its largest value.
    reference : float
        Mean square of the channel's signals over all its recordings.
    rng : numpy.random.Generator

    Raises
    ------
    ValueError
        An unknown kind.
    """
    if kind not in NOISES:
        raise ValueError(f"noise must be one of {', '.join(NOISES)}; got {kind!r}.")
    step = NOMINAL_STEP_S[channel]
    kinds = [str(k) for k in rng.choice(NOISES[1:-1], 2, replace=False)] if kind == "mixture" else [kind]
    rounded = [k for k in kinds if k in ROUNDED]
    if rounded:
        noise, converter = _rounded(largest_rms, largest, rounded[0], rng)
    else:
        noise = Noise(largest_rms * 10 ** (-float(rng.uniform(LOUDEST_DB, QUIETEST_DB)) / 20))
        converter = drawn_converter(largest, noise.sigma, rng)
    coloured = [k for k in kinds if k in COLOURED]
    colours: tuple[Colour, ...] = ()
    for one in coloured:
        colours += tuple(replace(c, share=c.share / len(coloured)) for c in drawn_colours(one, step, rng))
    if "spikes" in kinds:
        colours = tuple(replace(c, share=c.share / 2) for c in colours)  # spikes have up to half of the variance
    for one in kinds:
        noise = _shaped(noise, one, step, reference, rng)
    name = kind if kind != "mixture" else f"mixture of {' and '.join(kinds)}"
    return replace(noise, kind=name, colours=colours), converter
