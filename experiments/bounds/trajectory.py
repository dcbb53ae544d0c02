"""The response to all waveforms of a box at once: at nodes that move with the corners of the drive.

At a node the response is that of the centre of the box, and differs from it within a radius. A node has two of these:
of the mean value theorem, with derivatives bounded over the box; and of the derivatives at the centre, with bounds of
the second ones, which shrinks with the square of the box once a linear part is taken off. The smaller one holds."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from inkjet_env.experiments.bounds.edges import GAUSS, WEIGHT, fastest, moments, push, speed, straight_from
from inkjet_env.experiments.bounds.head_numbers import GAIN, OMEGA, SIGMA

PARAMETERS = 7
"""a, b, then five durations."""
(Y, SLOPE, Y_RADIUS, SLOPE_RADIUS, SECOND, CELL, SLOPE_CHANGE, BEND, BEND_RADIUS, BEND_BEFORE, BEND_BEFORE_RADIUS,
 BEND_CHANGE) = range(12)  # fmt: skip
"""Columns of a node: response and slope at the centre, in V and V/µs, and their radii; what the second derivatives add
to the radius; longest duration of the cell before the node, in µs, and how much the slope can change over it; the
curvature, in V/µs², at the node and at the start of the cell, with radii, and how much it can change over the cell."""
GRADIENT = 12
"""First of the columns with the derivatives of the response."""
NODE_COLUMNS = GRADIENT + PARAMETERS
LEAST_CELLS = 6
"""Smallest number of cells of an edge."""


@njit(cache=True)
def follow(head, segments, low, high, shortest_cell, longest_cell, nodes, end, reach):
    """Follow the response to the end of a segment.

    Parameters
    ----------
    head : ndarray
        `head_numbers`.
    segments : int
        Number of segments, 1 to 5: edge, dwell, edge, dwell, edge.
    low, high : ndarray, shape (≥ 2 + segments,)
        Ends of the box: a, b in volts, durations in µs.
    shortest_cell, longest_cell : float
        Limits of the duration of a cell, in µs; within them it is the half width of the widest duration.
    nodes : ndarray, shape (n, NODE_COLUMNS)
        Filled.
    end : ndarray of complex, shape (1 + PARAMETERS,)
        Filled with ``z`` at the end, and its derivatives.
    reach : ndarray, shape (2,)
        Filled with the radius of ``z`` at the end, and what the second derivatives add to it.

    Returns
    -------
    int
        Number of the last node, or −1 if there are not enough.
    """
    sigma, omega, gain = head[SIGMA], head[OMEGA], head[GAIN]
    pole = complex(-sigma, omega)
    size = abs(pole)
    middle = 0.5 * (low + high)
    radius = 0.5 * (high - low)
    a, b = middle[0], middle[1]
    widest = 0.0
    for k in range(segments):
        widest = max(widest, radius[2 + k])
    cell_s = min(max(shortest_cell, widest), longest_cell)
    begun = np.zeros((3, 5))
    own, later, age = np.zeros(3), np.zeros(3), np.zeros(3)
    turned = np.empty(GAUSS.size, np.complex128)
    part = np.empty(4, np.complex128)
    end[:] = 0.0
    nodes[0, :] = 0.0
    reach[:] = 0.0
    edges = 0
    last = 0
    for segment in range(segments):
        j = 2 + segment
        duration = middle[j]
        forced = segment % 2 == 0
        cells = max(1, math.ceil(high[j] / cell_s))
        if forced:
            cells = max(cells, LEAST_CELLS)
        share = 1.0 / cells
        step = np.exp(pole * duration * share)
        longest = high[j] * share
        kink = 1.0
        if forced:
            kink = straight_from(head, segment, a, b)
            for k in range(GAUSS.size):
                turned[k] = gain * WEIGHT[k] * share * np.exp(pole * duration * share * (1.0 - GAUSS[k]))
            moments(head, segment, a, b, radius[0], radius[1], high[j], begun[edges])
            own[edges], later[edges], age[edges] = 0.0, 0.0, 0.0
            edges += 1
        before, before_radius = _curvature(head, segment, middle, radius, low[j], 0.0, nodes[last])
        for cell in range(cells):
            theta = (cell + 1) * share
            if forced and cell * share < kink < theta:
                push(head, segment, a, b, duration, cell * share, theta, part)
            else:
                part[:] = 0.0
                if forced:
                    for k in range(GAUSS.size):
                        w, in_a, in_b = speed(head, segment, a, b, (cell + GAUSS[k]) * share)
                        part[0] += turned[k] * w
                        part[1] += turned[k] * w * pole * share * (1.0 - GAUSS[k])
                        part[2] += turned[k] * in_a
                        part[3] += turned[k] * in_b
            quickest, changing = 0.0, 0.0
            if forced:
                quickest, changing = fastest(head, segment, a, b, radius[0], radius[1], cell * share, theta)
            curved = size * size * (abs(end[0]) + reach[0] + gain * quickest * share) + omega * gain * quickest / low[j]
            for k in range(j):
                end[1 + k] = step * end[1 + k]
            end[1 + j] = step * end[1 + j] + pole * share * step * end[0] + part[1]
            end[1] += part[2]
            end[2] += part[3]
            end[0] = step * end[0] + part[0]
            last += 1
            if last >= nodes.shape[0]:
                return -1
            plain, second = 0.0, 0.0
            for edge in range(edges):
                here = forced and edge == edges - 1
                mine = theta * radius[j] if here else own[edge]
                rest = later[edge] if here else later[edge] + theta * radius[j]
                left = 1.0 if here else math.exp(-sigma * (age[edge] + theta * low[j]))
                volts = begun[edge, 3] + begun[edge, 4]
                plain += left * gain * (size * (begun[edge, 1] * mine + begun[edge, 0] * rest) + volts)
                second += left * gain * (
                    0.5 * size * size
                    * (begun[edge, 2] * mine * mine + 2.0 * begun[edge, 1] * mine * rest + begun[edge, 0] * rest * rest)
                    + size * (mine + rest) * volts
                    + 0.5 * begun[edge, 4]
                )  # fmt: skip
            node = nodes[last]
            node[Y], node[SLOPE] = end[0].imag, (pole * end[0]).imag
            linear, linear_slope, linear_z = second, size * second, second
            for k in range(PARAMETERS):
                if k <= j:
                    node[GRADIENT + k] = end[1 + k].imag
                    linear += abs(end[1 + k].imag) * radius[k]
                    linear_slope += abs((pole * end[1 + k]).imag) * radius[k]
                    linear_z += abs(end[1 + k]) * radius[k]
                else:
                    node[GRADIENT + k] = 0.0
            node[Y_RADIUS], node[SLOPE_RADIUS], node[SECOND] = (
                min(linear, plain),
                min(linear_slope, size * plain),
                second,
            )
            reach[0], reach[1] = min(linear_z, plain), second
            node[CELL], node[SLOPE_CHANGE] = longest, curved * longest
            node[BEND_BEFORE], node[BEND_BEFORE_RADIUS] = before, before_radius
            before, before_radius = _curvature(head, segment, middle, radius, low[j], theta, node)
            node[BEND], node[BEND_RADIUS] = before, before_radius
            node[BEND_CHANGE] = (size * curved + omega * gain * changing / (low[j] * low[j])) * longest
        for edge in range(edges):
            if forced and edge == edges - 1:
                own[edge] = radius[j]
            else:
                later[edge] += radius[j]
                age[edge] += low[j]
    return last


@njit(cache=True)
def _curvature(head, segment, middle, radius, shortest, theta, node):
    """``y'' = −2σ y' − |λ|² y + ω g v'`` at a place of a segment, in V/µs², and its radius."""
    sigma, omega = head[SIGMA], head[OMEGA]
    stiffness = sigma * sigma + omega * omega
    bend = -2.0 * sigma * node[SLOPE] - stiffness * node[Y]
    spread = 2.0 * sigma * node[SLOPE_RADIUS] + stiffness * node[Y_RADIUS]
    if segment % 2 == 0:
        duration = middle[2 + segment]
        w, _, _ = speed(head, segment, middle[0], middle[1], theta)
        most, _ = fastest(head, segment, middle[0], middle[1], radius[0], radius[1], theta, theta)
        bend += omega * head[GAIN] * w / duration
        spread += omega * head[GAIN] * (most / shortest - abs(w) / duration)
    return bend, spread
