"""Echo of a signal: a wave that returns, delayed and weaker, from one end of a channel or from both."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.lag import decay_per_period, lag_weights
from inkjet_env.typing import Real

FAINT = 1e-4
"""Relative strength below which a wave is no longer followed."""


@dataclass(frozen=True)
class Echo:
    """Returning part of a wave that travels both ways in a channel with two ends.

    Attributes
    ----------
    delay_s, strength : float
        Time in seconds until the wave is back from the first end, and its amplitude then, relative to the outgoing one.
    second_delay_s : float
        The same delay for the other end, in seconds.
    reflection, second_reflection : float
        Reflection coefficients r1, r2 of the ends; with ``r2 = 0`` the other end reflects nothing and the wave returns
        once.
    loss_s : float
        Time constant, in seconds, of a first-order lag at each reflection.
    """

    delay_s: float
    strength: float
    second_delay_s: float = 0.0
    reflection: float = 1.0
    second_reflection: float = 0.0
    loss_s: float = 0.0

    def of(self, signal: Real, step_s: float, periodic: bool) -> Real:
        """Echo of a signal, ``α (z1 + r2/r1 z2 + 2 r2 z1 z2) / (1 - r1 r2 z1 z2)`` with lossy delays z, shape (n,)."""

        def heard(wave: Real, delay_s: float, ends: int) -> Real:
            return returned(wave, delay_s / step_s, periodic, ends, self.loss_s / step_s)

        first = heard(signal, self.delay_s, 1)
        r1, r2 = self.reflection, self.second_reflection
        if r2 == 0:
            return self.strength * first
        if r1 == 0:
            raise SimulationError("a wave returns from an end that reflects nothing.")
        round_trip_s = self.delay_s + self.second_delay_s
        around = heard(signal, round_trip_s, 2)
        total = wave = first + r2 / r1 * heard(signal, self.second_delay_s, 1) + 2 * r2 * around
        warm_up_periods = math.ceil(math.log(FAINT) / math.log(max(abs(r1 * r2), FAINT)))
        if not periodic:
            warm_up_periods = min(warm_up_periods, int(signal.size * step_s / round_trip_s))
        for _ in range(warm_up_periods):
            wave = r1 * r2 * heard(wave, round_trip_s, 2)
            total = total + wave
        return self.strength * total


def returned(signal: Real, samples: float, periodic: bool, ends: int = 0, loss_samples: float = 0.0) -> Real:
    """A signal delayed by some samples, with cubic interpolation, behind a first-order lag for each reflection.

    Before the first sample the signal is held at its value there.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Signal at the samples.
    samples : float
        Delay in samples; may be negative and fractional.
    periodic : bool
        Whether the sample after the last is the first.
    ends : int
        Number of reflections, each with its lag.
    loss_samples : float
        Time constant of the lag, in samples.

    Returns
    -------
    ndarray, shape (n,)
        The delayed signal, in the unit of ``signal``.
    """
    from inkjet_env.plant import compiled

    whole = math.floor(samples)
    t = 1 - (samples - whole)
    weights = np.array(  # Lagrange's cubic through the two samples on either side
        [
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        ]
    )
    if loss_samples <= 0:
        ends = 0
    lag, decay = lag_weights(loss_samples, 1.0), decay_per_period(loss_samples, signal.size)
    result = np.empty(signal.size)
    compiled.returned(np.ascontiguousarray(signal), whole, weights, ends, lag, decay, periodic, result)
    return result
