"""Looking up the cost to go: cells of the tables of `cost_to_go` that meet a disc, and planes below their values."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.head_numbers import OMEGA, SIGMA
from inkjet_env.experiments.bounds.windows import NEVER

LEVELS = 6
"""Number of levels of a table: each has the minima of 2 × 2 cells of the one below."""
CELL_COLUMNS = 7
LATER, JUST, DONE = np.arange(3)
"""Columns of the cost to go: the extremum after the effective one is later, is the next, or is over. They are of numpy,
since numba compiles a function again for each Python constant that it is given."""


@njit(cache=True)
def coarser(table):
    """The minima of 2 × 2 cells, shape (⌈labels / 2⌉, angles / 2, 3)."""
    found = np.full(((table.shape[0] + 1) // 2, table.shape[1] // 2, 3), np.inf, table.dtype)
    for label in range(table.shape[0]):
        for angle in range(table.shape[1]):
            for mode in range(3):
                value = table[label, angle, mode]
                if value < found[label // 2, angle // 2, mode]:
                    found[label // 2, angle // 2, mode] = value
    return found


@njit(cache=True)
def look_up(head, levels, inner, grid, z, radius, finest, cells, count):
    """Add the cells of a table that meet a disc to a list; the new length, or −1 if disc or list is too large.

    Parameters
    ----------
    levels : tuple of arrays
        `LEVELS` tables, each `coarser` than the one before; the first with about ``finest`` cells across is taken.
    inner : ndarray, shape (3,)
        Values near 0.
    grid : tuple
        As for `edge_table`.
    z, radius : complex, float
        The disc, in volts.
    cells : ndarray, shape (n, CELL_COLUMNS)
        Filled from ``count`` on with centres and radii in volts, the three values of the cost to go, and the sign of
        the slope, 0 if either.
    """
    sigma, omega = head[SIGMA], head[OMEGA]
    angles, width, smallest = grid
    turn = 2.0 * math.pi / angles
    lean = sigma / omega
    magnitude = abs(z)
    high, low = magnitude + radius, magnitude - radius
    if low <= smallest:
        if count == cells.shape[0]:
            return -1
        cells[count, 0], cells[count, 1], cells[count, 2], cells[count, 3:6], cells[count, 6] = (
            0.0,
            0.0,
            smallest,
            inner,
            0.0,
        )
        count += 1
        if high <= smallest:
            return count
        low = smallest
    if radius >= 0.999 * magnitude:
        begin, stop = 0.0, 2.0 * math.pi * (1.0 - 1e-15)
    else:
        half = math.asin(radius / magnitude) + 1e-12
        begin = math.atan2(z.imag, z.real) - 0.5 * math.pi + math.atan2(sigma, omega) - half
        begin -= 2.0 * math.pi * math.floor(begin / (2.0 * math.pi))
        stop = begin + 2.0 * half
    first, last = math.log(low / smallest) / width - 1e-9, math.log(high / smallest) / width + 1e-9
    extent = max((stop - begin) / turn, last - first)
    level = 0
    while level < LEVELS - 1 and extent > finest:
        level += 1
        extent *= 0.5
    if level == 0:
        table = levels[0]
    elif level == 1:
        table = levels[1]
    elif level == 2:
        table = levels[2]
    elif level == 3:
        table = levels[3]
    elif level == 4:
        table = levels[4]
    else:
        table = levels[5]
    size = 1 << level
    around = angles >> level
    outwards = math.exp(0.5 * size * (width + lean * turn))
    share = math.hypot(outwards - 1.0, outwards * 0.5 * size * turn)
    offset = 0.5 * math.pi - math.atan2(sigma, omega)
    for angle in range(math.floor(begin / turn) >> level, (math.floor(stop / turn) >> level) + 1):
        now = angle % around
        less = 2.0 * math.pi if angle >= around else 0.0
        from_u, to_u = max(begin - less, now * size * turn), min(stop - less, (now + 1) * size * turn)
        lowest = max(math.floor(first + lean / width * from_u), 0) >> level
        highest = math.floor(last + lean / width * to_u) >> level
        if highest >= table.shape[0]:
            return -1
        u = (now + 0.5) * size * turn
        ahead = np.exp(complex(-lean * u, u + offset)) * smallest
        for label in range(lowest, highest + 1):
            at = ahead * math.exp((label + 0.5) * size * width)
            mine = share * abs(at)
            if abs(at - z) > radius + mine:
                continue
            if count == cells.shape[0]:
                return -1
            cells[count, 0], cells[count, 1], cells[count, 2] = at.real, at.imag, mine
            cells[count, 3:6] = table[label, now]
            cells[count, 6] = -1.0 if 2 * now < around else 1.0
            count += 1
    return count


@njit(cache=True)
def tilted(cells, count, mode, slope, z, tilt):
    """Best constant in volts for which ``constant + Re(tilt̄ (z' − z))`` is below the cost to go on cells of a slope."""
    least = NEVER
    steep = abs(tilt)
    for k in range(count):
        value = cells[k, 3 + mode]
        if value < NEVER and cells[k, 6] * slope >= 0.0:
            along = tilt.real * (cells[k, 0] - z.real) + tilt.imag * (cells[k, 1] - z.imag)
            least = min(least, value - along - steep * cells[k, 2])
    return least


@njit(cache=True)
def gradient_of(cells, count, mode, slope, z):
    """Gradient of the plane through the values of cells by least squares; 0 if they do not determine one."""
    n, sx, sy, sv, sxx, sxy, syy, sxv, syv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        value = cells[k, 3 + mode]
        if value < NEVER and cells[k, 6] * slope >= 0.0:
            x, y = cells[k, 0] - z.real, cells[k, 1] - z.imag
            n += 1.0
            sx += x
            sy += y
            sv += value
            sxx += x * x
            sxy += x * y
            syy += y * y
            sxv += x * value
            syv += y * value
    if n < 4.0:
        return 0j
    xx, xy, yy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    xv, yv = sxv - sx * sv / n, syv - sy * sv / n
    area = xx * yy - xy * xy
    if area <= 1e-9 * (xx + yy) ** 2:
        return 0j
    return complex((yy * xv - xy * yv) / area, (xx * yv - xy * xv) / area)
