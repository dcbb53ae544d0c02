"""The numbers of a head that the search for bounds needs, as one row for compiled code.

This package counts in microseconds and volts. With ``λ = −σ + iω``, pole of the resonator, the response is
``y = Im z`` where ``z' = λ z + g v'`` and ``g = b1 / ω``: free, ``z`` turns and shrinks, and an edge pushes it along
the real axis. Extrema of ``y`` are where ``Im(λ z) = 0``."""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

MAX_DEGREE = 16
CELLS = 64
"""Number of equal cells of 0 ≤ x ≤ 1 on which ``|Q''|`` is bounded."""
SIGMA, OMEGA, GAIN, SCALE, STEEPEST, DEGREE = range(6)
LAW = 6  # Q', lowest power first
BEND = LAW + MAX_DEGREE  # largest |Q''| on each cell
COLUMNS = BEND + CELLS


def head_numbers(head: Printhead) -> Real:
    """σ and ω in 1/µs, g, full scale in volts, largest ``Q'``, number of its coefficients, they, and bounds of ``Q''``.

    Raises
    ------
    ValueError
        The law does not rise everywhere, or its degree is above `MAX_DEGREE`.
    """
    sigma = 0.5e-6 * head.a1
    omega = math.sqrt((1e-6 * head.frequency_Hz * 2 * math.pi) ** 2 - sigma**2)
    law = np.array(head.coefficients[::-1])
    slope = law[1:] * np.arange(1, law.size)
    bend = slope[1:] * np.arange(1, slope.size)
    if slope.size > MAX_DEGREE:
        raise ValueError(f"the branch law has degree {slope.size}; bounds are for degrees up to {MAX_DEGREE}.")
    least, most = np.array([polynomial_range(slope, k / CELLS, (k + 1) / CELLS) for k in range(CELLS)]).T
    if least.min() < 0:
        raise ValueError(f"the branch law falls: its slope is down to {least.min():.3g}. Bounds are for rising laws.")
    row = np.zeros(COLUMNS)
    row[:LAW] = sigma, omega, 1e-6 * head.b1 / omega, head.full_scale_V, most.max(), slope.size
    row[LAW : LAW + slope.size] = slope
    ends = [polynomial_range(bend, k / CELLS, (k + 1) / CELLS) for k in range(CELLS)]
    row[BEND:] = [max(-low, high) for low, high in ends]
    return row


def polynomial_range(coefficients: Real, low: float, high: float) -> tuple[float, float]:
    """Bounds of a polynomial, lowest power first, on an interval: those of its Bernstein coefficients there.

    Source: R. T. Farouki, "The Bernstein polynomial basis: a centennial retrospective", CAGD 29 (2012) 379.
    """
    n = coefficients.size - 1
    if n < 0:
        return 0.0, 0.0
    shifted = np.polynomial.Polynomial(coefficients)(np.polynomial.Polynomial([low, high - low])).coef
    power = np.zeros(n + 1)
    power[: shifted.size] = shifted
    bernstein = [sum(math.comb(i, k) / math.comb(n, k) * power[k] for k in range(i + 1)) for i in range(n + 1)]
    margin = 1e-12 * (1.0 + float(np.abs(power).sum()))
    return min(bernstein) - margin, max(bernstein) + margin
