"""Synthetic campaigns: recordings of a virtual head with effects of the catalogue, for tests of the diagnosis.

The same plant records and diagnoses, so such a test shows only that the diagnosis can distinguish its own effects. The
blind proof uses an independent plant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import brentq

from inkjet_env.experiments.validation.noise_zoo import ZOO
from inkjet_env.plant import Effect, Excitation, Plant, Values, catalogue
from inkjet_env.plant.effect import complete
from inkjet_env.plant.wording import SENSOR_UNIT
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
OFFSETS_V = {"strain_gauge": 0.05, "self_sensing": -0.1}
"""Offset of each channel's signal, in volts."""
HIGHEST_LEVEL = 1000.0
"""Largest ratio of a level at which a sensor saturates to that at full strength."""
STRONG, MEDIUM = 1.0, 0.35
"""Strength of an effect as a factor on its `Effect.example_values`."""


def synthetic_values(effect: Effect, strength: float, printhead: Printhead, largest_V: float) -> dict[str, float]:
    """Values of an effect's parameters at a strength.

    Parameters
    ----------
    effect : Effect
        An effect.
    strength : float
        Factor on the strengths of its `Effect.example_values`, above 0, at most 1: full strength. A parameter with a
        reciprocal coordinate, such as a bandwidth, is divided by it. A level at which a sensor saturates is such that
        the largest signal is reduced by that factor times its reduction at full strength: a level divided by a third
        would be out of reach of every signal.
    printhead : Printhead
        The head that has the effect.
    largest_V : float
        Largest magnitude of its self-sensing signal, in volts, as `largest_signal_V` returns it.

    Returns
    -------
    dict of str to float
        Value of each parameter, in its unit; amplitudes of random effects in standard deviations of the noise.
    """
    values = complete(effect, **effect.example_values(printhead, largest=largest_V))
    for p in effect.parameters:
        if p.name in effect.strengths:
            if p.scale != "reciprocal":
                values[p.name] *= strength
            elif p.unit == SENSOR_UNIT:
                values[p.name] = _saturation_level(effect, values, p.name, strength, printhead, largest_V)
            else:
                values[p.name] /= strength
    return values


def largest_signal_V(printhead: Printhead, lines: Sequence[DriveLine] | None = None) -> float:
    """Largest magnitude of the self-sensing signal, in volts, in a campaign without effects, noise and offset.

    Parameters
    ----------
    printhead : Printhead
        The head that is recorded.
    lines : sequence of DriveLine, optional
        Drives of the campaign; `LINES` of the default battery unless given.
    """
    fast = [line for line in _recorded_lines(printhead, lines) if line.channel == "self_sensing"]
    excitations = [
        Excitation(line.channel, line.initial_state, line.step_s, line.drive_V, substeps=SUBSTEPS) for line in fast
    ]
    plant, offset_V = Plant(printhead, offsets=OFFSETS_V), OFFSETS_V["self_sensing"]
    return max(float(np.abs(plant.signal(excitation) - offset_V).max()) for excitation in excitations)


def record_synthetic(
    printhead: Printhead,
    effects: Sequence[tuple[Effect, Values]],
    seed: int,
    snr_dB: float = SNR_dB,
    monitored: bool = False,
    lines: Sequence[DriveLine] | None = None,
    noise_kind: str = "white",
) -> Campaign:
    """A campaign of about 29 recordings x 2,000 samples with noise, its recordings in random order.

    Parameters
    ----------
    printhead : Printhead
        The head that is recorded.
    effects : sequence of (Effect, values)
        Active effects, with values as from `synthetic_values`: the amplitude of a random effect is in standard
        deviations of the noise.
    seed : int
        Seed of the order and the noise.
    snr_dB : float
        Signal-to-noise ratio, in decibels, of the largest recording of each channel.
    monitored : bool
        Whether the voltage at the head is recorded too.
    lines : sequence of DriveLine, optional
        Drives to record; `LINES` of the default battery unless given.
    noise_kind : str
        Kind of noise, a name of `noise_zoo.ZOO`; its constants are drawn for each channel.
    """
    rng = np.random.default_rng(seed)
    lines = _recorded_lines(printhead, lines)
    needs_neighbour = any(effect.needs_neighbour for effect, _ in effects)
    chosen = [lines[i] for i in rng.permutation(len(lines))]
    gains = {"strain_gauge": GAUGE_GAIN}
    excitations = [
        Excitation(
            line.channel, line.initial_state, line.step_s, line.drive_V, order,
            _neighbour(line, rng) if needs_neighbour and line.channel == "self_sensing" else None, SUBSTEPS,
        )
        for order, line in enumerate(chosen, start=1)
    ]  # fmt: skip
    plain = [Plant(printhead, gains, OFFSETS_V).signal(excitation) for excitation in excitations]
    sigma: dict[str, float] = {}
    for channel in OFFSETS_V:
        mine = [signal for signal, excitation in zip(plain, excitations, strict=True) if excitation.channel == channel]
        sigma[channel] = max(float(np.std(signal)) for signal in mine) * 10 ** (-snr_dB / 20)
    laws = {channel: ZOO[noise_kind](np.random.default_rng([seed, k])) for k, channel in enumerate(OFFSETS_V)}
    largest = {
        channel: max(
            float(np.abs(s - OFFSETS_V[channel]).max())
            for s, e in zip(plain, excitations, strict=True)
            if e.channel == channel
        )
        for channel in OFFSETS_V
    }
    shortest_s = {channel: min(e.step_s for e in excitations if e.channel == channel) for channel in OFFSETS_V}
    plant = Plant(printhead, gains, OFFSETS_V, tuple(effects))
    recordings = []
    first: dict[tuple[str, str], str] = {}
    for line, excitation in zip(chosen, excitations, strict=True):
        name = f"r{excitation.order:03d}"
        channel = excitation.channel
        signal = plant.signal(excitation)
        for effect, values in effects:
            signal = signal + sigma[channel] * _drawn_random_effect(effect, values, excitation, rng)
        step = excitation.step_s / shortest_s[channel]
        signal = laws[channel].recorded(signal - OFFSETS_V[channel], sigma[channel], largest[channel], step, rng)
        monitor = None
        if monitored:
            monitor = excitation.sampled(plant.at_ceramic_V(excitation)) + 0.05 * rng.standard_normal(
                excitation.samples
            )
        recordings.append(
            Recording(
                name, line.time_s, line.drive_V, signal + OFFSETS_V[channel], "V", line.channel, line.excitation,
                line.initial_state, excitation.order, first.get((line.channel, line.label)), {}, monitor,
                excitation.neighbour_V,
            )
        )  # fmt: skip
        first.setdefault((line.channel, line.label), name)
    return Campaign("synthetic", tuple(recordings))


def _saturation_level(
    effect: Effect, values: Values, name: str, strength: float, printhead: Printhead, largest_V: float
) -> float:
    """Level that reduces the largest signal by ``strength`` times what the level in ``values`` reduces it by."""
    moment = Excitation("self_sensing", "periodic", 1.0, np.zeros(1))

    def reduction_V(level: float) -> float:
        signal = np.array([largest_V])
        return largest_V - float(effect.sensing({**values, name: level}, signal, np.zeros(1), printhead, moment)[0])

    full_V = reduction_V(values[name])
    found: float = brentq(
        lambda level: reduction_V(level) - strength * full_V, values[name], HIGHEST_LEVEL * values[name]
    )
    return found


def _recorded_lines(printhead: Printhead, lines: Sequence[DriveLine] | None) -> Sequence[DriveLine]:
    """The lines given; unless given, `LINES` of the default battery, with those in `TWICE` again at the end."""
    if lines is not None:
        return lines
    once = [line for line in default_battery(printhead.frequency_Hz) if line.label in LINES]
    return [*once, *(line for line in once if line.label in TWICE)]


def _neighbour(line: DriveLine, rng: np.random.Generator) -> Real:
    """Drive of the neighbouring channel in volts, shape (n,): zero, or a pulse at a random time."""
    n = line.drive_V.size
    if rng.random() < 0.4 or line.excitation == "zero":
        return np.zeros(n)
    start, edge, dwell = int(rng.integers(n // 8, n // 2)), 15, int(rng.integers(20, 60))
    level = float(rng.uniform(40, 100))
    at = np.cumsum([0, start, edge, dwell, edge])
    return np.interp(np.arange(n), at, [0.0, 0.0, level, level, 0.0])


def _drawn_random_effect(
    effect: Effect, values: Mapping[str, float], excitation: Excitation, rng: np.random.Generator
) -> Real:
    """Random-effect signal of one recording, in standard deviations of the noise, shape (n,); 0 for other effects."""
    columns = effect.random_effect_basis(values, excitation)
    if columns is None:
        return np.zeros(excitation.samples)
    drawn: Real = values[effect.strengths[0]] * (columns @ effect.random_amplitudes(columns.shape[1], rng))
    return drawn


def effect_named(name: str) -> Effect:
    """The effect of the catalogue with the id ``name``."""
    return next(effect for effect in catalogue() if effect.id == name)
