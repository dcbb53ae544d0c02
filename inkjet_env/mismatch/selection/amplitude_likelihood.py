"""Likelihood of residuals with amplitudes of their own in every recording, and of noise alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.identification.noise import NoiseModel
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.plant import Effect
from inkjet_env.typing import Real

VARIANCES = np.geomspace(1e-3, 1e9, 200)
"""Variances of the amplitudes that are tried, in units of what noise alone makes of an amplitude."""


def without_amplitudes(
    effect: Effect, values: dict[str, float], observed: Sequence[ObservedRecording], residuals: dict[str, Real]
) -> dict[str, Real]:
    """Residuals of each recording after the effect's amplitudes have been fitted to it, in the channel's unit."""
    result = dict(residuals)
    for o in observed:
        columns = None if o.channel == "drive_monitor" else effect.random_effect_basis(values, o.excitation)
        if columns is not None:
            result[o.name] = residuals[o.name] - columns @ np.linalg.lstsq(columns, residuals[o.name], rcond=None)[0]
    return result


def white(noise: Noise) -> Noise:
    """White noise of the same power."""
    models = {key: NoiseModel(np.ones(1), m.rms, m.rms, m.source) for key, m in noise.models.items()}
    return replace(noise, models=models)


def noise_alone_nll(observed: Sequence[ObservedRecording], residuals: dict[str, Real], noise: Noise) -> float:
    """Negative log-likelihood of the residuals as noise alone."""
    total = 0.0
    for o in observed:
        whitened = noise.whitened(o, residuals[o.name])
        total += o.excitation.samples * noise.log_scale(o) + 0.5 * float(whitened @ whitened)
        lost = noise.lost(o)
        if lost:  # samples that whitening drops have the noise's variance
            scale = noise.models[o.noise_key].rms * noise.levels.get(o.name, np.ones(lost))[:lost]
            dropped = residuals[o.name][:lost] / scale
            total += float(np.sum(np.log(scale) - noise.log_scale(o)) + 0.5 * dropped @ dropped)
    return total


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """Amplitudes of a random effect in several recordings, by generalised least squares.

    Attributes
    ----------
    squares : ndarray, shape (k,)
        Squares of all amplitudes, in units of their variance from noise alone.
    sizes : ndarray, shape (k,)
        For each of them, the power that an amplitude of variance 1 adds to it.
    peaks : ndarray, shape (recordings,)
        Largest magnitude of what is added to each recording, in the channel's unit.
    """

    squares: Real
    sizes: Real
    peaks: Real

    @property
    def variance(self) -> float:
        """Likeliest variance of the amplitudes; 0 without any."""
        if not self.squares.size:
            return 0.0
        variances = VARIANCES / float(np.median(self.sizes))
        gains = [self.gain(float(variance)) for variance in variances]
        best = int(np.argmax(gains))
        return float(variances[best]) if gains[best] > 0 else 0.0

    def gain(self, variance: float) -> float:
        """Log-likelihood that amplitudes of this variance gain over none."""
        share = variance * self.sizes
        return 0.5 * float(np.sum(self.squares * share / (1 + share) - np.log1p(share)))


def amplitudes_of(
    effect: Effect,
    values: dict[str, float],
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
) -> Amplitudes:
    """The amplitudes of a random effect in the residuals of these recordings."""
    squares, sizes, peaks = [np.zeros(0)], [np.zeros(0)], []
    for o in observed:
        columns = effect.random_effect_basis(values, o.excitation)
        if columns is None:
            continue
        whitened = noise.whitened(o, np.column_stack([columns, residuals[o.name]]))
        q, r = np.linalg.qr(whitened[:, :-1])
        amplitudes = q.T @ whitened[:, -1]
        powers, axes = np.linalg.eigh(r @ r.T)  # amplitudes of one variance are independent along these axes
        squares.append((axes.T @ amplitudes) ** 2)
        sizes.append(np.maximum(powers, 0.0))
        explained = columns @ np.linalg.lstsq(r, amplitudes, rcond=1e-12)[0]
        peaks.append(float(np.max(np.abs(explained))))
    return Amplitudes(np.concatenate(squares), np.concatenate(sizes), np.array(peaks or [0.0]))


def amplitudes_nll(
    effect: Effect,
    values: dict[str, float],
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
) -> tuple[float, Real]:
    """Negative log-likelihood with random amplitudes of the likeliest variance, and the peak in each recording."""
    found = amplitudes_of(effect, values, observed, residuals, noise)
    total = noise_alone_nll(observed, residuals, noise)
    return total - max(found.gain(found.variance), 0.0), found.peaks
