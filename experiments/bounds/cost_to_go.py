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
def last_edge(head, b, radius_b, shortest, longest, longest_cell, factors, pushes, radii, speeds):
    """Fill factor and push of ``z`` at the nodes of the last edge, and the radius of the push; return their number.

    ``speeds`` is filled with bounds of the speed of the hysteretic drive before each node, in V/µs.

    The edge lasts from ``shortest`` to ``longest`` µs, and starts at −b within ``radius_b``.
    """
    sigma, gain = head[SIGMA], head[GAIN]
    pole = complex(-sigma, head[OMEGA])
    duration, radius = 0.5 * (shortest + longest), 0.5 * (longest - shortest)
    cells = max(LEAST_CELLS, math.ceil(longest / longest_cell))
    found = np.zeros(5)
    part = np.empty(4, np.complex128)
    moments(head, LAST_EDGE, 0.0, b, 0.0, radius_b, longest, found)
    factors[0], pushes[0], radii[0] = 1.0, 0.0, 0.0
    step = np.exp(pole * duration / cells)
    area, leaning = 0.0, 0.0
    for cell in range(cells):
        begin, stop = cell / cells, (cell + 1) / cells
        push(head, LAST_EDGE, 0.0, b, duration, begin, stop, part)
        speeds[cell + 1] = fastest(head, LAST_EDGE, 0.0, b, 0.0, radius_b, begin, stop)[0] / shortest
        factors[cell + 1] = step * factors[cell]
        pushes[cell + 1] = step * pushes[cell] + part[0]
        # The push up to θ changes with the duration by at most |λ| ∫ (θ − s) |w(s)| ds.
        for k in range(GAUSS.size):
            theta = begin + GAUSS[k] * (stop - begin)
            w, _, _ = speed(head, LAST_EDGE, 0.0, b, theta)
            area += WEIGHT[k] * (stop - begin) * abs(w)
            leaning += WEIGHT[k] * (stop - begin) * abs(w) * theta
        volts = found[3] + found[4]
        early = 1.01 * (stop * area - leaning) + stop * volts
        radii[cell + 1] = gain * (abs(pole) * radius * early + volts)
    return cells


@njit(cache=True)
def edge_to_go(
    head, weights, ring, z, radius, slope, factors, pushes, radii, speeds, duration_radius, longest, cells, limits,
    nodes, to_go,
):  # fmt: skip
    """Fill ``to_go``, shape (3,), at the start of the last edge, for ``z`` within a radius and a sign of the slope.

    ``limits`` are those of the largest extremum, in volts.
    """
    least, most = limits
    pole = complex(-head[SIGMA], head[OMEGA])
    size = abs(pole)
    cell = longest / cells
    farthest = abs(z) + radius
    change, before = 0.0, 0.0
    turned = size * duration_radius / cells * farthest
    kept = math.exp(head[SIGMA] * duration_radius)
    shrinks = abs(factors[1])
    for k in range(cells + 1):
        at = factors[k] * z + pushes[k]
        moved = (radius + turned * k) * kept + radii[k]
        kept *= shrinks
        node = nodes[k]
        node[Y], node[SLOPE] = at.imag, (pole * at).imag
        node[Y_RADIUS], node[SLOPE_RADIUS] = moved, size * moved
        if k > 0:
            fast = head[GAIN] * speeds[k]
            change = (size * size * (before + fast * cell) + head[OMEGA] * fast) * cell
        before = abs(at) + moved
        node[CELL], node[SLOPE_CHANGE] = cell, change
    end, moved = abs(factors[cells] * z + pushes[cells]), nodes[cells, Y_RADIUS]
    low = max(0.0, end - moved)
    to_go[:] = NEVER
    if low * ring[2] > most:
        return
    if end + moved >= least:
        to_go[0] = ring[3] * (low * ring[2] if ring[3] >= 0.0 else end + moved)
    to_go[1], to_go[2] = ring[1] * low, ring[0] * low
    pass_all(weights, nodes, cells, slope, least, most, to_go)


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
    first, final = modes
    sigma, omega, _gain = head[SIGMA], head[OMEGA], head[GAIN]
    angles, width, smallest = grid
    turn = 2.0 * math.pi / angles
    coarse = max(1, math.ceil(bounds[1] - bounds[0]))
    total = coarse * ((1 << (levels + 1)) - 1)
    starts = np.zeros(levels + 2, np.int64)
    for level in range(levels + 1):
        starts[level + 1] = starts[level] + (coarse << level)
    length = 1 + max(LEAST_CELLS, math.ceil(bounds[1] / longest_cell))
    factors, pushes = np.empty((total, length), np.complex128), np.empty((total, length), np.complex128)
    radii, speeds, cells = np.empty((total, length)), np.empty((total, length)), np.empty(total, np.int64)
    shortest, longest = np.empty(total), np.empty(total)
    b, radius_b = 0.5 * (low_b + high_b), 0.5 * (high_b - low_b)
    for level in range(levels + 1):
        for k in range(coarse << level):
            piece = starts[level] + k
            share = (bounds[1] - bounds[0]) / (coarse << level)
            shortest[piece] = bounds[0] + share * k
            longest[piece] = bounds[0] + share * (k + 1)
            cells[piece] = last_edge(
                head, b, radius_b, shortest[piece], longest[piece], longest_cell, factors[piece], pushes[piece],
                radii[piece], speeds[piece],
            )  # fmt: skip
    nodes = np.zeros((length, NODE_COLUMNS))
    to_go, found, open_pieces = np.empty(3), np.empty((total, 3)), np.empty(total, np.int64)
    for label in range(-1, table.shape[0]):
        for angle in range(angles):
            if label < 0:
                if angle > 0:
                    break
                z, radius, slope = 0j, smallest, 0
            else:
                u = (angle + 0.5) * turn
                slope = -1 if 2 * angle < angles else 1
                magnitude = smallest * math.exp((label + 0.5) * width - sigma / omega * u)
                z = magnitude * np.exp(1j * (u + 0.5 * math.pi - math.atan2(sigma, omega)))
                # half a diagonal of the cell: it is ``width`` and its lean long, and ``turn`` wide
                radius = 1.03 * magnitude * math.hypot(math.exp(0.5 * (width + sigma / omega * turn)) - 1.0, 0.5 * turn)
            count = 0
            for piece in range(coarse):
                _edge_piece(
                    head, weights, ring, z, radius, slope, factors, pushes, radii, speeds, shortest, longest, cells,
                    limits, nodes, to_go, piece,
                )  # fmt: skip
                found[piece] = to_go
                open_pieces[count] = piece
                count += 1
            while True:
                halved = -1
                for mode in range(first, final + 1):
                    least, at = NEVER, -1
                    for k in range(count):
                        if found[open_pieces[k], mode] < least:
                            least, at = found[open_pieces[k], mode], k
                    if at >= 0 and open_pieces[at] < starts[levels]:
                        halved = at
                        break
                if halved < 0:
                    break
                piece = open_pieces[halved]
                level = 0
                while piece >= starts[level + 1]:
                    level += 1
                child = starts[level + 1] + 2 * (piece - starts[level])
                for one in range(child, child + 2):
                    _edge_piece(
                        head, weights, ring, z, radius, slope, factors, pushes, radii, speeds, shortest, longest, cells,
                        limits, nodes, to_go, one,
                    )  # fmt: skip
                    for mode in range(first, final + 1):
                        found[one, mode] = max(to_go[mode], found[piece, mode])
                open_pieces[halved] = child
                open_pieces[count] = child + 1
                count += 1
            for mode in range(first, final + 1):
                least = NEVER
                for k in range(count):
                    least = min(least, found[open_pieces[k], mode])
                if label < 0:
                    inner[mode] = least
                else:
                    table[label, angle, mode] = least


@njit(cache=True)
def _edge_piece(
    head, weights, ring, z, radius, slope, factors, pushes, radii, speeds, shortest, longest, cells, limits, nodes,
    to_go, piece,
):  # fmt: skip
    edge_to_go(
        head, weights, ring, z, radius, slope, factors[piece], pushes[piece], radii[piece], speeds[piece],
        0.5 * (longest[piece] - shortest[piece]), longest[piece], cells[piece], limits, nodes, to_go,
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
