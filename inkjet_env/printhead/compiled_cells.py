"""Compiled kernels of one edge of the drive, for eight waveforms side by side, with vector instructions.

An edge is cut into cells, on each of which the response is a power series, Eq. (7) of `resonator`; its value at the end
of a cell starts the next one. An extremum cannot be missed: with ``g`` and ``d`` the first and second derivative, and
``E`` the bound of the third that `resonator` explains, a part of a cell of length ``h`` has none if ``g`` has one sign
and a magnitude above ``E h² / 8`` at both ends, and at most one if ``d`` has one sign at both ends and
``|d0| + |d1| > E h``. Both halves of a cell are examined; if they do not say, `_split` halves them further.
"""

from __future__ import annotations

import numpy as np

from inkjet_env.printhead.compiled_edges import FAST, MAX_DEGREE
from inkjet_env.printhead.kernel_cache import INTERNAL, kernel_jit
from inkjet_env.printhead.vector_type import (
    LANES,
    bits,
    both,
    differ,
    either,
    load,
    magnitude,
    root,
    same,
    spread,
    store,
    where,
)

CELL_RAD = 1.2
"""Largest length of a cell, in radians of the resonance."""
FEWEST_TERMS, TERMS_OF_A_CURVE = 21, 13
"""Least number of terms of a series, and terms beyond the degree of the law: the last are 1e-17 of the first."""
MOST_TERMS = MAX_DEGREE + TERMS_OF_A_CURVE
MOST_PEAKS = 64
"""Largest number of extrema of a lane before the final ring-down."""
SPLITS = 12
"""Halvings of a cell at most."""
EVERY = (1 << LANES) - 1
"""All lanes, as the integer of a mask."""
NEWTON_STEPS = 2
CLOSE = 1e-4
"""Largest last Newton step, as a fraction of a cell: the extremum's error is of the order of its cube."""

_internal = kernel_jit(__file__, fastmath=FAST, **INTERNAL)
_inlined = kernel_jit(__file__, fastmath=FAST, forceinline=True, **INTERNAL)

_RECIPROCALS = np.array([1.0 / ((k + 1) * (k + 2)) for k in range(MOST_TERMS)])
# Weights of the terms of a series from the second on in its derivatives, in the middle of the cell and at its end.
_FIRST_MIDDLE = np.array([(k + 2) * 0.5 ** (k + 1) for k in range(MOST_TERMS)])
_SECOND_MIDDLE = np.array([(k + 2) * (k + 1) * 0.5**k for k in range(MOST_TERMS)])
_FIRST_END = np.array([k + 2.0 for k in range(MOST_TERMS)])
_SECOND_END = np.array([(k + 2.0) * (k + 1.0) for k in range(MOST_TERMS)])


@_inlined
def _proven(crosses, g0, d0, g1, d1, third):
    """Lanes in which half a cell holds no extremum, or one; as the integer of a mask."""
    size0, size1 = magnitude(g0), magnitude(g1)
    monotone = bits(both(d0 * d1 > 0.0, magnitude(d0) + magnitude(d1) > 0.5 * third))
    return monotone | (bits(where(size0 < size1, size0, size1) > 0.03125 * third) & ~crosses)


@_inlined
def _crossing(g0, d0, g1, d1, h):
    """Where ``g`` is nearly zero, as a fraction of a part of length ``h``: the inverse function as a cubic."""
    u = g0 / (g0 - g1)
    w = 1.0 - u
    part = u + u * w * (w * ((g1 - g0) / (d0 * h) - 1.0) - u * ((g1 - g0) / (d1 * h) - 1.0))
    return part if 0.0 < part < 1.0 else u


@_internal
def _wait(series, i, start, places, waiting, count):
    """Keep the series of lane i, for `solve_waiting`, and reserve a place among the lane's peaks.

    ``places`` are the series that wait, where each extremum nearly is, and its place.
    """
    queue, starts, slots = places
    base = (waiting // LANES) * (MOST_TERMS * LANES) + waiting % LANES
    for k in range(series.shape[0] // LANES):
        queue[base + LANES * k] = series[LANES * k + i]
    starts[waiting] = start
    slots[waiting] = LANES * count[i] + i
    count[i] += 1
    return waiting + 1


@_internal
def _slopes(series, i, tau):
    """First and second derivative of the series of lane i."""
    terms = series.shape[0] // LANES
    value, g, d = series[LANES * (terms - 1) + i], 0.0, 0.0
    for k in range(terms - 2, -1, -1):
        d = d * tau + g
        g = g * tau + value
        value = value * tau + series[LANES * k + i]
    return g, 2.0 * d


@_internal
def _split(series, i, third, stack, places, waiting, count):
    """Halve a cell of lane i until each part holds no extremum or one, which then waits.

    False if `SPLITS` or `MOST_PEAKS` are too few. ``third`` bounds the third derivative on the cell.
    """
    low, g0, d0 = 0.0, series[LANES + i], 2.0 * series[2 * LANES + i]
    depth = 1
    stack[0, 0] = 1.0
    stack[0, 1], stack[0, 2] = _slopes(series, i, 1.0)
    while depth > 0:
        high, g1, d1 = stack[depth - 1, 0], stack[depth - 1, 1], stack[depth - 1, 2]
        h = high - low
        rising0 = g0 > 0.0 or (g0 == 0.0 and d0 > 0.0)
        crosses = rising0 != (g1 > 0.0)
        monotone = d0 * d1 > 0.0 and abs(d0) + abs(d1) > third * h
        if not (monotone or (not crosses and min(abs(g0), abs(g1)) > 0.125 * third * h * h)):
            if depth == SPLITS:
                return waiting, False
            stack[depth, 0] = 0.5 * (low + high)
            stack[depth, 1], stack[depth, 2] = _slopes(series, i, stack[depth, 0])
            depth += 1
            continue
        if crosses:
            if count[i] == MOST_PEAKS:
                return waiting, False
            start = _crossing(g0, d0, g1, d1, h)
            waiting = _wait(series, i, low + h * start, places, waiting, count)
        low, g0, d0 = high, g1, d1
        depth -= 1
    return waiting, True


@_internal
def bernstein_weights(degree, weights):
    """Fill the matrix from a polynomial without its constant to the Bernstein coefficients of its derivative."""
    n = degree - 2
    for j in range(n + 1):
        for k in range(j + 1):
            share = k + 1.0
            for i in range(k):  # C(j, k) / C(n, k)
                share *= (j - i) / (n - i)
            weights[j, k] = share


@_internal
def edge(cells, a0, a1, b1, duration, rate, degree, weights, y, slope, series, work, places, waiting, count):
    """Response and slope after a piece of an edge, the number of extrema that wait, and the lanes not settled."""
    values, ends, stack = work
    step = duration / float(cells)
    damping, stiffness, force = a1 * step, a0 * step * step, b1 * step
    stiffness_root, rigidity = root(stiffness), root(stiffness + damping * damping)
    g0 = slope * step
    factor = 1.0
    for k in range(degree):
        factor /= cells
        store(rate, LANES * k, load(rate, LANES * k) * force * factor)
    unsettled = 0
    for _ in range(cells):
        store(series, 0, y)
        store(series, LANES, g0)
        bend = spread(0.0)  # bounds the derivative of the push: a polynomial lies within its Bernstein coefficients
        for j in range(degree - 1):
            bernstein = spread(0.0)
            for k in range(j + 1):
                bernstein = bernstein + load(rate, LANES * (k + 1)) * weights[j, k]
            size = magnitude(bernstein)
            bend = where(size > bend, size, bend)
        previous, latest = y, g0
        y = y + g0
        zero = spread(0.0)
        g, d, g1, d1 = g0, zero, g0, zero
        for k in range(series.shape[0] // LANES - 2):
            push = -1.0 * stiffness * previous
            if k < degree:
                push = push + load(rate, LANES * k)
            term = push * _RECIPROCALS[k] - damping * latest * ((k + 1.0) * _RECIPROCALS[k])
            store(series, LANES * (k + 2), term)
            y = y + term
            g = g + term * _FIRST_MIDDLE[k]
            d = d + term * _SECOND_MIDDLE[k]
            g1 = g1 + term * _FIRST_END[k]
            d1 = d1 + term * _SECOND_END[k]
            previous, latest = latest, term
        d0 = 2.0 * load(series, 2 * LANES)
        spin = stiffness_root * g0
        third = bend + rigidity * (root(spin * spin + d0 * d0) + bend)
        rising = g > zero
        first = bits(differ(either(g0 > zero, both(same(g0, zero), d0 > zero)), rising))
        second = bits(differ(rising, g1 > zero))
        proven = _proven(first, g0, d0, g, d, third) & _proven(second, g, d, g1, d1, third)
        unsettled |= bits(either(same(g, zero), same(g1, zero)))
        left = (first | second | ~proven) & EVERY
        if left:
            store(values, 0, third)
            store(ends, 0, g0)
            store(ends, LANES, d0)
            store(ends, 2 * LANES, g)
            store(ends, 3 * LANES, d)
            store(ends, 4 * LANES, g1)
            store(ends, 5 * LANES, d1)
        while left:
            i = 0
            while not (left >> i) & 1:
                i += 1
            left &= left - 1
            if count[i] > MOST_PEAKS - 2:
                unsettled |= 1 << i
            elif (proven >> i) & 1:
                for half in range(2):
                    if ((second if half else first) >> i) & 1:
                        at = i + 2 * LANES * half
                        part = _crossing(ends[at], ends[at + LANES], ends[at + 2 * LANES], ends[at + 3 * LANES], 0.5)
                        waiting = _wait(series, i, 0.5 * (half + part), places, waiting, count)
            else:
                waiting, done = _split(series, i, values[i], stack, places, waiting, count)
                if not done:
                    unsettled |= 1 << i
        g0 = g1
        for k in range(degree - 1):  # the rate about the next cell's start: its polynomial of τ + 1
            for j in range(degree - 2, k - 1, -1):
                store(rate, LANES * j, load(rate, LANES * j) + load(rate, LANES * (j + 1)))
    return y, g0 / step, waiting, unsettled


@_internal
def solve_waiting(terms, places, waiting, values, peaks):
    """Find the extremum of each series that waits, and put it into its place; the lanes where that fails."""
    queue, starts, slots = places
    failed = 0
    for group in range((waiting + LANES - 1) // LANES):
        base = group * MOST_TERMS * LANES
        tau = load(starts, group * LANES)
        value, move = spread(0.0), spread(0.0)
        for _ in range(NEWTON_STEPS):
            value, g, d = load(queue, base + LANES * (terms - 1)), spread(0.0), spread(0.0)
            for k in range(terms - 2, -1, -1):
                d = d * tau + g
                g = g * tau + value
                value = value * tau + load(queue, base + LANES * k)
            move = g / (2.0 * d)
            value = value - 0.5 * g * move  # second order
            tau = tau - move
        store(values, 0, value)
        near = bits(both(magnitude(move) < CLOSE, both(tau > -CLOSE, tau < 1.0 + CLOSE)))
        for j in range(min(LANES, waiting - group * LANES)):
            slot = slots[group * LANES + j]
            peaks[slot] = values[j]
            if not (near >> j) & 1:
                failed |= 1 << (slot % LANES)
    return failed
