"""How much arithmetic an evaluation of the cost needs, and how much of it a core can do: the floor of its time.

The floor of `inkjet_env.printhead.lanes` counts the additions, multiplications, divisions and roots that its method
needs for each waveform alone. What a core can do is measured with products and sums that do not wait for each other.
What the kernel takes beyond the floor is waiting, picking out the extrema, and lanes whose edges are shorter than their
neighbours'."""

from __future__ import annotations

import time

import numpy as np
from numba import njit

from inkjet_env.printhead import Printhead, Waveform, batch
from inkjet_env.printhead.compiled_cells import CELL_RAD, FEWEST_TERMS, NEWTON_STEPS, TERMS_OF_A_CURVE
from inkjet_env.printhead.vector_type import LANES, load, spread, store
from inkjet_env.typing import Real

OF_A_TERM = 15
"""Operations for one term of a cell's series: the term itself, and the sums in the middle and at the end."""
OF_A_NEWTON_TERM = 6
"""Operations for one term of value, slope and curvature at an extremum."""
OF_A_RING = 150
"""Operations for a plateau or the final ring-down: angle, cosine, sine, exponentials."""
CHAINS = 16
"""Independent sums of products with which a core is kept busy."""
ROUNDS, REPETITIONS = 20_000, 20


def operations(waveforms: Real, head: Printhead) -> float:
    """Mean number of operations that the method of `lanes` needs for one of these waveforms, shape (n, 7)."""
    degree = len(head.coefficients) - 1
    terms = max(FEWEST_TERMS, degree + TERMS_OF_A_CURVE)
    pairs = degree * (degree - 1) / 2
    of_a_cell = OF_A_TERM * (terms - 2) + 2 * pairs + pairs  # series, bound of the push, shift to the next cell
    cells = (np.floor(2 * np.pi * head.frequency_Hz * waveforms[:, 2::2] / CELL_RAD) + 1).sum(axis=1)
    extrema = []
    for row in waveforms[:: max(1, len(waveforms) // 500)]:
        times, _ = batch.peaks(Waveform.from_array(row), head)
        ends = np.cumsum(row[2:])
        extrema.append(
            sum(int(((times > begin) & (times < end)).sum()) for begin, end in ((0, ends[0]), ends[1:3], ends[3:5]))
        )
    newton = NEWTON_STEPS * OF_A_NEWTON_TERM * terms * float(np.mean(extrema))
    return float(cells.mean()) * of_a_cell + newton + 3 * OF_A_RING + 2 * pairs


@njit
def _busy(numbers, rounds, result):
    a, b = load(numbers, 0), load(numbers, LANES)
    s0, s1, s2, s3, s4, s5, s6, s7 = a, a, a, a, a, a, a, a
    t0, t1, t2, t3, t4, t5, t6, t7 = b, b, b, b, b, b, b, b
    scale = spread(0.999)
    for _ in range(rounds):
        s0, s1, s2, s3 = s0 * scale + b, s1 * scale + b, s2 * scale + b, s3 * scale + b
        s4, s5, s6, s7 = s4 * scale + b, s5 * scale + b, s6 * scale + b, s7 * scale + b
        t0, t1, t2, t3 = t0 * scale + a, t1 * scale + a, t2 * scale + a, t3 * scale + a
        t4, t5, t6, t7 = t4 * scale + a, t5 * scale + a, t6 * scale + a, t7 * scale + a
    store(result, 0, s0 + s1 + s2 + s3 + s4 + s5 + s6 + s7 + t0 + t1 + t2 + t3 + t4 + t5 + t6 + t7)


def operations_a_second() -> float:
    """Additions and multiplications that this core does in a second, the best of several tries."""
    numbers, result = np.linspace(0.1, 0.9, 2 * LANES), np.empty(LANES)
    _busy(numbers, 1, result)
    best_s = np.inf
    for _ in range(REPETITIONS):
        begin_s = time.perf_counter()
        _busy(numbers, ROUNDS, result)
        best_s = min(best_s, time.perf_counter() - begin_s)
    return 2 * CHAINS * LANES * ROUNDS / best_s
