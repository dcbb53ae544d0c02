"""Local extrema of a densely sampled signal, between its samples."""

from __future__ import annotations

import numpy as np

from inkjet_env.typing import Real

FLAT = 1e-12
"""Smallest change from sample to sample that counts, as a share of the largest magnitude."""


def extrema(signal: Real, step_s: float) -> tuple[Real, Real]:
    """Times from the first sample in seconds, and values, of every local extremum: two arrays of shape (k,).

    Each is the vertex of the parabola through the extreme sample and its neighbours; a flat top counts once, at its
    middle. With 200 samples per period of a smooth signal the relative error of the value is 1e-5. Where the slope or
    the signal jumps, the parabola may exceed the sample by no more than the smallest curvature nearby allows. Two
    extrema within a step are missed.

    Examples
    --------
    >>> times_s, values = extrema(np.sin(np.arange(0, 7, 0.03)), 0.03)
    >>> times_s.round(4), values.round(6)
    (array([1.5708, 4.7124]), array([ 1., -1.]))
    """
    from inkjet_env.plant import compiled

    times, values = np.empty(signal.size), np.empty(signal.size)
    count = compiled.extrema(np.ascontiguousarray(signal, dtype=np.float64), FLAT, times, values)
    return times[:count] * step_s, values[:count]
