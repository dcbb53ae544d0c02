"""What the rest of a waveform costs at least: from the start of its last edge, and from the start of the dwell before.

At the start of a dwell the past is in one complex number ``z``. Its plane is cut into cells along spirals, on which it
runs while no edge pushes it: a dwell only shifts from cell to cell. In polar form ``|z| = ρ exp(−σ u / ω)``, where the
angle ``u`` is counted from an extremum, so that extrema lie between cells; ``ρ`` is on a logarithmic scale with a whole
number of cells for what a turn takes off. Each cell, and each small range of U2, has the three values of `windows`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.edges import GAUSS, WEIGHT, fastest, moments, push, speed
from inkjet_env.experiments.bounds.head_numbers import GAIN, OMEGA, SIGMA
from inkjet_env.experiments.bounds.trajectory import (
    CELL,
    LEAST_CELLS,
    NODE_COLUMNS,
    SLOPE,
    SLOPE_CHANGE,
    SLOPE_RADIUS,
    Y_RADIUS,
    Y,
)
from inkjet_env.experiments.bounds.windows import NEVER, pass_all
from inkjet_env.typing import Real

BLOCK = 4
"""Cells of a block, along either axis; a divisor of half the cells of a turn."""
LAST_EDGE = np.int64(4)
"""Number of that segment; a number of numpy, since numba compiles a function again for each Python constant."""


@dataclass(frozen=True)
class Grid:
    """Cells of the plane of ``z``.

    Attributes
    ----------
    angles : int
        Cells of a turn; a multiple of 2^`table_cells.LEVELS`.
    turn : int
        Cells of log ρ that a turn takes off.
    smallest : float
        ρ at the first cell; all nearer to 0 is one cell, in volts.
    largest : float
        ρ at the last cell at least, in volts.
    """

    angles: int = 640
    turn: int = 60
    smallest: float = 0.1
    largest: float = 16.0

    def step(self, head: Real) -> float:
        """Width of a cell of log ρ."""
        return float(2.0 * math.pi * head[SIGMA] / head[OMEGA] / self.turn)

    def labels(self, head: Real) -> int:
        """Number of cells of log ρ."""
        return math.ceil(math.log(self.largest / self.smallest) / self.step(head)) + self.turn + 1


@njit(cache=True)
def ring_down(head, weights, longest_waveform, window):
    """What ``|z|`` at the end of the drive costs at least, as factors.

    The ring-down has an extremum every half turn; the first is at most half a turn away. Returns the factors of ``|z|``
    where the extremum after the effective one is over, where it is the first of the ring-down, and for the first
    magnitude; and the factor of the first magnitude where that is the effective one.
    """
    A, B = weights
    sigma, omega = head[SIGMA], head[OMEGA]
    ratio = math.exp(-sigma * math.pi / omega)
    upright = omega / math.hypot(sigma, omega)
    count = max(int((window - longest_waveform) * omega / math.pi) - 1, 0)
    first = upright * ratio if count > 0 else 0.0
    total = first * (1.0 - ratio**count) / (1.0 - ratio)
    alone = A + (B * ratio if count > 1 else 0.0)
    for k in range(2, count):
        alone += ratio**k
    return total, total + (B - 1.0) * first, first, alone


@njit(cache=True)
def last_edge(head, b, radius_b, shortest, longest, longest_cell, courses, spreads):
    """Fill how ``z`` at the nodes of the last edge depends on that at its start; return the number of cells.

    Parameters
    ----------
    head : ndarray
        `head_numbers`.
    b, radius_b : float
        The edge starts at −b within a radius, in volts.
    shortest, longest, longest_cell : float
        Limits of its duration, and of the distance of its nodes, in µs.
    courses : ndarray of complex, shape (nodes, 4)
        Filled with factor and push at the duration in the middle, and by how much they change to the longest one to
        first order.
    spreads : ndarray, shape (nodes, 4)
        Filled with what is added to the radius of ``z``: for each volt of ``z`` at the start, and of its radius there,
        and in volts; and with a bound of the speed of the hysteretic drive before the node, in V/µs.
    """
    sigma, gain = head[SIGMA], head[GAIN]
    pole = complex(-sigma, head[OMEGA])
    duration, radius = 0.5 * (shortest + longest), 0.5 * (longest - shortest)
    cells = max(LEAST_CELLS, math.ceil(longest / longest_cell))
    found = np.zeros(5)
    part = np.empty(4, np.complex128)
    moments(head, LAST_EDGE, 0.0, b, 0.0, radius_b, longest, found)
    courses[0], spreads[0] = 0.0, 0.0
    courses[0, 0], spreads[0, 1] = 1.0, 1.0
    step = np.exp(pole * duration / cells)
    quadratic = 0.5 * (abs(pole) * radius) ** 2
    square = np.zeros(3)
    push_at, change_at = 0j, 0j
    for cell in range(cells):
        begin, stop = cell / cells, (cell + 1) / cells
        push(head, LAST_EDGE, 0.0, b, duration, begin, stop, part)
        # in the duration: of all before, which turns on for longer, and of the push in this cell
        change_at = step * (change_at + pole / cells * push_at) + part[1]
        push_at = step * push_at + part[0]
        factor = step * courses[cell, 0]
        courses[cell + 1, 0], courses[cell + 1, 1] = factor, push_at
        courses[cell + 1, 2], courses[cell + 1, 3] = radius * pole * stop * factor, radius * change_at
        # The second derivative of the push up to θ is at most |λ|² ∫ (θ − s)² |w(s)| ds.
        for k in range(GAUSS.size):
            theta = begin + GAUSS[k] * (stop - begin)
            w, _, _ = speed(head, LAST_EDGE, 0.0, b, theta)
            for power in range(3):
                square[power] += WEIGHT[k] * (stop - begin) * abs(w) * theta**power
        bent = 1.01 * (stop * stop * square[0] - 2.0 * stop * square[1] + square[2])
        largest = abs(factor) * math.exp(sigma * radius * stop)
        spreads[cell + 1, 0], spreads[cell + 1, 1] = quadratic * stop * stop * largest, largest
        spreads[cell + 1, 2] = gain * (quadratic * bent + found[3] + found[4])
        spreads[cell + 1, 3] = fastest(head, LAST_EDGE, 0.0, b, 0.0, radius_b, begin, stop)[0] / shortest
    return cells


@njit(cache=True)
def edge_to_go(head, weights, ring, z, radius, slope, courses, spreads, longest, cells, limits, nodes, to_go):
    """Fill ``to_go``, shape (3,), at the start of the last edge, for ``z`` within a radius and a sign of the slope.

    ``courses``, ``spreads`` and ``cells`` are of `last_edge`; ``limits`` are those of the largest extremum, in volts.
    """
    least, most = limits
    pole = complex(-head[SIGMA], head[OMEGA])
    size = abs(pole)
    cell = longest / cells
    magnitude = abs(z)
    at, moved, rest = z, 0j, 0.0
    change, before = 0.0, 0.0
    for k in range(cells + 1):
        at = courses[k, 0] * z + courses[k, 1]
        moved = courses[k, 2] * z + courses[k, 3]
        rest = spreads[k, 0] * magnitude + spreads[k, 1] * radius + spreads[k, 2]
        node = nodes[k]
        node[Y], node[SLOPE] = at.imag, (pole * at).imag
        node[Y_RADIUS], node[SLOPE_RADIUS] = abs(moved.imag) + rest, abs((pole * moved).imag) + size * rest
        if k > 0:
            fast = head[GAIN] * spreads[k, 3]
            change = (size * size * (before + fast * cell) + head[OMEGA] * fast) * cell
        before = _size(at) + _size(moved) + rest
        node[CELL], node[SLOPE_CHANGE] = cell, change
    end, away = _size(at), _size(moved) + rest
    outwards = away
    if end > away:
        along = (moved.real * at.real + moved.imag * at.imag) / end
        outwards = abs(along) + rest
    low = max(0.0, end - outwards)
    to_go[:] = NEVER
    if low * ring[2] > most:
        return
    if end + away >= least:
        to_go[0] = ring[3] * (low * ring[2] if ring[3] >= 0.0 else end + away)
    to_go[1], to_go[2] = ring[1] * low, ring[0] * low
    pass_all(weights, nodes, cells, slope, least, most, to_go)


@njit(cache=True)
def _size(z):
    """``|z|`` where its square neither over- nor underflows."""
    return math.sqrt(z.real * z.real + z.imag * z.imag)


@njit(cache=True, nogil=True)
def edge_table(head, weights, ring, low_b, high_b, bounds, levels, longest_cell, grid, limits, modes, table, inner):
    """Fill a table of the cost to go at the start of the last edge.

    Durations are halved where the least cost is, so often that the last pieces have 2^−levels of the first.

    Parameters
    ----------
    head : ndarray
        `head_numbers`.
    weights, ring, limits : tuple of floats
        A and B; `ring_down`; limits of the largest extremum in volts.
    low_b, high_b : float
        Range of −U2 in volts.
    bounds : tuple of two floats
        Range of the duration, in µs.
    levels : int
        Number of times that a duration is halved.
    longest_cell : float
        Largest distance of nodes, in µs.
    grid : tuple
        Angles of a turn, width of a cell of log ρ, smallest ρ.
    modes : tuple of two int
        First and last of the three values that are computed.
    table, inner : ndarray, shapes (labels, angles, 3) and (3,)
        Filled in volts: for every cell, and for everything nearer to 0.
    """
    angles, width, smallest = grid
    lean, turn = head[SIGMA] / head[OMEGA], 2.0 * math.pi / angles
    coarse = max(1, math.ceil(bounds[1] - bounds[0]))
    total = coarse * ((1 << (levels + 1)) - 1)
    starts = np.zeros(levels + 2, np.int64)
    for level in range(levels + 1):
        starts[level + 1] = starts[level] + (coarse << level)
    length = 1 + max(LEAST_CELLS, math.ceil(bounds[1] / longest_cell))
    courses, spreads = np.empty((total, length, 4), np.complex128), np.empty((total, length, 4))
    cells, longest = np.empty(total, np.int64), np.empty(total)
    b, radius_b = 0.5 * (low_b + high_b), 0.5 * (high_b - low_b)
    for level in range(levels + 1):
        for k in range(coarse << level):
            piece = starts[level] + k
            share = (bounds[1] - bounds[0]) / (coarse << level)
            longest[piece] = bounds[0] + share * (k + 1)
            cells[piece] = last_edge(
                head, b, radius_b, bounds[0] + share * k, longest[piece], longest_cell, courses[piece], spreads[piece]
            )
    pieces = courses, spreads, longest, cells
    room = np.zeros((length, NODE_COLUMNS)), np.empty(3)
    about, found = np.empty((coarse, 3)), np.empty((total, 3))
    open_pieces, known = np.empty(total, np.int64), np.empty(total, np.bool_)
    found[:coarse] = -NEVER
    _least_of(
        head, weights, ring, 0j, smallest, 0, pieces, limits, room, modes, starts, found, open_pieces, known, inner
    )
    # What every piece costs at least is found for a block of cells first: in most cells few pieces can be the least.
    outside = _share_of_cell(BLOCK, width, lean * turn, turn)
    share = _share_of_cell(1, width, lean * turn, turn)
    for label_block in range(0, table.shape[0], BLOCK):
        for angle_block in range(0, angles, BLOCK):
            slope = -1 if 2 * angle_block < angles else 1
            z = _centre(label_block + 0.5 * BLOCK, angle_block + 0.5 * BLOCK, smallest, width, lean, turn)
            for piece in range(coarse):
                _edge_piece(head, weights, ring, z, outside * abs(z), slope, pieces, limits, room, piece)
                about[piece] = room[1]
            for label in range(label_block, min(label_block + BLOCK, table.shape[0])):
                for angle in range(angle_block, angle_block + BLOCK):
                    z = _centre(label + 0.5, angle + 0.5, smallest, width, lean, turn)
                    found[:coarse] = about
                    _least_of(
                        head, weights, ring, z, share * abs(z), slope, pieces, limits, room, modes, starts, found,
                        open_pieces, known, table[label, angle],
                    )  # fmt: skip


@njit(cache=True)
def _centre(label, angle, smallest, width, lean, turn):
    """``z`` in volts at a place on the grid, in cells."""
    u = angle * turn
    return smallest * math.exp(label * width - lean * u) * np.exp(1j * (u + 0.5 * math.pi - math.atan(lean)))


@njit(cache=True)
def _share_of_cell(size, width, leaning, turn):
    """How far the corners of so many cells along either axis are from their centre at most, relative to its size."""
    outwards = math.exp(0.5 * size * (width + leaning))
    return math.hypot(outwards - 1.0, outwards * 0.5 * size * turn)


@njit(cache=True)
def _least_of(
    head, weights, ring, z, radius, slope, pieces, limits, room, modes, starts, found, open_pieces, known, least
):  # fmt: skip
    """Fill ``least`` with the least cost to go over all durations, from lower bounds ``found`` for the longest pieces.

    The piece with the least bound is bounded for this disc, if that is not ``known`` yet, or else halved.
    """
    count = starts[1]
    known[:count] = False
    for piece in range(count):
        open_pieces[piece] = piece
    for mode in range(modes[0], modes[1] + 1):
        while True:
            at = 0
            for k in range(1, count):
                if found[open_pieces[k], mode] < found[open_pieces[at], mode]:
                    at = k
            piece = open_pieces[at]
            if found[piece, mode] >= NEVER or (known[piece] and piece >= starts[-2]):
                break
            if not known[piece]:
                _edge_piece(head, weights, ring, z, radius, slope, pieces, limits, room, piece)
                for one in range(3):
                    found[piece, one] = max(found[piece, one], room[1][one])
                known[piece] = True
                continue
            level = 0
            while piece >= starts[level + 1]:
                level += 1
            child = starts[level + 1] + 2 * (piece - starts[level])
            found[child], found[child + 1] = found[piece], found[piece]
            known[child] = known[child + 1] = False
            open_pieces[at], open_pieces[count] = child, child + 1
            count += 1
        least[mode] = found[open_pieces[at], mode]


@njit(cache=True)
def _edge_piece(head, weights, ring, z, radius, slope, pieces, limits, room, piece):
    courses, spreads, longest, cells = pieces
    edge_to_go(
        head, weights, ring, z, radius, slope, courses[piece], spreads[piece], longest[piece], cells[piece], limits,
        room[0], room[1],
    )  # fmt: skip


@njit(cache=True, nogil=True)
def dwell_table(head, weights, edge, inner, bounds, grid, turn_labels, limits, table):
    """Fill a table of the cost to go at the start of the dwell before the last edge, from that at its end.

    Parameters
    ----------
    head, weights, grid, limits
        As for `edge_table`.
    edge, inner : ndarray, shapes (labels, angles, 3) and (3,)
        Filled by `edge_table`.
    bounds : tuple of two floats
        Range of the dwell, in µs.
    turn_labels : int
        Cells of log ρ that a turn takes off.
    table : ndarray, shape (labels, angles, 3)
        Filled, in volts.
    """
    A, B = weights
    least, most = limits
    sigma, omega = head[SIGMA], head[OMEGA]
    angles, width, smallest = grid
    turn = 2.0 * math.pi / angles
    upright = omega / math.hypot(sigma, omega)
    soonest = math.floor(omega * bounds[0] / turn)
    latest = math.ceil(omega * bounds[1] / turn) + 1
    to_go = np.empty(3)
    for label in range(table.shape[0]):
        for angle in range(angles):
            table[label, angle, :] = NEVER
            # what it costs so far to have come from one value of the cost to go to another
            stay, chosen, passed, still, after, done = 0.0, NEVER, NEVER, 0.0, NEVER, 0.0
            for moved in range(latest + 1):
                turns, now = (angle + moved) // angles, (angle + moved) % angles
                here = label - turns * turn_labels
                if moved > 0 and now % (angles // 2) == 0:
                    low = upright * smallest * math.exp(here * width - sigma / omega * now * turn)
                    high = low * math.exp(width)
                    if low > most:
                        break
                    passed = min(passed + low, chosen + B * low)
                    chosen = stay + A * min(high, most) if high >= least else NEVER
                    stay += low
                    after = min(after + low, still + B * low)
                    still = NEVER
                    done += low
                if moved < soonest:
                    continue
                for mode in range(3):
                    to_go[mode] = inner[mode] if here < 0 else edge[here, now, mode]
                cell = table[label, angle]
                cell[0] = min(cell[0], min(stay + to_go[0], min(chosen + to_go[1], passed + to_go[2])))
                cell[1] = min(cell[1], min(still + to_go[1], after + to_go[2]))
                cell[2] = min(cell[2], done + to_go[2])
