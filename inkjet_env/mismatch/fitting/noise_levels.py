"""Noise that is not equally loud everywhere: another level in every recording, or a level that grows with the signal.

The level is read from cells of time and frequency in which the model of the recording is not louder than the noise.
There, a mismatch, which is some change of the signal, is quieter still: what the cells hold is noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.settings import FittingSettings
from inkjet_env.typing import Real

ROUNDS = 40
"""Number of alternating updates of the recordings' levels and of the growth with the signal."""


@dataclass(frozen=True, eq=False)
class _Cells:
    """Quiet cells of one channel: power relative to the noise model, recording, and what the level may grow with."""

    power: Real
    recording: NDArray[np.intp]
    grows: Real


def noise_levels(
    observed: Sequence[ObservedRecording],
    white: Mapping[str, Real],
    modelled: Mapping[str, Real],
    settings: FittingSettings,
) -> dict[str, Real]:
    """Level of the noise over time where it differs from a stationary model's.

    For each channel, six models are compared by Schwarz's criterion: the level is the same everywhere, differs at rest
    (a converter's steps hide noise there), or differs between recordings; it may also grow with the squares of the
    signal and of its slope.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        The recordings.
    white : mapping of str to ndarray, shape (n, 2)
        By recording: residual and modelled signal, whitened by the stationary model.
    modelled : mapping of str to ndarray, shape (n,)
        By recording: modelled signal without what it is at rest, in the channel's unit.
    settings : FittingSettings
        Sizes of the cells.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        Standard deviation of the noise relative to the stationary model's, of every recording of the channels where it
        is not the same everywhere.
    """
    found: dict[str, Real] = {}
    for channel in sorted({o.channel for o in observed} - {"drive_monitor"}):
        mine = [o for o in observed if o.channel == channel and o.excitation.samples >= 8 * settings.level_windows]
        slopes = {o.name: np.gradient(modelled[o.name]) / np.float64(o.excitation.step_s) for o in mine}
        largest = max((float(np.abs(modelled[o.name]).max()) for o in mine), default=0.0)
        steepest = max((float(np.abs(slopes[o.name]).max()) for o in mine), default=0.0)
        if not (largest > 0 and steepest > 0):
            continue
        shapes = {
            o.name: np.column_stack([(modelled[o.name] / largest) ** 2, (slopes[o.name] / steepest) ** 2]) for o in mine
        }
        cells = _cells(mine, white, shapes, settings)
        if cells is None:
            continue
        level, growth = _fitted(cells, np.array([o.at_rest for o in mine]), settings.level_at_rest)
        if level is None and growth is None:
            continue
        own, grows = level if level is not None else np.ones(len(mine)), growth if growth is not None else np.zeros(2)
        for k, o in enumerate(mine):
            found[o.name] = np.sqrt(own[k] * (1 + shapes[o.name] @ grows))
    return found


def _cells(
    observed: Sequence[ObservedRecording],
    white: Mapping[str, Real],
    shapes: Mapping[str, Real],
    settings: FittingSettings,
) -> _Cells | None:
    powers, recordings, grows = [], [], []
    for k, o in enumerate(observed):
        samples = o.excitation.samples
        length = min(settings.level_window, 2 * (samples // (2 * settings.level_windows)))
        window = np.hanning(length + 1)[:-1]
        count = samples // length
        cut = white[o.name][: count * length].reshape(count, length, 2)
        lines = np.abs(np.fft.rfft(cut * window[:, None], axis=1)[:, 2 : length // 2 : 2]) ** 2
        lines = lines / np.float64(window @ window)
        quiet = lines[..., 1] < settings.quiet_cell
        if np.count_nonzero(quiet) < settings.level_cells:
            continue
        weights = window**2 / np.float64(window @ window)
        shape = np.einsum("cls,l->cs", shapes[o.name][: count * length].reshape(count, length, 2), weights)
        where, _ = np.nonzero(quiet)
        powers.append(lines[..., 0][quiet])
        recordings.append(np.full(where.size, k))
        grows.append(shape[where])
    if not powers:
        return None
    return _Cells(np.concatenate(powers), np.concatenate(recordings), np.concatenate(grows))


def _fitted(cells: _Cells, at_rest: NDArray[np.bool_], least_ratio: float) -> tuple[Real | None, Real | None]:
    """Squared level of each recording (k,) and growth (2,) of the model with the best criterion; None where absent.

    ``at_rest`` tells the recordings without a drive, shape (k,); ``least_ratio`` is the least ratio of their squared
    level to that of the others, or the other way round, that counts.
    """
    price, k = 0.5 * np.log(cells.power.size), at_rest.size
    best: tuple[float, Real | None, Real | None] = (-np.inf, None, None)
    for groups in (np.zeros(k, dtype=np.intp), at_rest.astype(np.intp), np.arange(k)):
        of_cells = groups[cells.recording]
        present = np.unique(of_cells).size
        for grown in (False, True):
            level, growth = _likeliest(cells, of_cells, k, grown)
            if groups.max() == 1 and k > 2 and present == 2:
                ratio = level[0] / level[1]
                if max(ratio, 1 / ratio) < least_ratio:
                    continue
            variance = level[of_cells] * (1 + cells.grows @ growth)
            likelihood = -float(np.sum(np.log(variance) + cells.power / variance))
            score = likelihood - price * (present + np.count_nonzero(growth))
            if score > best[0]:
                best = (score, level[groups] if present > 1 else None, growth if grown else None)
    return best[1], best[2]


def _likeliest(cells: _Cells, group: NDArray[np.intp], groups: int, grown: bool) -> tuple[Real, Real]:
    """Squared levels by group, and growth, by maximum likelihood of exponential cell powers: multiplicative updates."""
    growth: Real = np.full(2, 0.1 if grown else 0.0)
    count = np.bincount(group, minlength=groups)
    level: Real = np.ones(groups)
    for _ in range(ROUNDS if grown else 1):
        relative = cells.power / (1 + cells.grows @ growth)
        total = np.bincount(group, weights=relative, minlength=groups)
        level = np.maximum(np.where(count > 0, total / np.maximum(count, 1), relative.mean()), 1e-12)
        if grown:
            power, shape = cells.power / level[group], 1 + cells.grows @ growth
            rising, falling = cells.grows.T @ (power / shape**2), cells.grows.T @ (1 / shape)
            growth = growth * np.sqrt(rising / np.maximum(falling, 1e-300))
    growth = np.where(growth > 1e-2, growth, 0.0)
    return level, growth
