"""Least cost over a box of waveforms whose last durations are free: followed up to a table, see `tables`.

The set of the states on arrival at the table is ``z + Σ dz_j off_j`` with a rest, for offsets ``off_j`` within the half
widths. All cells that meet it are looked at, separately for each sign of the slope. Over each set of cells, besides
their least value, a linear function of the state and of ``b`` is below the values of the table; its slopes are those of
the values by least squares, its constant the least that the cells leave. It joins the linear function of the extrema
before, see `courses`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.verification.compiling import inner
from inkjet_env.experiments.bounds.verification.courses import LATER, NONE, SIDES, linear_course
from inkjet_env.experiments.bounds.verification.enclosing import (
    A_WEIGHT,
    B_WEIGHT,
    CELL_US,
    MARGIN_V,
    at_rest,
    find_windows,
    follow,
)
from inkjet_env.experiments.bounds.verification.last_edge import OVER, PASSED, TO_COME
from inkjet_env.experiments.bounds.verification.spiral import SLACK, block_reach

LOOK_MOST = 48
"""About the most cells that are looked at for one range of ``b``."""
CELLS_MOST = 8192
"""Most cells for all ranges of ``b``; beyond, there is no bound."""
WIDE = 0.8
"""Beyond this ratio of the radius of the states' set to their modulus, all angles are looked at."""
DIAGONAL = math.sqrt(0.5)


@inner
def across(direction, value):
    """Component of a complex number along one of four directions, 45° apart."""
    if direction == 0:
        return value.real
    if direction == 1:
        return value.imag
    if direction == 2:
        return DIAGONAL * (value.real + value.imag)
    return DIAGONAL * (value.real - value.imag)


@inner
def gather(tables, dwell, sign, n, centre, radius, z, dz, rest, cells):
    """The cells of a table that hold a state on arrival.

    Parameters
    ----------
    dwell : bool
        Whether the table is that of the dwell, or of the last edge.
    sign : int
        Sign of the slope on arrival.
    n : int
        Node of the arrival.
    cells : array of shape (`CELLS_MOST`, 8)
        Receives per cell the three values in V; offset of its middle from ``z``, real and imaginary part, and its
        radius, in V; offset of the middle of the range of ``b``, and its half width, in V.

    Returns
    -------
    int
        Number of cells, −1 if they do not fit.
    """
    grid = tables.grid
    base = tables.dwell if dwell else tables.edge
    base_core = tables.dwell_core if dwell else tables.edge_core
    own = tables.own_dwell if dwell else tables.own_edge
    own_core = tables.own_dwell_core if dwell else tables.own_edge_core
    ends = tables.ends
    ranges = ends.size - 1
    half = grid.angles // 2
    widths = np.empty(4)
    columns = np.empty(grid.angles, np.complex128)
    count = 0
    for which in range(ranges):
        low_b = max(centre[1] - radius[1], ends[which])
        high_b = min(centre[1] + radius[1], ends[which + 1])
        if low_b > high_b:
            continue
        off_b = 0.5 * (low_b + high_b) - centre[1]
        half_b = 0.5 * (high_b - low_b) + 1e-12
        shift = dz[n, 1] * off_b
        zc = z[n] + shift
        spread = abs(dz[n, 1]) * half_b + rest[n] + SLACK
        for j in range(SIDES):
            if j != 1:
                spread += abs(dz[n, j]) * radius[j]
        for d in range(4):
            widths[d] = abs(across(d, dz[n, 1])) * half_b + rest[n] + SLACK
            for j in range(SIDES):
                if j != 1:
                    widths[d] += abs(across(d, dz[n, j])) * radius[j]
        spread = min(spread, math.hypot(widths[0], widths[1]))
        mod = abs(zc)
        least_angle = 0.0 if sign > 0 else math.pi
        most_angle = least_angle + math.pi
        high_u = math.log(mod + spread) + grid.slant * most_angle
        low_u = -math.inf
        if spread < WIDE * mod:
            turn = math.asin(spread / mod) + SLACK
            angle = (math.atan2(zc.imag, zc.real) + grid.turned) % (2.0 * math.pi)
            found = False
            first, last = least_angle, most_angle
            for wrap in range(-1, 2):
                low_a = max(least_angle, angle - turn + wrap * 2.0 * math.pi)
                high_a = min(most_angle, angle + turn + wrap * 2.0 * math.pi)
                if low_a <= high_a:
                    found = True
                    low_u = math.log(mod - spread) + grid.slant * low_a
                    high_u = math.log(mod + spread) + grid.slant * high_a
                    first, last = low_a, high_a
            if not found:
                continue
            least_angle, most_angle = first, last
        begin = 0 if sign > 0 else half
        first_col = min(max(math.floor(least_angle / grid.width - SLACK), begin), begin + half - 1)
        last_col = min(max(math.floor(most_angle / grid.width + SLACK), begin), begin + half - 1)
        first_row = max(0, math.floor((grid.top - high_u) / grid.height - SLACK))
        in_core = low_u < grid.top - (grid.rows - SLACK) * grid.height
        last_row = grid.rows - 1
        if not in_core:
            last_row = min(last_row, max(0, math.floor((grid.top - low_u) / grid.height + SLACK)))
        if in_core:
            if count >= CELLS_MOST:
                return -1
            cell = cells[count]
            cell[0], cell[1], cell[2] = own_core[which, 0], base_core[which, 0], base_core[which, 1]
            cell[3], cell[4], cell[5], cell[6], cell[7] = -z[n].real, -z[n].imag, grid.core, off_b, half_b
            count += 1
        level = 0
        while level < grid.levels - 1 and (
            ((last_row >> level) - (first_row >> level) + 1) * ((last_col >> level) - (first_col >> level) + 1)
            > LOOK_MOST
        ):
            level += 1
        size = 1 << level
        reach = block_reach(grid, size, size)
        per_row = grid.angles >> level
        at = tables.offsets[level] + which * (-(-grid.rows // size)) * per_row
        for col in range(first_col >> level, (last_col >> level) + 1):
            turned = (col + 0.5) * size * grid.width
            columns[col] = np.exp(complex(-grid.slant * turned, turned - grid.turned))
        for row in range(first_row >> level, (last_row >> level) + 1):
            grown = math.exp(grid.top - (row + 0.5) * size * grid.height)
            for col in range(first_col >> level, (last_col >> level) + 1):
                middle = grown * columns[col]
                around = abs(middle) * reach
                away = middle - zc
                meets = abs(away) <= spread + around
                for d in range(4):
                    meets = meets and abs(across(d, away)) <= widths[d] + around
                if not meets:
                    continue
                if count >= CELLS_MOST:
                    return -1
                i = at + row * per_row + col
                cell = cells[count]
                away += shift
                cell[0], cell[1], cell[2] = own[i, 0], base[i, 0], base[i, 1]
                cell[3], cell[4], cell[5], cell[6], cell[7] = away.real, away.imag, around, off_b, half_b
                count += 1
    return count


@inner
def minorant(kind, count, cells, n, radius, dz, rest, found):
    """A linear function below the values of some cells.

    Parameters
    ----------
    kind : int
        Kind of the values.
    found : array of shape (5,)
        Receives the least value; the linear function's constant, and its slopes by the state's real and imaginary part
        and by ``b``. All are infinite where no cell has a finite value.
    """
    least = math.inf
    mean = np.zeros(4)
    finite = 0
    for i in range(count):
        v = cells[i, kind]
        least = min(least, v)
        if math.isfinite(v):
            finite += 1
            mean[0] += v
            mean[1] += cells[i, 3]
            mean[2] += cells[i, 4]
            mean[3] += cells[i, 6]
    found[0], found[1], found[2], found[3], found[4] = least, least, 0.0, 0.0, 0.0
    if finite < 4 or not math.isfinite(least):
        return
    for i in range(4):
        mean[i] /= finite
    # normal equations with a little of the identity, by elimination
    m = np.zeros((3, 4))
    for i in range(count):
        v = cells[i, kind]
        if math.isfinite(v):
            x, y, b, v = cells[i, 3] - mean[1], cells[i, 4] - mean[2], cells[i, 6] - mean[3], v - mean[0]
            m[0, 0] += x * x
            m[0, 1] += x * y
            m[0, 2] += x * b
            m[1, 1] += y * y
            m[1, 2] += y * b
            m[2, 2] += b * b
            m[0, 3] += x * v
            m[1, 3] += y * v
            m[2, 3] += b * v
    m[1, 0], m[2, 0], m[2, 1] = m[0, 1], m[0, 2], m[1, 2]
    for i in range(3):
        m[i, i] += 1e-3 * (m[i, i] + 1e-3 * finite)
    for i in range(3):
        for row in range(i + 1, 3):
            factor = m[row, i] / m[i, i]
            for column in range(i, 4):
                m[row, column] -= factor * m[i, column]
    g_b = m[2, 3] / m[2, 2]
    g_y = (m[1, 3] - m[1, 2] * g_b) / m[1, 1]
    g_x = (m[0, 3] - m[0, 1] * g_y - m[0, 2] * g_b) / m[0, 0]
    size = math.hypot(g_x, g_y)
    if not math.isfinite(size + g_b):
        return
    # no state on arrival is further up the slopes than this
    furthest = size * rest[n]
    for j in range(SIDES):
        slope = g_x * dz[n, j].real + g_y * dz[n, j].imag
        if j == 1:
            slope += g_b
        furthest += abs(slope) * radius[j]
    constant = math.inf
    for i in range(count):
        up = g_x * cells[i, 3] + g_y * cells[i, 4] + size * cells[i, 5] + g_b * cells[i, 6] + abs(g_b) * cells[i, 7]
        constant = min(constant, cells[i, kind] - min(up, furthest))
    if math.isfinite(constant):
        found[1], found[2], found[3], found[4] = constant, g_x, g_y, g_b


@inner
def table_slopes(table, n, dz, slopes):
    """Derivatives over the box of a table's linear function on arrival."""
    for j in range(SIDES):
        slopes[j] = table[2] * dz[n, j].real + table[3] * dz[n, j].imag
    slopes[1] += table[4]


@inner
def joined_least(value, slopes, of_table, table, n, radius, rest):
    """Least over the box of a linear function of the extrema before plus a table's value on arrival, in V.

    ``slopes`` are the derivatives of both, ``of_table`` those of the table alone.
    """
    plain = value + table[0]
    joined = value + table[1] - math.hypot(table[2], table[3]) * rest[n]
    for j in range(SIDES):
        plain -= abs(slopes[j] - of_table[j]) * radius[j]
        joined -= abs(slopes[j]) * radius[j]
    return max(plain, joined)


@njit(nogil=True)
def arriving_cost(dwell, centre, radius, least, most, k, law, sup1, sup2, tables, z, dz, rest, seconds, cell, kind, low,
                  high, where, err, short, weight, cells, found):  # fmt: skip
    """Bound from below, in V, of the costs of a box's waveforms whose largest ``|extremum|`` is in ``least … most``.

    It holds for all ``t5`` of the problem, with ``dwell`` for all ``t4`` as well.
    """
    at_rest(z, dz, rest)
    last = np.int64(2 if dwell else 3)
    n = follow(np.int64(0), last, CELL_US, centre, radius, k, law, sup1, sup2, 0.0, z, dz, rest, seconds, cell)
    if n == 0:
        return -math.inf
    windows, _, end_sign, before = find_windows(
        n, radius, k, z, dz, rest, seconds, cell, last > 4, kind, low, high, where, err, short
    )  # fmt: skip
    if windows < 0:
        return -math.inf
    a, b = k[A_WEIGHT], k[B_WEIGHT]
    slopes, of_table = np.empty(SIDES), np.empty(SIDES)
    bound = math.inf
    for sign in range(-1, 2, 2):
        if end_sign != 0 and sign != end_sign:
            continue
        if end_sign == 0:
            kind[windows - 1] = 0 if before == 0 else (1 if before != sign else 2)
        count = gather(tables, dwell, sign, n, centre, radius, z, dz, rest, cells)
        if count < 0:
            return -math.inf
        if count == 0:
            continue
        for which in range(3):
            minorant(which, count, cells, n, radius, dz, rest, found[which])
        largest = least
        for i in range(windows):
            if kind[i] == 1:
                largest = max(largest, low[i])
        if largest > most:
            continue
        for e in range(-1, windows):
            if e >= 0 and (high[e] < largest or low[e] > most):
                continue
            for variant in range(2):
                follows = variant == LATER and e >= 0
                own = 0.0
                if e >= 0:
                    own = a + (1.0 if kind[e] == 2 else 0.0)
                    if variant == NONE:
                        own = a + b + (1.0 if kind[e] == 1 else 0.0)
                elif variant == NONE:
                    continue
                j = e + 1
                while True:
                    # the next extremum is in window j, or after the arrival, or not looked for
                    table = found[OVER]
                    if e < 0:
                        table = found[TO_COME]
                    elif follows and j >= windows:
                        table = found[PASSED]
                    plain = table[0]
                    for i in range(windows):
                        w = 1.0 if kind[i] == 1 else 0.0
                        if i == e:
                            w = own
                            plain += a * min(high[i], most) + (w - a) * max(low[i], 0.0)
                        else:
                            if follows and i == j:
                                w = b + (1.0 if kind[i] == 2 else 0.0)
                            plain += w * low[i]
                        weight[i] = w
                    if plain < bound:
                        course = plain
                        table_slopes(table, n, dz, of_table)
                        for free in range(2):
                            if free == 1 and e < 0:
                                continue
                            slopes[:] = of_table
                            value = linear_course(
                                weight, free == 1, e, last > 4, most, k, windows, radius, z, dz, low, high, where,
                                err, short, slopes,
                            )  # fmt: skip
                            course = max(course, joined_least(value, slopes, of_table, table, n, radius, rest))
                        bound = min(bound, course)
                    if not follows or j >= windows or kind[j] == 1:
                        break
                    j += 1
    return bound - MARGIN_V
