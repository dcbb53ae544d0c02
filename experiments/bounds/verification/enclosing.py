"""Bound from below of the cost over a box of waveforms, from an enclosure of the response that is followed in time.

Units: V and µs. A waveform is ``(a, b, t1 … t5)``; the drive rises from 0 V to ``a``, falls to ``−b`` and returns.

The response is ``y = Im z`` with ``z' = λ z + g v'`` and ``z = 0`` at first. ``z`` is followed at nodes that move with
the corners of the drive, so that at every node it is a smooth function of the seven parameters: its value and its seven
derivatives are computed at the centre of the box, its second derivatives are bounded over the box. A branch law that
continues straight beyond its full scale has a jump in its second derivative there, which a bound of the second
derivative almost everywhere allows for.

Where the slope ``y' = Im(λ z)`` cannot keep its sign between two nodes, cells form a *window*. In a window between two
slopes of opposite sign there is an odd number of extrema, between two of the same sign an even number, possibly 0. An
extremum is within the width of the window from each of its nodes and has slope 0, so that it differs from the response
at the node by at most half the curvature times the square of the width: the linear function of the parameters that is
known at a node of the window, the *anchor*, bounds all its extrema. In a window without a corner of the drive they also
differ by at most the integral of the slope, which is the straight line from its value at the node to 0, up to an eighth
of the bound of ``y'''`` times the square of the distance.

Where the modulus ``|y|`` rises before a window and falls after it, one of the extrema is at least ``|y|`` at the
anchor. If it is not the first of three, the first weighs ``B`` and the others 1: their sum is still at least ``B``
times ``|y|`` at the anchor if ``(B + 1) low ≥ (B − 1) high``, so that only the second derivatives are to be subtracted.

A *course* tells in which window the largest extremum is and in which the next one. The cost of every course is bounded
by one linear function of the parameters, so that slopes of the extrema cancel; least over the courses, it is the bound.

Rounding: all numbers are below 10⁴, a bound is the result of fewer than 10⁵ operations in double precision, each of
relative error 1.2e-16, and the quadrature's error is at rounding level; `MARGIN_V` exceeds the sum of all of it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.verification.compiling import inner

MARGIN_V = 1e-7
"""Subtracted from every bound for the rounding errors, in V."""
SLOPE_MARGIN = 1e-10
"""What a slope must exceed to count as known, in V/µs."""
CELL_US = 0.45
"""Longest cell between two nodes, in µs."""
LEAST_CELLS = 4
"""Least number of cells of an edge."""
NODES_MOST = 4096
"""Most nodes that a waveform may need."""
WINDOWS_MOST = 512
"""Most windows that a waveform may need."""

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(6)
POINTS = 0.5 * (_POINTS + 1.0)
WEIGHTS = 0.5 * _WEIGHTS

# constants of a problem, see `constants`
ALPHA, OMEGA, GAIN, SCALE, A_WEIGHT, B_WEIGHT, RING, SIGMA, LAMBDA, COUNT = range(10)


@inner
def slope_of_law(x, law):
    """Slope ``Q'`` of the branch law at ``x``; ``law`` holds the coefficients of ``Q'``, lowest power first."""
    x = min(x, 1.0)
    value = 0.0
    for k in range(law.size - 1, -1, -1):
        value = value * x + law[k]
    return value


@inner
def bend_of_law(x, law):
    """``Q''`` at ``x``, 0 beyond the full scale."""
    if x > 1.0:
        return 0.0
    value = 0.0
    for k in range(law.size - 1, 0, -1):
        value = value * x + k * law[k]
    return value


@inner
def at_rest(z, dz, rest):
    """Set the first node to the state before the drive, which is 0 for all waveforms."""
    z[0] = 0.0
    rest[0] = 0.0
    for j in range(7):
        dz[0, j] = 0.0


@njit(nogil=True)
def follow(first, last, cell_us, centre, radius, k, law, sup1, sup2, ring_us, z, dz, rest, seconds, cell):
    """Follow ``z`` and its derivatives at the centre of a box over some parts of the waveform.

    Parameters
    ----------
    first, last : int
        First and last part: 0 to 4 for ``t1`` to ``t5``, 5 for the time after the drive.
    cell_us : float
        Longest cell between two nodes, in µs.
    centre, radius : array of shape (7,)
        Middle and half widths of the box, in V and µs.
    k : array
        Constants of the problem.
    law : array
        Coefficients of ``Q'``, lowest power first.
    sup1, sup2 : float
        Bounds of ``|Q'|`` and ``|Q''|``.
    ring_us : float
        How long the response is followed after the drive; negative: as long as its first clear extremum needs.
    z, dz : complex arrays of shapes (nodes,) and (nodes, 7)
        The state at the nodes, in V, and its derivatives; the first node's are given.
    rest : array
        The bound of what second derivatives contribute at the nodes, in V; the first node's is given.
    seconds : array of shape (cells, 3)
        Receives per cell its longest duration in µs and the bounds of ``|y''|`` and ``|y'''|``.
    cell : int array
        Receives the number of the part of the waveform of each cell, 5 for the time after the drive.

    Returns
    -------
    int
        Number of cells, 0 if they do not fit.
    """
    lam = complex(-k[SIGMA], k[OMEGA])
    size = k[LAMBDA]
    gain = k[GAIN]
    scale = k[SCALE]
    a, b = centre[0], centre[1]
    ra, rb = radius[0], radius[1]
    kernels = np.empty(POINTS.size, np.complex128)
    n = 0
    for part in range(first, last + 1):
        ring = part == 5
        edge = part == 0 or part == 2 or part == 4
        if ring:
            duration = ring_us
            if duration < 0.0:
                half = math.pi / k[OMEGA]
                phase = math.atan2((lam * z[n]).imag, (lam * z[n]).real)
                # turns with +ω: the next extremum when the phase reaches a multiple of π
                wait = (math.pi - phase % math.pi) / k[OMEGA]
                duration = wait + half / 2
                if wait < 0.35 * half:
                    duration += half
            rt = 0.0
        else:
            duration = centre[2 + part]
            rt = radius[2 + part]
        longest = duration + rt
        shortest = max(duration - rt, 1e-12)
        sign, span, rspan, offset = 1.0, 0.0, 0.0, 0.0
        if part == 0:
            span, rspan, offset = a, ra, b
        elif part == 2:
            sign, span, rspan = -1.0, a + b, ra + rb
        elif part == 4:
            span, rspan = b, rb
        # pieces of constant law: up to where it becomes straight, and from there
        kink = 1.0
        if edge and span > 0.0 and offset + span > scale:
            kink = (scale - offset) / span
            if kink < 1e-9 or kink > 1.0 - 1e-9:
                kink = 1.0 if kink > 0.5 else 0.0
        z0 = abs(z[n])
        away0 = 0.0
        for j in range(7):
            away0 += abs(dz[n, j]) * radius[j]
        s0 = rest[n]
        reach0 = z0 + away0 + s0
        away0 += 2.0 * s0
        theta = 0.0
        for piece in range(2):
            begin = 0.0 if piece == 0 else kink
            end = kink if piece == 0 else 1.0
            if end - begin <= 0.0:
                continue
            cells = math.ceil(longest * (end - begin) / cell_us)
            if edge:
                cells = max(cells, LEAST_CELLS if piece == 0 else 2)
            cells = max(cells, 1)
            if n + cells >= NODES_MOST:
                return 0
            step = (end - begin) / cells
            turn = np.exp(lam * duration * step)
            if edge:
                for q in range(POINTS.size):
                    kernels[q] = np.exp(lam * duration * step * (1.0 - POINTS[q])) * (WEIGHTS[q] * step * sign)
            for c in range(cells):
                theta0 = begin + c * step
                theta = begin + (c + 1) * step
                i_z = complex(0.0, 0.0)
                i_a = complex(0.0, 0.0)
                i_b = complex(0.0, 0.0)
                i_t = complex(0.0, 0.0)
                w_most = 0.0
                if edge:
                    for q in range(POINTS.size):
                        s = theta0 + POINTS[q] * step
                        x = (offset + span * s) / scale
                        if piece == 0:
                            x = min(x, 1.0)
                        slope = slope_of_law(x, law)
                        bend = bend_of_law(x, law) if piece == 0 else 0.0
                        away = theta - s
                        kernel = kernels[q]
                        w = slope * span
                        i_z += kernel * w
                        i_t += kernel * w * away
                        if part == 0:
                            i_a += kernel * (slope + bend * span * s / scale)
                            i_b += kernel * (bend * span / scale)
                        elif part == 2:
                            d = kernel * (slope + bend * x)
                            i_a += d
                            i_b += d
                        else:
                            i_b += kernel * (slope + bend * x)
                    middle = (offset + span * (theta0 + 0.5 * step)) / scale
                    off = (0.5 * span * step + rspan + rb) / scale
                    w_most = min(sup1, slope_of_law(min(middle, 1.0), law) + sup2 * off) * (span + rspan)
                for j in range(7):
                    dz[n + 1, j] = turn * dz[n, j]
                z[n + 1] = turn * z[n] + gain * i_z
                dz[n + 1, 0] += gain * i_a
                dz[n + 1, 1] += gain * i_b
                if not ring:
                    dz[n + 1, 2 + part] += turn * (lam * step) * z[n] + gain * lam * i_t
                # second derivatives, contracted with the half widths
                sec = s0
                if not ring:
                    turned = theta * size * rt
                    sec += turned * away0 + 0.5 * turned * turned * reach0
                    if edge:
                        w_all = sup1 * (span + rspan)
                        sec += 0.5 * gain * size * size * w_all * theta**3 / 3.0 * rt * rt
                        if part == 0:
                            change = (sup1 + sup2 * (span + rspan) / scale) * ra + sup2 * (span + rspan) / scale * rb
                            ends = (theta * ra + rb) ** 2
                            within = ends * (1.0 + size * longest * theta) + rb * rb
                        else:
                            far = (offset + span + rspan) / scale
                            change = (sup1 + sup2 * min(far, 1.0)) * rspan
                            within = rspan * rspan * (theta * theta + size * longest * theta**3 / 3.0)
                        sec += gain * size * rt * change * theta * theta / 2.0
                        sec += 0.5 * gain * sup2 / scale * within
                rest[n + 1] = sec
                # curvature within the cell over the box
                dt = longest * step
                reach = 0.0
                for m in range(n, n + 2):
                    here = abs(z[m]) + rest[m]
                    for j in range(7):
                        here += abs(dz[m, j]) * radius[j]
                    reach = max(reach, here)
                reach = (reach + 0.5 * gain * w_most * step) / (1.0 - 0.5 * size * dt)
                seconds[n, 0] = dt
                seconds[n, 1] = size * size * reach
                seconds[n, 2] = size * size * size * reach
                if edge:
                    v1 = w_most / shortest
                    v2 = sup2 * (span + rspan) ** 2 / scale / (shortest * shortest)
                    seconds[n, 1] += k[OMEGA] * gain * v1
                    seconds[n, 2] += size * size * gain * v1 + k[OMEGA] * gain * v2
                cell[n] = part
                n += 1
    return n


@inner
def find_windows(n, radius, k, z, dz, rest, seconds, cell, stop_at_end, kind, low, high, where, err, short):
    """Windows of the cells that may contain extrema; see the module.

    Parameters
    ----------
    n : int
        Number of cells.
    stop_at_end : bool
        Leave the time after the drive out.
    kind, low, high, where, err, short : arrays
        Receive per window: 1 for an odd number of extrema, 2 for an even one, 0 for any; least and greatest ``|y|`` of
        its extrema in V; the anchor; by how much an extremum may differ from the anchor's linear function in V; by how
        much the weighted extrema may fall short of it.

    Returns
    -------
    windows : int
        Number of windows, −1 if there are too many.
    clean : bool
        Whether the slope at the end is known, and the last window is an odd one after the drive.
    sign : int
        Sign of the slope at the end, 0 if unknown.
    before : int
        Where it is unknown, the sign before the last window, which lasts to the end; 0 if that is unknown as well.
    """
    lam = complex(-k[SIGMA], k[OMEGA])
    count = 0
    before = 0
    i = 0
    clean = False
    limit = n
    if stop_at_end:
        while limit > 0 and cell[limit - 1] == 5:
            limit -= 1
    node_sign = 0
    begun = -1
    least0 = 0.0
    for i in range(limit + 1):
        # slope at node i
        middle = (lam * z[i]).imag
        spread = k[LAMBDA] * rest[i] + SLOPE_MARGIN
        for j in range(7):
            spread += abs((lam * dz[i, j]).imag) * radius[j]
        least = abs(middle) - spread
        sign = 0
        if least > 0.0:
            sign = 1 if middle > 0.0 else -1
        definite = False
        if i > 0:
            bow = seconds[i - 1, 2] * seconds[i - 1, 0] ** 2 / 8.0
            definite = sign != 0 and sign == node_sign and min(least, least0) > bow
            if not definite and begun < 0:
                begun = i - 1
                before = node_sign
            close = begun >= 0 and (definite or i == limit)
            if close:
                last = i - 1 if definite else i
                after = node_sign if definite else (sign if i == limit else 0)
                if count >= WINDOWS_MOST:
                    return -1, False, 0, 0
                # anchor: the node of least slope at the centre
                best = begun
                for m in range(begun, last + 1):
                    if abs((lam * z[m]).imag) < abs((lam * z[best]).imag):
                        best = m
                left = 0.0
                right = 0.0
                bend = 0.0
                top = 0.0
                bottom = math.inf
                signs = 0
                for m in range(begun, last + 1):
                    wide = rest[m]
                    for j in range(7):
                        wide += abs(dz[m, j].imag) * radius[j]
                    top = max(top, abs(z[m].imag) + wide)
                    bottom = min(bottom, abs(z[m].imag) - wide)
                    signs += 1 if z[m].imag > 0.0 else -1
                sag = 0.0
                for m in range(begun, last):
                    bend = max(bend, seconds[m, 1])
                    sag = max(sag, seconds[m, 1] * seconds[m, 0] ** 2 / 8.0)
                    if m < best:
                        left += seconds[m, 0]
                    else:
                        right += seconds[m, 0]
                width = max(left, right)
                extra = 0.5 * bend * width * width
                if cell[begun] == cell[last - 1]:
                    # without a corner the slope differs little from the straight line between anchor and extremum
                    steep = abs((lam * z[best]).imag) + k[LAMBDA] * rest[best]
                    third = 0.0
                    for j in range(7):
                        steep += abs((lam * dz[best, j]).imag) * radius[j]
                    for m in range(begun, last):
                        third = max(third, seconds[m, 2])
                    extra = min(extra, 0.5 * steep * width + third * width**3 / 12.0)
                wide = rest[best] + extra
                for j in range(7):
                    wide += abs(dz[best, j].imag) * radius[j]
                level = abs(z[best].imag)
                low[count] = max(0.0, level - wide)
                if abs(signs) == last + 1 - begun:
                    low[count] = max(low[count], bottom - sag)
                high[count] = min(level + wide, top + sag)
                where[count] = best
                err[count] = rest[best] + extra
                short[count] = err[count]
                sign_y = 1 if z[best].imag > 0.0 else -1
                peak = low[count] > 0.0 and before == sign_y and after == -sign_y
                if peak and (k[B_WEIGHT] + 1.0) * low[count] >= (k[B_WEIGHT] - 1.0) * high[count]:
                    short[count] = rest[best]
                if before == 0 or after == 0 or begun == 0:
                    kind[count] = 0
                else:
                    kind[count] = 1 if before != after else 2
                whole = left + right
                clean = definite and kind[count] == 1 and cell[begun] == 5 and whole < math.pi / k[OMEGA]
                if i == limit and not definite:
                    clean = False
                count += 1
                begun = -1
        node_sign = sign
        least0 = least
    if begun >= 0:
        return -1, False, 0, 0
    return count, clean, node_sign, before
