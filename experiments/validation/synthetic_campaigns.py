"""Synthetic campaigns: recordings of a virtual head with effects of the catalogue, for tests of the diagnosis.

The same plant records and diagnoses, so such a test shows only that the diagnosis can distinguish its own effects. The
blind proof uses an independent plant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from inkjet_env.plant import Effect, Excitation, Plant, Values, catalogue
from inkjet_env.plant.effect import complete
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.rig.battery import DriveLine, default_battery
from inkjet_env.typing import Real

LINES = (
    "loop-0.5", "loop-1", "loop-5", "minor-loops", "staircase", "silence",
    "trapezoid-20V", "trapezoid-40V", "trapezoid-60V", "trapezoid-80V", "trapezoid-100V",
    "trapezoid-minus40V", "trapezoid-minus100V", "trapezoid-steep", "trapezoid-gentle", "trapezoid-often",
    "bipolar-full", "bipolar-quiet", "bipolar-uneven",
    "pulse-pair-0.50T", "pulse-pair-1.50T", "pulse-pair-3.25T",
    "multisine-50V-a", "multisine-95V-a", "first-trapezoid", "first-bipolar", "zero",
)  # fmt: skip
"""Lines of the default battery that are recorded: each once, those in `TWICE` twice."""
TWICE = ("trapezoid-60V", "bipolar-full")
SNR_dB = 50.0
SUBSTEPS = 16
"""Simulation nodes per sample: more than the diagnosis uses, so that its discretisation error is part of the test."""
GAUGE_GAIN = 0.02
"""Volts of the strain gauge's bridge per hysteretic volt."""
STRONG, MEDIUM = 1.0, 0.35
"""Strength of an effect as a factor on its `Effect.example_values`."""


def synthetic_values(effect: Effect, strength: float, printhead: Printhead) -> dict[str, float]:
    """Values of an effect's parameters at a strength; 1 is full strength.

    Amplitudes are in standard deviations of the noise. A level that depends on the largest signal is 0 here and is set
    by `record_synthetic`.
    """
    values = complete(effect, **effect.example_values(printhead, largest=0.0))
    for p in effect.parameters:
        if p.name in effect.strengths:
            values[p.name] = values[p.name] / strength if p.scale == "reciprocal" else values[p.name] * strength
    return values


def record_synthetic(
    printhead: Printhead,
    effects: Sequence[tuple[Effect, Values]],
    seed: int,
    snr_dB: float = SNR_dB,
    monitored: bool = False,
    lines: Sequence[DriveLine] | None = None,
) -> Campaign:
    """A campaign of about 29 recordings x 2,000 samples with white noise, its recordings in random order.

    Parameters
    ----------
    printhead : Printhead
        The head that is recorded.
    effects : sequence of (Effect, values)
        Active effects. The amplitude of a random effect is in standard deviations of the noise. A level of the sensor
        that is 0 is replaced by that of the effect's `Effect.example_values` for the largest self-sensing signal.
    seed : int
        Seed of the order and the noise.
    snr_dB : float
        Signal-to-noise ratio, in decibels, of the largest recording of each channel.
    monitored : bool
        Whether the voltage at the head is recorded too.
    lines : sequence of DriveLine, optional
        Drives to record; `LINES` of the default battery unless given.
    """
    rng = np.random.default_rng(seed)
    if lines is None:
        lines = [line for line in default_battery(printhead.frequency_Hz) if line.label in LINES]
        lines = lines + [line for line in lines if line.label in TWICE]
    needs_neighbour = any(effect.needs_neighbour for effect, _ in effects)
    chosen = [lines[i] for i in rng.permutation(len(lines))]
    offsets = {"strain_gauge": 0.05, "self_sensing": -0.1}
    gains = {"strain_gauge": GAUGE_GAIN}
    excitations = [
        Excitation(
            line.channel, line.initial_state, line.step_s, line.drive_V, order,
            _neighbour(line, rng) if needs_neighbour and line.channel == "self_sensing" else None, SUBSTEPS,
        )
        for order, line in enumerate(chosen, start=1)
    ]  # fmt: skip
    plain = [Plant(printhead, gains, offsets).signal(excitation) for excitation in excitations]
    largest: dict[str, float] = {}
    sigma: dict[str, float] = {}
    for channel in offsets:
        mine = [signal for signal, excitation in zip(plain, excitations, strict=True) if excitation.channel == channel]
        largest[channel] = max(float(np.abs(signal - offsets[channel]).max()) for signal in mine)
        sigma[channel] = max(float(np.std(signal)) for signal in mine) * 10 ** (-snr_dB / 20)
    effects = [(effect, _levelled(effect, values, printhead, largest)) for effect, values in effects]
    plant = Plant(printhead, gains, offsets, tuple(effects))
    recordings = []
    first: dict[tuple[str, str], str] = {}
    for line, excitation in zip(chosen, excitations, strict=True):
        name = f"r{excitation.order:03d}"
        noise: Real = np.asarray(sigma[excitation.channel] * rng.standard_normal(excitation.samples), dtype=np.float64)
        for effect, values in effects:
            noise = np.asarray(
                noise + sigma[excitation.channel] * _by_chance(effect, values, excitation, rng), dtype=np.float64
            )
        monitor = None
        if monitored:
            monitor = excitation.sampled(plant.at_ceramic_V(excitation)) + 0.05 * rng.standard_normal(
                excitation.samples
            )
        recordings.append(
            Recording(
                name, line.time_s, line.drive_V, plant.signal(excitation) + noise, "V", line.channel, line.excitation,
                line.initial_state, excitation.order, first.get((line.channel, line.label)), {}, monitor,
                excitation.neighbour_V,
            )
        )  # fmt: skip
        first.setdefault((line.channel, line.label), name)
    return Campaign("planted", tuple(recordings))


def _levelled(effect: Effect, values: Values, printhead: Printhead, largest: Mapping[str, float]) -> Values:
    """Values in which every level of 0, which is not allowed, is set for the largest self-sensing signal."""
    open_levels = [p.name for p in effect.parameters if p.scale == "reciprocal" and values[p.name] == 0]
    if not open_levels:
        return values
    example = effect.example_values(printhead, largest["self_sensing"])
    return {**values, **{name: example[name] for name in open_levels}}


def _neighbour(line: DriveLine, rng: np.random.Generator) -> Real:
    """Drive of the neighbouring channel in volts, shape (n,): zero, or a pulse at a random time."""
    n = line.drive_V.size
    if rng.random() < 0.4 or line.excitation == "zero":
        return np.zeros(n)
    start, edge, dwell = int(rng.integers(n // 8, n // 2)), 15, int(rng.integers(20, 60))
    level = float(rng.uniform(40, 100))
    at = np.cumsum([0, start, edge, dwell, edge])
    return np.interp(np.arange(n), at, [0.0, 0.0, level, level, 0.0])


def _by_chance(effect: Effect, values: Mapping[str, float], excitation: Excitation, rng: np.random.Generator) -> Real:
    """Random-effect signal of one recording, in standard deviations of the noise, shape (n,); 0 for other effects."""
    columns = effect.random_effect_basis(values, excitation)
    if columns is None:
        return np.zeros(excitation.samples)
    drawn: Real = values[effect.strengths[0]] * (columns @ effect.random_amplitudes(columns.shape[1], rng))
    return drawn


def effect_named(name: str) -> Effect:
    """The effect of the catalogue with the id ``name``."""
    return next(effect for effect in catalogue() if effect.id == name)
