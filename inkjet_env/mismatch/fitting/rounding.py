"""Recordings of a coarse converter, without the mean error of its rounding.

A converter whose step ``q`` is several times the noise ``σ`` before it makes an error that depends on the signal: near
the middle of a step it tells the same value again and again. Over a rest or a slow flank, such errors add up to what
looks like creep or an ageing law. Their mean is known once the signal ``m`` is: ``E[Q(m + ε)] - m`` for normally
distributed ``ε``, a sawtooth smoothed by the noise, whose first harmonic is ``q/π exp(-2π² σ²/q²)``. It is taken off at
the base model's signal. Where that is wrong by more than a step, what is taken off is like the rounding itself: noise.

Source: Widrow and Kollár, Quantization Noise, Cambridge, 2008, chapters 4 and 11.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from inkjet_env.identification.measurements import smallest_step
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.settings import FittingSettings
from inkjet_env.typing import Real


def rounding_error(signal: Real, step: float, origin: float, sigma: float) -> Real:
    """Mean error of rounding a signal in normally distributed noise, shape (n,), in the signal's unit.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Signal without noise.
    step : float
        Step of the converter, in the same unit.
    origin : float
        Any of the values that it tells.
    sigma : float
        Standard deviation of the noise before the converter, in the same unit; at most half a step.

    Examples
    --------
    A quiet signal a quarter of a step above a value is told as that value; noise of half a step hides the steps:

    >>> [float(rounding_error(np.array([0.25]), 1.0, 0.0, sigma).round(3)[0]) for sigma in (0.01, 0.5)]
    [-0.25, -0.002]
    """
    within = (signal - origin) / step
    within = within - np.round(within)
    told = np.zeros_like(within)
    for k in range(4):  # to 3.5 steps on each side, seven standard deviations of the largest noise
        told += ndtr((within - k - 0.5) * step / sigma) - ndtr((-within - k - 0.5) * step / sigma)
    error: Real = (told - within) * step
    return error


def without_rounding(
    observed: Sequence[ObservedRecording], modelled: Mapping[str, Real], noise: Noise, settings: FittingSettings
) -> tuple[ObservedRecording, ...]:
    """The recordings without the mean error of their converters' rounding; unchanged where noise hides the steps.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        Recordings; what was taken off before is replaced.
    modelled : mapping of str to ndarray
        Signal of each recording, in its unit, shape (n,).
    noise : Noise
        Their noise, rounding included.
    settings : FittingSettings
        From which step on rounding matters.
    """
    found = {channel: _converter(channel, observed, noise, settings) for channel in {o.channel: None for o in observed}}
    result = []
    for o in observed:
        step, origin, sigma = found[o.channel]
        if not math.isfinite(step) or sigma > settings.hidden_step * step or smallest_step(o.told) > 1.5 * step:
            result.append(o if o.rounding is None else replace(o, measured=o.told, rounding=None))
            continue
        error = rounding_error(modelled[o.name], step, origin, max(sigma, settings.sharpest_step * step))
        result.append(replace(o, measured=o.told - error, rounding=error))
    return tuple(result)


def coarse_notes(observed: Sequence[ObservedRecording], noise: Noise, settings: FittingSettings) -> tuple[str, ...]:
    """Sentences about converters whose steps are so large that only the moments at which they step tell anything."""
    notes = []
    for channel in {o.channel: None for o in observed}:
        step, _, sigma = _converter(channel, observed, noise, settings)
        if math.isfinite(step) and sigma < settings.coarse_step * step:
            notes.append(
                f"{channel}: the converter's step is more than {1 / settings.coarse_step:.0f} times the noise before "
                "it. What slow recordings show may be its rounding: record with a smaller range, or with noise added."
            )
    return tuple(notes)


def _converter(
    channel: str, observed: Sequence[ObservedRecording], noise: Noise, settings: FittingSettings
) -> tuple[float, float, float]:
    """Step of a channel's converter, infinite if there is none, one of its values, and the noise before it."""
    mine = [o for o in observed if o.channel == channel]
    step, origin = _grid(mine, settings.on_grid)
    loudest = max(noise.rms(o) for o in mine)
    return step, origin, math.sqrt(max(loudest**2 - step**2 / 12, 0.0)) if math.isfinite(step) else math.inf


def _grid(mine: Sequence[ObservedRecording], most_off: float) -> tuple[float, float]:
    """Step of a channel's converter and one of its values; an infinite step if the values are not on a grid."""
    values = np.unique(np.concatenate([o.told for o in mine]))
    step = min(smallest_step(o.told) for o in mine)
    if not math.isfinite(step):
        return math.inf, 0.0
    steps = (values - values[0]) / step
    whole = np.round(steps)
    step *= float(steps @ whole) / float(whole @ whole)
    steps = (values - values[0]) / step
    on_grid = float(np.abs(steps - np.round(steps)).max()) < most_off
    return (step if on_grid else math.inf), float(values[0])
