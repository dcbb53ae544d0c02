"""Likelihood of residuals with amplitudes of their own in every recording, and of noise alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.identification.noise import NoiseModel
from inkjet_env.mismatch.fitting.dataset import Noise, ObservedRecording
from inkjet_env.plant import Effect
from inkjet_env.typing import Real


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
    return total


def amplitudes_nll(
    effect: Effect,
    values: dict[str, float],
    observed: Sequence[ObservedRecording],
    residuals: dict[str, Real],
    noise: Noise,
) -> tuple[float, Real]:
    """Negative log-likelihood with random amplitudes of the likeliest variance, and the peak in each recording."""
    squares, sizes = [], []
    explained = []
    for o in observed:
        columns = effect.random_effect_basis(values, o.excitation)
        if columns is None:
            continue
        whitened = noise.whitened(o, np.column_stack([columns, residuals[o.name]]))
        q, r = np.linalg.qr(whitened[:, :-1])
        amplitudes = q.T @ whitened[:, -1]
        squares.append(amplitudes**2)
        sizes.append(np.full(amplitudes.size, float(np.mean(np.diag(r) ** 2))))
        explained.append(columns @ np.linalg.lstsq(r, amplitudes, rcond=1e-12)[0])
    total = noise_alone_nll(observed, residuals, noise)
    if not squares:
        return total, np.zeros(1)
    a, size = np.concatenate(squares), np.concatenate(sizes)
    variances = np.geomspace(1e-3, 1e9, 200) / float(np.median(size))
    share = variances[:, None] * size
    gains = 0.5 * np.sum(a * share / (1 + share) - np.log1p(share), axis=1)
    return total - max(float(gains.max()), 0.0), np.array([np.max(np.abs(e)) for e in explained])
