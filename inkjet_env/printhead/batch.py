"""The printhead for arrays of waveforms, compiled: the same numbers as `Printhead.respond`, thousands of times faster.

Importing this module imports numba. Compiled code is cached on disk; the first use on a machine compiles for some
seconds (`warm_up` does so in advance).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike, NDArray

from inkjet_env.naming import check_name
from inkjet_env.printhead import compiled, compiled_edges
from inkjet_env.printhead.cost import PeakCost
from inkjet_env.printhead.hysteresis import periods_before_recording
from inkjet_env.printhead.printhead import Printhead
from inkjet_env.printhead.waveform import Waveform, as_waveform_array
from inkjet_env.printhead.window import DEFAULT_WINDOW_S, check_window, window_in_train
from inkjet_env.typing import Real


@lru_cache
def _bernstein_of_curvature() -> Real:
    """Matrix from ``Q'`` (lowest power first) to Bernstein coefficients of ``Q''`` on each cell of 0…1.

    A polynomial lies within the range of its Bernstein coefficients, so their largest magnitude bounds ``|Q''|``.
    """
    degree, cells = compiled_edges.MAX_DEGREE - 2, compiled_edges.CURVATURE_CELLS
    matrix = np.zeros((compiled_edges.MAX_DEGREE, cells * (degree + 1)))
    for power in range(1, compiled_edges.MAX_DEGREE):
        for cell in range(cells):
            # d/dx x^power on x = (cell + t) / cells, expanded in t, then monomial → Bernstein.
            expanded = power * poly.polypow([cell / cells, 1 / cells], power - 1)
            expanded = np.concatenate([expanded, np.zeros(degree + 1 - expanded.size)])
            for j in range(degree + 1):
                matrix[power, cell * (degree + 1) + j] = sum(
                    math.comb(j, i) / math.comb(degree, i) * expanded[i] for i in range(j + 1)
                )
    return matrix


def assembled_table(a0: Real, a1: Real, b1: Real, full_scale_V: Real, degree: Real, slope: Real) -> Real:
    """Head table from columns of shape (n,) and the coefficients of ``Q'`` (n, MAX_DEGREE), lowest power first."""
    rows = np.empty((len(a0), compiled_edges.HEAD_COLUMNS))
    rows[:, compiled_edges.HEAD_A0], rows[:, compiled_edges.HEAD_A1], rows[:, compiled_edges.HEAD_B1] = a0, a1, b1
    rows[:, compiled_edges.HEAD_FULL_SCALE], rows[:, compiled_edges.HEAD_DEGREE] = full_scale_V, degree
    rows[:, compiled_edges.HEAD_END_SLOPE] = slope.sum(axis=1)
    rows[:, compiled_edges.HEAD_SLOPE : compiled_edges.HEAD_CURVATURE] = slope
    # einsum, not BLAS: the numbers of a row must not depend on the number of rows.
    bernstein = np.einsum("nk,kc->nc", slope, _bernstein_of_curvature())
    rows[:, compiled_edges.HEAD_CURVATURE :] = (
        np.abs(bernstein).reshape(len(a0), compiled_edges.CURVATURE_CELLS, -1).max(axis=2)
    )
    return rows


def head_table(printheads: Printhead | Sequence[Printhead]) -> Real:
    """Heads as rows of numbers for the compiled functions, shape (n, columns)."""
    heads = [printheads] if isinstance(printheads, Printhead) else list(printheads)
    slope = np.zeros((len(heads), compiled_edges.MAX_DEGREE))
    for row, head in zip(slope, heads, strict=True):
        derivative = poly.polyder(head.branch_law.ascending)
        row[: derivative.size] = derivative
    a0, a1, b1, full_scale_V, degree = np.array(
        [(h.a0, h.a1, h.b1, h.full_scale_V, len(h.coefficients) - 1) for h in heads]
    ).T
    return assembled_table(a0, a1, b1, full_scale_V, degree, slope)


@lru_cache(maxsize=8)
def _base_row(printhead: Printhead) -> Real:
    return head_table(printhead)[0]


def varied_head_table(
    printhead: Printhead,
    frequency_Hz: ArrayLike,
    damping_ratio: ArrayLike,
    gain: ArrayLike,
    hysteresis_strength: ArrayLike,
) -> Real:
    """Head table of ``printhead.varied(…)`` for arrays of shape (n,), without constructing n printheads."""
    frequency, damping, factor, strength = np.atleast_1d(
        *np.broadcast_arrays(
            *(np.asarray(v, dtype=np.float64) for v in (frequency_Hz, damping_ratio, gain, hysteresis_strength))
        )
    )
    omega = 2 * math.pi * frequency
    rows = np.tile(_base_row(printhead), (omega.size, 1))
    rows[:, compiled_edges.HEAD_A0] = omega * omega
    rows[:, compiled_edges.HEAD_A1] = 2 * damping * omega
    rows[:, compiled_edges.HEAD_B1] = printhead.b1 * factor
    rows[:, compiled_edges.HEAD_SLOPE + 1 : compiled_edges.HEAD_CURVATURE] *= strength[:, None]
    rows[:, compiled_edges.HEAD_END_SLOPE] = rows[:, compiled_edges.HEAD_SLOPE : compiled_edges.HEAD_CURVATURE].sum(
        axis=1
    )
    rows[:, compiled_edges.HEAD_CURVATURE :] *= np.abs(strength[:, None])
    return rows


def _capacity(heads: Real, longest_s: float, window_s: float) -> int:
    """Array length that holds all extrema: those of the ringing, those of its tail, and a few per edge."""
    rate = math.sqrt(float(heads[:, compiled_edges.HEAD_A0].max())) / math.pi
    decay = math.pi * float((heads[:, compiled_edges.HEAD_A1] / (2 * np.sqrt(heads[:, compiled_edges.HEAD_A0]))).min())
    tail = -math.log(compiled_edges.INFINITE_TAIL_FLOOR) / decay if math.isinf(window_s) else 0.0
    return int(rate * (longest_s if math.isinf(window_s) else min(window_s, 1e-2)) + tail) + 64


def _cost_settings(cost: PeakCost) -> tuple[float, float, int, float, float]:
    """A, B, rule, threshold in volts and target_height_V, as the compiled functions take them."""
    rule, threshold = compiled.EFFECTIVE_THRESHOLD, 0.0
    if cost.effective == "largest":
        rule = compiled.EFFECTIVE_LARGEST
    elif cost.effective == "first":
        rule = compiled.EFFECTIVE_FIRST
    else:
        threshold = float(cost.effective)
    return cost.A, cost.B, rule, threshold, float(cost.target_height_V)


def memory_settings(initial_state: str, hysteresis: str) -> tuple[int, bool]:
    """Warm-up periods, and whether one point alone is remembered, as the compiled functions take them."""
    check_name("hysteresis", hysteresis, ("full_memory", "one_point"))
    return periods_before_recording(initial_state), hysteresis == "one_point"


def head_rows(heads: Printhead | Real, count: int) -> Real:
    """Head table of a head, or a given one; ``ValueError`` unless it has 1 or ``count`` rows."""
    rows = head_table(heads) if isinstance(heads, Printhead) else heads
    if rows.ndim != 2 or rows.shape[1] != compiled_edges.HEAD_COLUMNS or len(rows) not in (1, count):
        raise ValueError(f"heads must be a Printhead or a head table of 1 or {count} rows; got shape {rows.shape}.")
    return rows


def prepare(
    waveforms: ArrayLike,
    heads: Printhead | Real,
    cost: PeakCost | None,
    initial_state: str,
    window_s: float,
    hysteresis: str,
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
) -> tuple[tuple, int, Real]:
    """Checked arguments of `compiled.batch_costs`, for callers that check once and evaluate often.

    Returns
    -------
    arguments : tuple
        Waveforms, head rows and settings, checked, as ``(waveforms, heads, *settings)``.
    capacity : int
        Number of extrema that the longest of these waveforms may have; double it when ``batch_costs`` returns False.
    costs : ndarray, shape (n,)
        Empty array for the costs, in volts.
    """
    values = as_waveform_array(waveforms)
    rows = head_rows(heads, len(values))
    cost = cost or PeakCost()
    longest_s = float(values[:, 2:].sum(axis=1).max(initial=0.0))
    period, window = window_in_train(window_s, period_s, earlier_drops, longest_s, initial_state)
    capacity = _capacity(rows, longest_s, window)
    arguments = (
        values,
        rows,
        *memory_settings(initial_state, hysteresis),
        window,
        period,
        float(earlier_drops),
        *_cost_settings(cost),
    )
    return arguments, capacity, np.empty(len(values))


def costs(
    waveforms: ArrayLike,
    heads: Printhead | Real,
    cost: PeakCost | None = None,
    initial_state: str = "periodic",
    window_s: float = DEFAULT_WINDOW_S,
    hysteresis: str = "full_memory",
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
) -> Real:
    """Peak cost of many waveforms.

    Parameters
    ----------
    waveforms : array_like, shape (n, 7)
        Waveform parameters in the order ``U1 U2 t1 … t5``, in volts and seconds.
    heads : Printhead or ndarray, shape (1 or n, columns)
        One head for all waveforms, or rows of `head_table` / `varied_head_table`, one per waveform.
    cost : PeakCost, optional
        Weights and effective peak; the default is ``PeakCost()``.
    initial_state, window_s, hysteresis, period_s, earlier_drops
        As in `Printhead.respond` (without ``play_operators``).

    Returns
    -------
    ndarray, shape (n,)
        Costs in volts. The cost of a row does not depend on the other rows.

    Raises
    ------
    ValueError
        Wrong shape, a value that is not finite, or a waveform outside the rules of `Waveform`.
    """
    arguments, capacity, result = prepare(
        waveforms, heads, cost, initial_state, window_s, hysteresis, period_s, earlier_drops
    )
    rows, table, *settings = arguments
    fill_costs(rows, table, tuple(settings), capacity, result)
    return result


def fill_costs(rows: Real, table: Real, settings: tuple, capacity: int, result: Real) -> None:
    """Fill ``result`` (n,) with costs in volts; all arguments are those that `prepare` returns."""
    while not compiled.batch_costs(rows, table, settings, capacity, result):
        capacity *= 2


def fill_marked_costs(
    marked: NDArray[np.bool_], rows: Real, table: Real, settings: tuple, capacity: int, result: Real
) -> None:
    """`fill_costs` for the marked ones of n rows alone; the mask has shape (n,)."""
    if marked.any():
        found = np.empty(np.count_nonzero(marked))
        fill_costs(rows[marked], table[marked] if len(table) > 1 else table, settings, capacity, found)
        result[marked] = found


def costs_and_gradients(
    waveforms: ArrayLike,
    heads: Printhead | Real,
    cost: PeakCost | None = None,
    initial_state: str = "periodic",
    window_s: float = DEFAULT_WINDOW_S,
    hysteresis: str = "full_memory",
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
) -> tuple[Real, Real]:
    """Peak cost of many waveforms and its gradient; parameters as in `costs`.

    Returns
    -------
    costs : ndarray, shape (n,)
        Costs in volts.
    gradients : ndarray, shape (n, 7)
        Derivatives with respect to ``U1 U2`` (V/V) and ``t1 … t5`` (V/s). Exact where the cost is smooth: durations
        above zero, and no peak about to appear, to leave the window or to change its role in the cost.
    """
    from inkjet_env.printhead.compiled_responses import batch_costs_and_gradients

    arguments, capacity, result = prepare(
        waveforms, heads, cost, initial_state, window_s, hysteresis, period_s, earlier_drops
    )
    gradients = np.empty((len(result), 7))
    in_head = np.empty((len(result), 0))
    while not batch_costs_and_gradients(*arguments, capacity, result, gradients, in_head):
        capacity *= 2
    return result, gradients


def peaks(
    waveform: Waveform,
    head: Printhead,
    initial_state: str = "periodic",
    window_s: float = DEFAULT_WINDOW_S,
    hysteresis: str = "full_memory",
) -> tuple[Real, Real]:
    """Times in seconds and signed values in volts of every extremum, shape (k,): `Printhead.respond`, compiled."""
    warm_up_periods, one_point = memory_settings(initial_state, hysteresis)
    row, window = head_table(head)[0], check_window(window_s)
    knots_s, knots_V = waveform.knots()
    pieces = np.empty((40, 6))
    found = compiled.branch_pieces(knots_V, head.full_scale_V, warm_up_periods, one_point, np.empty(32), pieces)
    scratch = np.empty(compiled_edges.MAX_DEGREE), np.empty(compiled_edges.SERIES_TERMS + 2), np.empty((64, 4))
    capacity = _capacity(row[None, :], waveform.duration_s, window)
    while True:
        times, values = np.empty(capacity), np.empty(capacity)
        count, _ = compiled.response_extrema(
            row, knots_s, pieces, found, window, np.zeros(2), *scratch, times, values, np.empty(0)
        )
        if count != compiled_edges.OVERFLOW:
            return times[:count].copy(), values[:count].copy()
        capacity *= 2


def warm_up() -> None:
    """Compile every kernel that this module uses, or load it from the cache."""
    head, waveform = Printhead.published(), Waveform(50.0, -50.0, 5e-6, 5e-6, 5e-6, 5e-6, 5e-6)
    costs_and_gradients(waveform.to_array(), head)
    for period_s in (math.inf, 1e-4):
        costs(waveform.to_array(), head, period_s=period_s)
    peaks(waveform, head)
