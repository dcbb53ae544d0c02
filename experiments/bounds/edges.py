"""An edge of the drive in compiled code: how fast the hysteretic drive runs on it, and how much that can differ.

Edges have the number of their segment: 0 rises from 0 V to ``a = U1``, 2 falls to ``−b = U2``, 4 rises back to 0 V. In
the periodic state 0 and 4 lie on the branch from ``−b``, 2 on that from ``a``. ``θ`` runs from 0 to 1 along an edge,
and ``w = dv/dθ`` in volts."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.head_numbers import BEND, CELLS, DEGREE, GAIN, LAW, OMEGA, SCALE, SIGMA, STEEPEST

_nodes, _weights = np.polynomial.legendre.leggauss(6)
GAUSS, WEIGHT = (_nodes + 1) / 2, _weights / 2
"""Nodes and weights of Gauss–Legendre quadrature on [0, 1]."""
PANELS = 4
"""Panels of an edge over which its moments are integrated."""


@njit(cache=True)
def law_slope(head, x):
    """``Q'`` and ``Q''``; beyond ``x = 1`` the law is straight."""
    inside = min(x, 1.0)
    slope = 0.0
    bend = 0.0
    for k in range(int(head[DEGREE]) - 1, -1, -1):
        bend = bend * inside + slope
        slope = slope * inside + head[LAW + k]
    return slope, (0.0 if x > 1.0 else bend)


@njit(cache=True)
def largest_bend(head, low, high):
    """Upper bound of ``|Q''|`` for arguments from ``low`` to ``high``."""
    first, last = max(int(low * CELLS), 0), min(int(high * CELLS), CELLS - 1)
    found = 0.0
    for cell in range(first, last + 1):
        found = max(found, head[BEND + cell])
    return found


@njit(cache=True)
def speed(head, segment, a, b, theta):
    """``w`` and its derivatives in ``a`` and ``b``."""
    scale = head[SCALE]
    if segment == 0:
        slope, bend = law_slope(head, (b + a * theta) / scale)
        return slope * a, slope + bend * a * theta / scale, bend * a / scale
    if segment == 2:
        swing = a + b
        slope, bend = law_slope(head, swing * theta / scale)
        change = slope + bend * swing * theta / scale
        return -slope * swing, -change, -change
    slope, bend = law_slope(head, b * theta / scale)
    return slope * b, 0.0, slope + bend * b * theta / scale


@njit(cache=True)
def swing_of(segment, a, b):
    """Change of the drive over an edge, in volts."""
    return a if segment == 0 else (a + b if segment == 2 else b)


@njit(cache=True)
def fastest(head, segment, a, b, radius_a, radius_b, begin, stop):
    """Upper bounds of ``|w|`` and of ``|dw/dθ|`` on a part of an edge, in volts, for voltages in a box."""
    scale = head[SCALE]
    if segment == 0:
        high_a, high_b = a + radius_a, b + radius_b
        low, high = b - radius_b + (a - radius_a) * begin, high_b + high_a * stop
        swing, moved = high_a, radius_b + radius_a * stop
        own = radius_a
    elif segment == 2:
        own = radius_a + radius_b
        swing = a + b + own
        low, high, moved = (a + b - own) * begin, swing * stop, own * stop
    else:
        own = radius_b
        swing = b + radius_b
        low, high, moved = (b - radius_b) * begin, swing * stop, radius_b * stop
    bend = largest_bend(head, max(low, 0.0) / scale, high / scale)
    w, _, _ = speed(head, segment, a, b, begin)
    w_end, _, _ = speed(head, segment, a, b, stop)
    # between the ends |w| exceeds the larger one by what half a step at the largest change adds, at most
    change = bend * swing * swing / scale
    most = max(abs(w), abs(w_end)) + 0.5 * change * (stop - begin)
    return most + head[STEEPEST] * own + bend * swing * moved / scale, change


@njit(cache=True)
def straight_from(head, segment, a, b):
    """``θ`` from which on the law is straight, at ``x = 1``; 1 if nowhere."""
    scale = head[SCALE]
    if segment == 0:
        return (scale - b) / a if a + b > scale else 1.0
    if segment == 2:
        return scale / (a + b) if a + b > scale else 1.0
    return scale / b if b > scale else 1.0


@njit(cache=True)
def moments(head, segment, a, b, radius_a, radius_b, longest, found):
    """Fill ``found`` with what an edge can do for voltages in a box.

    Parameters
    ----------
    head : ndarray
        `head_numbers`.
    segment : int
        0, 2 or 4.
    a, b, radius_a, radius_b : float
        Centre and half widths of the voltages, in volts.
    longest : float
        Largest duration, in µs.
    found : ndarray, shape (5,)
        Upper bounds, in volts, of ``∫ |w| (1 − θ)^k dθ`` for k = 0, 1, 2 in the box; of the change of ``g⁻¹ z`` that
        the voltages make to first order; and of twice that to second order.
    """
    scale = head[SCALE]
    pole = math.hypot(head[SIGMA], head[OMEGA])
    found[:] = 0.0
    for panel in range(PANELS):
        for k in range(GAUSS.size):
            theta = (panel + GAUSS[k]) / PANELS
            w, in_a, in_b = speed(head, segment, a, b, theta)
            part = WEIGHT[k] / PANELS
            for power in range(3):
                found[power] += part * abs(w) * (1.0 - theta) ** power
            found[3] += part * (abs(in_a) * radius_a + abs(in_b) * radius_b)
    # The second change of v along the edge, integrated by parts: |v''(1)| + |λ| t ∫ |v''| dθ.
    total, end = 0.0, 0.0
    for panel in range(2 * PANELS):
        begin, stop = panel / (2 * PANELS), (panel + 1) / (2 * PANELS)
        if segment == 0:
            low = (b - radius_b + (a - radius_a) * begin) / scale
            high = (b + radius_b + (a + radius_a) * stop) / scale
            origin = largest_bend(head, (b - radius_b) / scale, (b + radius_b) / scale)
            end = ((radius_a * stop + radius_b) ** 2 * largest_bend(head, low, high) + radius_b**2 * origin) / scale
        else:
            moved = radius_a + radius_b if segment == 2 else radius_b
            middle = a + b if segment == 2 else b
            bend = largest_bend(head, (middle - moved) * begin / scale, (middle + moved) * stop / scale)
            end = (moved * stop) ** 2 * bend / scale
        total += end / (2 * PANELS)
    found[4] = end + pole * longest * total
    found[3] *= 1.01  # quadrature, where the law becomes straight within a panel
    for power in range(3):
        found[power] = 1.01 * found[power] + found[3] + found[4]


@njit(cache=True)
def push(head, segment, a, b, duration, begin, stop, out):
    """Fill ``out`` with what a part of an edge, θ from ``begin`` to ``stop``, adds to ``z`` at its end.

    ``out``, complex, shape (4,): the push in volts, and its derivatives in the duration (1/µs), ``a`` and ``b``.
    """
    rate = complex(-head[SIGMA], head[OMEGA]) * duration
    pole = complex(-head[SIGMA], head[OMEGA])
    out[:] = 0.0
    kink = straight_from(head, segment, a, b)
    for half in range(2):
        low = begin if half == 0 else max(begin, min(kink, stop))
        high = max(begin, min(kink, stop)) if half == 0 else stop
        if high <= low:
            continue
        for k in range(GAUSS.size):
            theta = low + GAUSS[k] * (high - low)
            w, in_a, in_b = speed(head, segment, a, b, theta)
            left = stop - theta
            turned = head[GAIN] * WEIGHT[k] * (high - low) * np.exp(rate * left)
            out[0] += turned * w
            out[1] += turned * w * pole * left
            out[2] += turned * in_a
            out[3] += turned * in_b
