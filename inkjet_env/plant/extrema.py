"""Local extrema of a densely sampled signal, between its samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

FLAT = 1e-12
"""Of the largest magnitude: a lesser change from sample to sample is none."""


def extrema(signal: Real, step_s: float) -> tuple[Real, Real]:
    """Times from the first sample, and values, of every local extremum, two arrays of shape (k,).

    By the parabola through the extreme sample and its neighbours; a flat top counts once, at its middle. At 200 samples
    a period of a smooth signal the value is right to 1e-5 of it. Where the slope or the signal jumps, the parabola may
    not go further beyond the sample than the gentlest curvature nearby allows. Two extrema within a step are missed.

    Examples
    --------
    >>> times_s, values = extrema(np.sin(np.arange(0, 7, 0.03)), 0.03)
    >>> times_s.round(4), values.round(6)
    (array([1.5708, 4.7124]), array([ 1., -1.]))
    """
    rises = np.diff(signal)
    moving = np.flatnonzero(np.abs(rises) > FLAT * np.abs(signal).max(initial=0.0))
    turns = np.flatnonzero(np.signbit(rises[moving[1:]]) != np.signbit(rises[moving[:-1]]))
    first, last = moving[turns] + 1, moving[turns + 1]  # samples between which the signal is flat
    at = (first + last) // 2
    bend = np.zeros(signal.size)
    bend[1:-1] = np.diff(rises)
    bend[[0, -1]] = bend[[1, -2]]
    slope = (signal[at + 1] - signal[at - 1]) / 2
    sharp = (first == last) & (bend[at] != 0)
    shift = np.zeros(at.size)
    shift[sharp] = -slope[sharp] / bend[at[sharp]]
    beyond = slope * shift / 2
    gentlest = np.min(np.abs([bend[at - 1], bend[at], bend[at + 1]]), axis=0) / 8
    return ((first + last) / 2 + shift) * step_s, signal[at] + np.clip(beyond, -gentlest, gentlest)
