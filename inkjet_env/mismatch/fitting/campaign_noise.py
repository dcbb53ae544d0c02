"""Noise of a campaign as the diagnosis sees it: its spectrum, and its level where that is not the same everywhere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from inkjet_env.identification.measurements import RepeatedMeasurement, least_noise
from inkjet_env.identification.noise import NoiseModel, channel_noise, noise_model, repeat_deviations, whittle
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.noise_levels import noise_levels
from inkjet_env.mismatch.fitting.offset_scatter import offset_scatter
from inkjet_env.mismatch.settings import FittingSettings
from inkjet_env.typing import Real

FLAT_BELOW_FIRST_LINE = 0.5 / np.pi
"""Longest memory of noise in durations of the longest recording. A longer one is a drift."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a campaign.

    Attributes
    ----------
    models : dict
        Noise model by `ObservedRecording.noise_key`.
    samples : dict
        Number of independent samples from which each model was estimated, by the same key: of repeats, those beyond
        their mean. 0 if it comes from a fit's residuals.
    notes : tuple of str
        Sentences for the user about how the noise was estimated.
    least : dict of str to float
        By channel, the least RMS that can be resolved, in the channel's unit: that of its converter's step.
    levels : dict of str to ndarray, shape (n,)
        By recording, the noise's standard deviation over time relative to the model's, where it is not the same
        everywhere; see `noise_levels`.
    tails : dict of str to float
        By channel, the variance of the noise's power, relative to that of normally distributed noise; at least 1.
    borrowed : dict
        Of keys without repeats or rest of their own: the key of another sampling step from which the model was
        converted.
    offsets : dict of str to float
        By channel, the standard deviation of recordings' offsets beyond that of the model, in the channel's unit, where
        there is any; see `offset_scatter`.
    """

    models: Mapping[tuple[str, float], NoiseModel]
    samples: Mapping[tuple[str, float], int]
    notes: tuple[str, ...] = ()
    least: Mapping[str, float] = field(default_factory=dict)
    levels: Mapping[str, Real] = field(default_factory=dict)
    tails: Mapping[str, float] = field(default_factory=dict)
    borrowed: Mapping[tuple[str, float], tuple[str, float]] = field(default_factory=dict)
    offsets: Mapping[str, float] = field(default_factory=dict)
    _kept: dict[tuple[tuple[str, float], int], Real] = field(default_factory=dict, init=False, repr=False)
    _constants: dict[tuple[object, ...], tuple[Real, float]] = field(default_factory=dict, init=False, repr=False)

    def known(self, observed: ObservedRecording) -> bool:
        """Whether the noise was estimated from anything but a fit's own residuals."""
        return self.samples[observed.noise_key] > 0

    def whitened(self, observed: ObservedRecording, columns: Real) -> Real:
        """Columns of shape (n, k) or (n,), filtered so that the noise in them is white with unit variance.

        The shape is kept: the first samples, at which the filter is not yet full, are zero.
        """
        flat = columns.ndim == 1
        table = self._of_one_offset(observed, columns[:, None] if flat else columns)
        if observed.channel in self.offsets:
            constant, size = self._constant(observed)
            less = (1 - 1 / math.sqrt(1 + self.offsets[observed.channel] ** 2 * size)) / size
            table = table - np.outer(constant, less * (constant @ table))
        return table[:, 0] if flat else table

    def _of_one_offset(self, observed: ObservedRecording, table: Real) -> Real:
        """As `whitened`, of noise whose offset is the same in all recordings."""
        model = self.models[observed.noise_key]
        if observed.name in self.levels:
            table = table / self.levels[observed.name][:, None]
        white = model.whitened(table)
        result = np.zeros(table.shape)
        result[table.shape[0] - white.shape[0] :] = white
        if model.bands and white.size:
            from scipy.fft import irfft, next_fast_len, rfft

            length = next_fast_len(table.shape[0], real=True)
            lines = rfft(result, length, axis=0) / self._roots(observed.noise_key, length)
            result = irfft(lines, length, axis=0)[: table.shape[0]]
            result[: table.shape[0] - white.shape[0]] = 0.0
        return result

    def _constant(self, observed: ObservedRecording) -> tuple[Real, float]:
        """A whitened offset of one unit, shape (n,), and its sum of squares."""
        samples = observed.excitation.samples
        key = (observed.name, observed.noise_key, samples)  # proposals of a next experiment share one name
        if key not in self._constants:
            constant = self._of_one_offset(observed, np.ones((samples, 1)))[:, 0]
            self._constants[key] = constant, max(float(constant @ constant), 1e-300)
        return self._constants[key]

    def lost(self, observed: ObservedRecording) -> int:
        """Number of samples at the start of a recording that whitening drops."""
        return min(self.models[observed.noise_key].lost, observed.excitation.samples)

    def rms(self, observed: ObservedRecording) -> float:
        """Standard deviation of the noise in a recording, in the channel's unit."""
        level = self.levels.get(observed.name)
        return self.models[observed.noise_key].rms * (1.0 if level is None else float(np.sqrt(np.mean(level**2))))

    def tail(self, observed: ObservedRecording) -> float:
        """Variance of the noise's power in a recording, relative to that of normally distributed noise."""
        return self.tails.get(observed.channel, 1.0)

    def doubt(self, observed: Sequence[ObservedRecording]) -> float:
        """Standard deviation of the sum of squared residuals that a right model leaves in the fitted rows.

        The noise's own level is as uncertain as the samples from which it was estimated are few.
        """
        rows: dict[tuple[str, float], int] = {}
        for o in observed:
            key = self.borrowed.get(o.noise_key, o.noise_key)
            rows[key] = rows.get(key, 0) + o.fitted
        variances = [
            self.tails.get(key[0], 1.0) * (2 * n + 2 * n**2 / max(self.samples[key], 1)) for key, n in rows.items()
        ]
        return math.sqrt(sum(variances))

    def _roots(self, key: tuple[str, float], length: int) -> Real:
        """Amplitude of whitened noise at each line of a real Fourier transform, shape (length // 2 + 1, 1)."""
        if (key, length) not in self._kept:
            self._kept[key, length] = np.sqrt(self.models[key].levels(length)[: length // 2 + 1])[:, None]
        return self._kept[key, length]

    def log_scale(self, observed: ObservedRecording) -> float:
        """Mean logarithm of the noise's innovation: the log-likelihood that larger noise costs per sample."""
        model = self.models[observed.noise_key]
        scale = float(np.log(model.innovation))
        if model.bands:
            scale += 0.5 * float(np.mean(np.log(model.levels(observed.excitation.samples))))
        if observed.name in self.levels:
            scale += float(np.mean(np.log(self.levels[observed.name])))
        if observed.channel in self.offsets:
            spread = self.offsets[observed.channel] ** 2 * self._constant(observed)[1]
            scale += 0.5 * math.log1p(spread) / observed.excitation.samples
        return scale


def noise_seen(
    observed: Sequence[ObservedRecording],
    residuals: Mapping[str, Real],
    otherwise: Mapping[tuple[str, float], NoiseModel],
    settings: FittingSettings,
    least: Mapping[str, float] | None = None,
) -> Noise:
    """Noise of each channel and sampling step, estimated from what no model of the head can explain.

    It is estimated from recordings at rest and from the differences between the residuals of repeats. Where repeats
    differ by more than the noise at rest, recordings at rest alone count, and a note says so. If there are neither, the
    rest before the drive is used, then the channel's noise at another sampling step, then the residuals themselves.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        Recordings whose noise is estimated.
    residuals : mapping of str to ndarray
        Measured minus modelled of each recording, in the channel's unit, shape (n,).
    otherwise : mapping
        Noise models by `ObservedRecording.noise_key`, used where nothing but residuals is available.
    settings : FittingSettings
        Thresholds of the estimate.
    least : mapping, optional
        ``Noise.least``; computed from these recordings unless given. Pass the campaign's if these are only part of it.
    """
    least = least or _least(observed)
    stationary = _stationary(observed, residuals, otherwise, settings, least)
    modelled = {o.name: o.measured - residuals[o.name] for o in observed}
    for channel in sorted({o.channel for o in observed}):
        mine = [o for o in observed if o.channel == channel]
        at_rest = [modelled[o.name] for o in mine if o.at_rest] or [modelled[o.name] for o in mine]
        rest = float(np.median(np.concatenate(at_rest)))
        modelled |= {o.name: modelled[o.name] - rest for o in mine}
    white = {o.name: stationary.whitened(o, np.column_stack([residuals[o.name], modelled[o.name]])) for o in observed}
    levels = noise_levels(observed, white, modelled, settings)
    if levels:
        floor = {o.name: least[o.channel] / stationary.models[o.noise_key].rms for o in observed}
        levels = {name: np.maximum(level, floor[name]) for name, level in levels.items()}
        level_one = {
            o.name: residuals[o.name] / levels[o.name] if o.name in levels else residuals[o.name] for o in observed
        }
        stationary = replace(_stationary(observed, level_one, otherwise, settings, least), levels=levels)
    ones = {o.name: np.ones(o.excitation.samples) for o in observed}
    white = {o.name: stationary.whitened(o, np.column_stack([ones[o.name], residuals[o.name]])) for o in observed}
    return replace(stationary, offsets=offset_scatter(observed, white, settings))


def _stationary(
    observed: Sequence[ObservedRecording],
    residuals: Mapping[str, Real],
    otherwise: Mapping[tuple[str, float], NoiseModel],
    settings: FittingSettings,
    least: Mapping[str, float],
) -> Noise:
    """Noise of the same level everywhere; parameters as of `noise_seen`."""
    models: dict[tuple[str, float], NoiseModel] = {}
    samples: dict[tuple[str, float], int] = {}
    notes: list[str] = []
    seen: dict[str, dict[float, list[Real]]] = {}
    sources: dict[str, dict[float, str]] = {}
    tails: dict[str, float] = {}
    borrowed: dict[tuple[str, float], tuple[str, float]] = {}
    for key in sorted({o.noise_key for o in observed}):
        mine = [o for o in observed if o.noise_key == key]
        resting = [residuals[o.name] for o in mine if o.at_rest]
        source = ["recordings at rest"] if resting else []
        if resting:
            level = np.concatenate(resting).mean()
            resting = [stretch - level for stretch in resting]
        repeated, means = [], 0
        for condition in sorted({o.condition for o in mine if not o.still}):
            same = [residuals[o.name] for o in mine if o.condition == condition]
            repeated.extend(repeat_deviations(same))
            means += same[0].size if len(same) > 1 else 0
        if resting and repeated:
            ratio = _power(repeated) / max(_power(resting), least[key[0]] ** 2, 1e-300)
            if ratio > settings.repeats_to_rest_variance:
                notes.append(
                    f"{key[0]}: repeats of the same drive differ by {np.sqrt(ratio):.2g} times the noise at rest; "
                    "something changes between recordings."
                )
                repeated, means = [], 0
        if repeated:
            source.append("repeats")
        if not (resting or repeated):
            before = [residuals[o.name][: _rest_before(o)] for o in mine]
            resting = [stretch - stretch.mean() for stretch in before if stretch.size >= settings.shortest_rest]
            source = ["samples before the drive"]
        stretches = resting + repeated
        if stretches:
            seen.setdefault(key[0], {})[key[1]] = stretches
            sources.setdefault(key[0], {})[key[1]] = " and ".join(source)
            samples[key] = sum(stretch.size for stretch in stretches) - means
    for channel, by_step in seen.items():
        # noise with a longer memory is a drift, which is left for the diagnosis to find
        found = channel_noise(by_step, sources[channel], least[channel], longest_memory=FLAT_BELOW_FIRST_LINE)
        longest = max(o.excitation.samples for o in observed if o.channel == channel)
        for step_s, model in found.items():
            slight = float(model.levels(longest).max()) < 1 + settings.slight_memory
            models[channel, step_s] = replace(model, bands=()) if slight else model
        tails[channel] = _tail(by_step, found)
    for key in sorted({o.noise_key for o in observed} - set(models)):
        known = [k[1] for k in models if k[0] == key[0] and samples[k] and k not in borrowed]
        if known:
            nearest = known[int(np.argmin(np.abs(np.log(np.array(known) / key[1]))))]
            converted = models[key[0], nearest].at_step(key[1] / nearest)
            models[key] = of_own_colour(
                converted, [residuals[o.name] for o in observed if o.noise_key == key], settings
            )
            samples[key] = samples[key[0], nearest]
            borrowed[key] = key[0], nearest
        else:
            stretches = [residuals[o.name] for o in observed if o.noise_key == key]
            models[key], samples[key] = otherwise.get(key) or _of_most(stretches, least[key[0]]), 0
            notes.append(
                f"{key[0]}: the noise is unknown without repeats or recordings at rest; residuals were taken for it."
            )
    return Noise(models, samples, tuple(notes), least, tails=tails, borrowed=borrowed)


def of_own_colour(model: NoiseModel, residuals: Sequence[Real], settings: FittingSettings) -> NoiseModel:
    """A noise model that was converted from another sampling step, with the colour that residuals at this step show.

    Neighbouring samples of a sensor's noise are the more alike the closer they are, which noise sampled more rarely
    does not tell. The residuals may hold a mismatch, so only their upper lines are used, and only where they are no
    louder than the noise at the other step, but far more likely to have another colour, and slow noise gets no quieter.

    Parameters
    ----------
    model : NoiseModel
        The converted model.
    residuals : sequence of ndarray
        Measured minus modelled of the recordings at this step, in the channel's unit.
    settings : FittingSettings
        Which lines are the upper ones, and what "louder" and "far more" mean.
    """
    first = [int(settings.upper_lines * r.size / 2) + 1 for r in residuals]
    own = model
    for _ in range(settings.colour_rounds):
        filled = [_filled(r, k, own) for r, k in zip(residuals, first, strict=True)]
        own = noise_model(filled, f"{model.source}, in colour the residuals at this sampling step", 0.0)
    gain = sum(whittle(own, [r], k) - whittle(model, [r], k) for r, k in zip(residuals, first, strict=True))
    size = max(r.size for r in residuals)
    lower = slice(1, max(first) + 1)  # their noise is not seen here, and must not be taken for quieter
    quieter = _density(own, size)[lower].mean() < _density(model, size)[lower].mean()
    louder = own.rms > settings.louder_colour * model.rms
    return own if not (quieter or louder) and gain > settings.other_colour_gain else model


def _density(model: NoiseModel, samples: int) -> Real:
    """Expected power of a model at each line of a discrete Fourier transform, shape (samples,)."""
    density: Real = model.innovation**2 * model.levels(samples) / model.passed(samples)
    return density


def _filled(residuals: Real, first: int, model: NoiseModel) -> Real:
    """Residuals whose lines below the given one have the power that a model expects."""
    lines = np.fft.rfft(residuals)
    density = _density(model, residuals.size)[:first]
    lines[:first] *= np.sqrt(density * residuals.size) / np.maximum(np.abs(lines[:first]), 1e-300)
    filled: Real = np.fft.irfft(lines, residuals.size)
    return filled


def _tail(stretches: Mapping[float, Sequence[Real]], models: Mapping[float, NoiseModel]) -> float:
    """Variance of the whitened noise's power relative to that of a normal distribution; at least 1."""
    white = np.concatenate(
        [models[step].whitened(one[:, None])[:, 0] for step, mine in stretches.items() for one in mine]
    )
    power = white**2
    mean = float(power.mean()) if power.size else 0.0
    return max(1.0, float(power.var()) / (2 * mean**2)) if mean > 0 else 1.0


def _of_most(stretches: Sequence[Real], least: float) -> NoiseModel:
    """White noise as large as most samples' residuals: the few samples where a model fails do not count."""
    size = np.abs(np.concatenate([stretch - np.median(stretch) for stretch in stretches]))
    rms = max(1.4826 * float(np.median(size)), least)
    return NoiseModel(np.ones(1), rms, rms, "the level of most residuals")


def _power(stretches: Sequence[Real]) -> float:
    return float(np.mean(np.concatenate(stretches) ** 2))


def _rest_before(observed: ObservedRecording) -> int:
    drive = observed.excitation.drive_V
    if observed.excitation.initial_state != "demagnetised" or drive[0] != 0:
        return 0
    return int(np.argmax(drive != 0))


def _least(observed: Sequence[ObservedRecording]) -> dict[str, float]:
    """By channel, the least RMS that can be resolved, in the channel's unit."""
    return least_noise(
        [
            RepeatedMeasurement(
                o.channel,
                o.unit,
                o.excitation.initial_state,
                o.excitation.drive_V,
                o.excitation.step_s,
                (o.told,),
                (o.name,),
                o.fitted,
            )
            for o in observed
        ]
    )
