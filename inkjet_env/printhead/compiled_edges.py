"""Compiled kernels of one stretch of the response: an edge of the drive, or a free ring-down.

A head is one row of numbers (`HEAD_…` are its columns). On an edge the response, Eq. (7) of `resonator`, is either the
power series of the whole solution (short edges, where the particular polynomial would cancel) or the particular
polynomial plus a ring-down (long edges). Extrema are isolated as in `resonator`, by a bound on ``y'''`` which proves
that an interval holds none or at most one.
"""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead.kernel_cache import INTERNAL, kernel_jit

MAX_DEGREE = 16
"""Largest degree of the branch law."""

CURVATURE_CELLS = 32
"""Number of equal cells of 0 ≤ x ≤ 1 on which ``|Q''|`` is bounded."""

(HEAD_A0, HEAD_A1, HEAD_B1, HEAD_FULL_SCALE, HEAD_DEGREE, HEAD_END_SLOPE) = range(6)
HEAD_SLOPE = 6  # Q' lowest power first, MAX_DEGREE columns
HEAD_CURVATURE = HEAD_SLOPE + MAX_DEGREE  # max |Q''| on each of CURVATURE_CELLS cells of 0 ≤ x ≤ 1
HEAD_COLUMNS = HEAD_CURVATURE + CURVATURE_CELLS

# Edges up to |λT| = degree / 4 are summed as a power series; longer ones use the particular polynomial, whose error
# grows like degree! / |λT|^degree.
SERIES_PER_DEGREE = 0.25
SERIES_TERMS = 64
"""Largest number of terms of the power series."""
_RECIPROCALS = 1.0 / ((np.arange(SERIES_TERMS) + 1.0) * (np.arange(SERIES_TERMS) + 2.0))
NODE_SPACING = 1.0  # distance in |λ| t between the nodes that isolate extrema
INFINITE_TAIL_FLOOR = 1e-12
"""Extrema of an endless ring-down are listed until they fall below this share of its first one."""

OVERFLOW = -1
"""Count returned when the arrays for the extrema are too short."""

FAST = {"contract", "nsz"}
"""Floating-point optimisations of the kernels: fused multiply-add, and no distinction of −0 from 0."""
_internal = kernel_jit(__file__, fastmath=FAST, **INTERNAL)
# Function calls cost a fifth of the run time. LLVM inlines in half the time that numba takes (``inline="always"``).
_inlined = kernel_jit(__file__, fastmath=FAST, forceinline=True, **INTERNAL)
_inlined_early = kernel_jit(__file__, fastmath=FAST, inline="always", **INTERNAL)


@_internal
def piece_rate(head, x_start, x_change, scale_V, rate):
    """Fill ``rate`` with dv/dτ in volts on a branch piece, lowest power first; return its number of coefficients."""
    if x_start >= 1.0:
        rate[0] = scale_V * x_change * head[HEAD_END_SLOPE]
        return 1
    n = int(head[HEAD_DEGREE])
    for k in range(n):
        rate[k] = head[HEAD_SLOPE + k]
    if x_start != 0.0:
        for k in range(n - 1):  # Taylor shift by repeated synthetic division
            for j in range(n - 2, k - 1, -1):
                rate[j] += x_start * rate[j + 1]
    factor = scale_V
    for k in range(n):
        factor *= x_change
        rate[k] *= factor
    return n


@_inlined
def solve_piece(head, y, slope, duration, rate, n, series):
    """Fill ``series`` with coefficients of the response in τ on an edge; return their number, negated for long edges.

    On a short edge ``series`` is the whole solution. On a long edge it is the particular polynomial, and the ring-down
    supplies the difference at τ = 0.
    """
    a0, a1 = head[HEAD_A0], head[HEAD_A1]
    stiffness = a0 * duration * duration
    damping = a1 * duration
    force = head[HEAD_B1] * duration
    if stiffness <= (SERIES_PER_DEGREE * head[HEAD_DEGREE]) ** 2:
        series[0] = y
        series[1] = slope * duration
        largest = abs(series[0]) + abs(series[1])
        k = 0
        while True:
            f = force * rate[k] if k < n else 0.0
            # Eq. (7), coefficient of τ^k.
            term = (f - damping * (k + 1) * series[k + 1] - stiffness * series[k]) * _RECIPROCALS[k]
            series[k + 2] = term
            largest = max(largest, abs(term))
            k += 1
            if k + 2 >= SERIES_TERMS or (k > n and abs(term) + abs(series[k]) <= 1e-18 * largest):
                return k + 2
    above, above2 = 0.0, 0.0
    compliance = 1.0 / stiffness
    for k in range(n - 1, -1, -1):
        # Eq. (7), coefficient of τ^k of the particular polynomial.
        p = (force * rate[k] - damping * (k + 1) * above - (k + 1.0) * (k + 2.0) * above2) * compliance
        series[k] = p
        above2 = above
        above = p
    return -n


@_inlined_early
def rotation(pole_re, pole_im, t):
    """``e^{-σt} cos ωt`` and ``e^{-σt} sin ωt / ω``, in seconds: a free ring-down after time t."""
    decay = math.exp(pole_re * t)
    return decay * math.cos(pole_im * t), decay * math.sin(pole_im * t) / pole_im


@_inlined
def _evaluate(head, duration, series, terms, ring_y, ring_slope, tau, c, s):
    """Response, slope and curvature (V, V/s, V/s²) at fraction ``tau`` of an edge; ``c, s``: `rotation` up to it."""
    value, slope, curvature = 0.0, 0.0, 0.0
    for k in range(abs(terms) - 1, -1, -1):
        curvature = curvature * tau + slope
        slope = slope * tau + value
        value = value * tau + series[k]
    per_s = 1.0 / duration
    slope *= per_s
    curvature *= 2.0 * per_s * per_s
    if terms < 0:
        a0, damping = head[HEAD_A0], 0.5 * head[HEAD_A1]
        free_slope = ring_slope * c - (damping * ring_slope + a0 * ring_y) * s
        free = ring_y * c + (ring_slope + damping * ring_y) * s
        value += free
        slope += free_slope
        curvature -= 2.0 * damping * free_slope + a0 * free
    return value, slope, curvature


@_inlined
def _curvature_bound(head, x_start, x_change, low, high):
    """Upper bound of |Q''| on the fractions ``low … high`` of a branch piece."""
    if x_start >= 1.0:
        return 0.0
    first = int((x_start + x_change * low) * CURVATURE_CELLS)
    last = min(int((x_start + x_change * high) * CURVATURE_CELLS), CURVATURE_CELLS - 1)
    bound = 0.0
    for cell in range(first, last + 1):
        bound = max(bound, head[HEAD_CURVATURE + cell])
    return bound


@_inlined
def edge_extrema(
    head, pole_re, pole_im, start_s, duration, x_start, x_change, scale_V, series, terms,
    ring_y, ring_slope, y, slope, curvature, stack, times, peaks, count,
):  # fmt: skip
    """Append the extrema inside an edge to ``times`` and ``peaks``.

    Returns the new number of extrema (`OVERFLOW` if the arrays are full), then value, slope and curvature at the end.
    """
    a0, a1 = head[HEAD_A0], head[HEAD_A1]
    forcing = abs(head[HEAD_B1] * scale_V) * (x_change / duration) ** 2
    omega = math.sqrt(a0)
    stiffness = math.sqrt(a0 + a1 * a1)
    cells = int(omega * duration / NODE_SPACING) + 1
    low = 0.0
    y0, g0, d0 = y, slope, curvature
    long = terms < 0
    c_step, s_step = rotation(pole_re, pole_im, duration / cells) if long else (1.0, 0.0)
    c_node, s_node = 1.0, 0.0
    w2 = pole_im * pole_im
    for cell in range(cells):
        # Intervals still to be examined: the node interval, then its halves if nothing is proved on it.
        depth = 1
        stack[0, 0] = (cell + 1.0) / cells
        if long and cell == cells - 1:  # the end starts the next edge, so it is not computed by the recurrence
            c_node, s_node = rotation(pole_re, pole_im, duration)
        elif long:
            c_node, s_node = c_node * c_step - w2 * s_node * s_step, c_node * s_step + s_node * c_step
        stack[0, 1], stack[0, 2], stack[0, 3] = _evaluate(
            head, duration, series, terms, ring_y, ring_slope, stack[0, 0], c_node, s_node
        )
        while depth > 0:
            high, y1, g1, d1 = stack[depth - 1, 0], stack[depth - 1, 1], stack[depth - 1, 2], stack[depth - 1, 3]
            h = (high - low) * duration
            third = forcing * _curvature_bound(head, x_start, x_change, low, high)
            energy = math.sqrt(a0 * g0 * g0 + d0 * d0) + h * third  # see `resonator`: bounds √(a0 y'² + y''²)
            third = h * (third + stiffness * energy)  # bounds |y'''| h
            positive0 = g0 > 0.0 or (g0 == 0.0 and d0 > 0.0)
            positive1 = positive0 if g1 == 0.0 else g1 > 0.0
            settled = (
                (d0 * d1 > 0.0 and abs(d0) + abs(d1) > third)
                or (positive0 == positive1 and min(abs(g0), abs(g1)) > third * h * 0.125)
                or (third == 0.0 and g0 == 0.0 and g1 == 0.0)
                or high - low < 1e-13
            )
            if not settled and depth < stack.shape[0]:
                middle = 0.5 * (low + high)
                stack[depth, 0] = middle
                c, s = rotation(pole_re, pole_im, middle * duration) if long else (1.0, 0.0)
                stack[depth, 1], stack[depth, 2], stack[depth, 3] = _evaluate(
                    head, duration, series, terms, ring_y, ring_slope, middle, c, s
                )
                depth += 1
                continue
            if g0 == 0.0 and low > 0.0 and d0 != 0.0:
                if count >= times.shape[0]:
                    return OVERFLOW, y1, g1, d1
                times[count] = start_s + low * duration
                peaks[count] = y0
                count += 1
            if positive0 != positive1:
                if count >= times.shape[0]:
                    return OVERFLOW, y1, g1, d1
                # Safeguarded Newton, started from the cubic through both ends of the inverse function.
                a, b = low, high
                u = g0 / (g0 - g1)
                tau = a + (b - a) * u
                if d0 * d1 > 0.0:
                    w = 1.0 - u
                    span = (b - a) * duration
                    tau += (b - a) * u * w * (w * ((g1 - g0) / (d0 * span) - 1.0) - u * ((g1 - g0) / (d1 * span) - 1.0))
                value = y0
                for _ in range(60):
                    if not a < tau < b:
                        tau = 0.5 * (a + b)
                    c, s = rotation(pole_re, pole_im, tau * duration) if long else (1.0, 0.0)
                    value, g, d = _evaluate(head, duration, series, terms, ring_y, ring_slope, tau, c, s)
                    if g == 0.0:
                        break
                    if (g > 0.0) == positive0:
                        a = tau
                    else:
                        b = tau
                    step = g / (d * duration) if d != 0.0 else 0.0
                    tau -= step
                    if d != 0.0 and abs(step) < 1e-9:
                        value -= 0.5 * g * step * duration  # second order: Newton's own step is exact to 1e-18
                        break
                    if b - a < 1e-16:
                        break
                times[count] = start_s + tau * duration
                peaks[count] = value
                count += 1
            low, y0, g0, d0 = high, y1, g1, d1
            depth -= 1
    return count, y0, g0, d0


@_internal
def ring_down_extrema(pole_re, pole_im, a0, y, slope, start_s, duration, times, peaks, count):
    """Append the extrema of a free ring-down for 0 < t ≤ duration, a geometric series.

    Returns the new number of extrema (`OVERFLOW` if the arrays are full) and the summed magnitude beyond the list.
    """
    if y == 0.0 and slope == 0.0:
        return count, 0.0
    quadrature = (pole_re * slope - a0 * y) / pole_im
    half_period = math.pi / pole_im
    if slope == 0.0:
        first = half_period
        value = -y * math.exp(pole_re * half_period)
    else:
        phase = math.atan2(slope, quadrature)
        first = (-phase if phase < 0.0 else math.pi - phase) / pole_im
        if first > duration:
            return count, 0.0
        radius = math.sqrt(slope * slope + quadrature * quadrature)
        c, s = -quadrature / radius, slope / radius
        if phase < 0.0:
            c, s = -c, -s
        value = math.exp(pole_re * first) * (y * c + (slope - pole_re * y) / pole_im * s)
    ratio = -math.exp(pole_re * half_period)
    infinite = math.isinf(duration)
    floor = INFINITE_TAIL_FLOOR * abs(value)
    k = 0
    while True:
        t = first + k * half_period
        if t > duration:
            return count, 0.0
        if infinite and abs(value) < floor:
            return count, abs(value) / (1.0 + ratio)
        if count >= times.shape[0]:
            return OVERFLOW, 0.0
        times[count] = start_s + t
        peaks[count] = value
        count += 1
        k += 1
        value *= ratio
