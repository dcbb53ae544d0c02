"""Responses and peak costs of arrays of waveforms, and their derivatives in the waveform and in the head, compiled.

`inkjet_env.torch` and `inkjet_env.jax` are made of these functions. A head is a row of a table, as in `batch`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.printhead import batch, compiled_edges, compiled_responses
from inkjet_env.printhead.compiled_gradient import HEAD_PARAMETERS, WAVEFORM
from inkjet_env.printhead.cost import PeakCost
from inkjet_env.printhead.hysteresis import BranchLaw
from inkjet_env.printhead.printhead import Printhead
from inkjet_env.printhead.waveform import as_waveform_array
from inkjet_env.printhead.window import DEFAULT_WINDOW_S, check_period
from inkjet_env.typing import Real


class HeadParameters(NamedTuple):
    """Parameters of heads in arrays of any library: one head, or a batch of shape (…).

    Attributes
    ----------
    a0, a1, b1 : array, shape (…)
        Coefficients of the resonator, in 1/s², 1/s and 1/s.
    coefficients : array, shape (…, degree)
        Dimensionless coefficients of the branch law, highest power first, without the constant, which is zero.
    """

    a0: Any
    a1: Any
    b1: Any
    coefficients: Any

    @classmethod
    def of(cls, printhead: Printhead) -> HeadParameters:
        """Those of one head, as NumPy arrays of shapes (), (), () and (degree,)."""
        values = (printhead.a0, printhead.a1, printhead.b1, printhead.coefficients[:-1])
        return cls(*(np.array(value) for value in values))

    def table(self, full_scale_V: float = 180.0) -> Real:
        """Head table of a batch of shape (n,), for `batch.costs` and for the functions of this module.

        Parameters
        ----------
        full_scale_V : float
            Change of drive at ``x = 1``, in volts.

        Raises
        ------
        ValueError
            A row is no head; the message gives the row and the rule.
        """
        a0, a1, b1, coefficients = (np.asarray(values, dtype=np.float64) for values in self)
        n, degree = coefficients.shape
        with np.errstate(invalid="ignore"):
            valid = (a1 >= 2e-6 * np.sqrt(a0)) & (a1 < 2 * np.sqrt(a0)) & np.isfinite(a0) & np.isfinite(b1) & (b1 != 0)
        valid &= (np.abs(coefficients) <= 1e9).all(axis=1)
        if not valid.all():
            row = int(np.argmin(valid))
            try:
                Printhead(float(a0[row]), float(a1[row]), float(b1[row]), (*coefficients[row], 0.0), full_scale_V)
            except ValueError as error:
                raise ValueError(f"head {row}: {error}") from None
        BranchLaw((*[0.0] * degree, 0.0), full_scale_V)  # the degree and the full scale
        slope = np.zeros((n, compiled_edges.MAX_DEGREE))
        slope[:, :degree] = coefficients[:, ::-1] * np.arange(1, degree + 1)
        return batch.assembled_table(a0, a1, b1, np.full(n, full_scale_V), np.full(n, float(degree)), slope)


def by_parameters(by_head: Real, degree: int) -> HeadParameters:
    """Derivatives in the head by the name of its parameter.

    Parameters
    ----------
    by_head : ndarray, shape (n, 19)
        Derivatives in the head, as the functions of this module return them.
    degree : int
        Degree of the branch law.

    Returns
    -------
    HeadParameters
        Of shapes (n,), (n,), (n,) and (n, degree).
    """
    return HeadParameters(by_head[:, 0], by_head[:, 1], by_head[:, 2], by_head[:, 3 : 3 + degree][:, ::-1])


def costs_and_derivatives(
    waveforms: ArrayLike,
    heads: Real,
    cost: PeakCost | None = None,
    initial_state: str = "periodic",
    window_s: float = DEFAULT_WINDOW_S,
    hysteresis: str = "full_memory",
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
    with_head: bool = True,
) -> tuple[Real, Real, Real]:
    """Peak cost of many waveforms, and its derivatives in the waveform and in the head.

    Parameters
    ----------
    waveforms : array_like, shape (n, 7)
        Waveform parameters ``U1 U2 t1 … t5``, in volts and seconds.
    heads : ndarray, shape (1 or n, columns)
        Rows of a head table.
    cost, initial_state, window_s, hysteresis, period_s, earlier_drops
        As in `batch.costs`.
    with_head : bool
        Whether derivatives in the head are wanted too; they take about as long again.

    Returns
    -------
    costs : ndarray, shape (n,)
        Costs in volts.
    by_waveform : ndarray, shape (n, 7)
        Derivatives in the waveform's parameters, V/V and V/s, exact where the cost is smooth.
    by_head : ndarray, shape (n, 19 or 0)
        Derivatives in the head's parameters; see `by_parameters`.
    """
    arguments, capacity, costs = batch.prepare(
        waveforms, heads, cost, initial_state, window_s, hysteresis, period_s, earlier_drops
    )
    by_waveform = np.empty((len(costs), WAVEFORM))
    by_head = np.empty((len(costs), HEAD_PARAMETERS if with_head else 0))
    while not compiled_responses.batch_costs_and_gradients(*arguments, capacity, costs, by_waveform, by_head):
        capacity *= 2
    return costs, by_waveform, by_head


def responses(
    waveforms: ArrayLike,
    heads: Real,
    time_s: ArrayLike,
    initial_state: str = "periodic",
    hysteresis: str = "full_memory",
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
) -> Real:
    """Response of many waveforms at given times.

    Parameters
    ----------
    waveforms : array_like, shape (n, 7)
        Waveform parameters ``U1 U2 t1 … t5``, in volts and seconds.
    heads : ndarray, shape (1 or n, columns)
        Rows of a head table.
    time_s : array_like, shape (k,)
        Times after the waveform's start, in seconds, at least 0, in ascending order.
    initial_state, hysteresis, period_s, earlier_drops
        As in `batch.costs`.

    Returns
    -------
    ndarray, shape (n, k)
        The self-sensed signal, in volts.
    """
    values, rows, settings, times = _checked(waveforms, heads, time_s, initial_state, hysteresis, period_s)
    found = np.empty((len(values), len(times)))
    compiled_responses.batch_responses(values, rows, *settings, float(earlier_drops), times, found)
    return found


def pull_back(
    waveforms: ArrayLike,
    heads: Real,
    time_s: ArrayLike,
    weights: Real,
    initial_state: str = "periodic",
    hysteresis: str = "full_memory",
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
    with_head: bool = True,
) -> tuple[Real, Real]:
    """Derivatives of ``Σ weights · responses`` over the times: the vector–Jacobian product of `responses`.

    Parameters
    ----------
    waveforms, heads, time_s, initial_state, hysteresis, period_s, earlier_drops
        As in `responses`.
    weights : ndarray, shape (n, k)
        Weight of each response at each time.
    with_head : bool
        As in `costs_and_derivatives`.

    Returns
    -------
    by_waveform, by_head : ndarray, shape (n, 7) and (n, 19 or 0)
        As in `costs_and_derivatives`.
    """
    values, rows, settings, times = _checked(waveforms, heads, time_s, initial_state, hysteresis, period_s)
    by_waveform = np.empty((len(values), WAVEFORM))
    by_head = np.empty((len(values), HEAD_PARAMETERS if with_head else 0))
    compiled_responses.batch_pull_back(
        values, rows, *settings, float(earlier_drops), times, np.ascontiguousarray(weights), by_waveform, by_head
    )
    return by_waveform, by_head


def _checked(
    waveforms: ArrayLike, heads: Real, time_s: ArrayLike, initial_state: str, hysteresis: str, period_s: float
) -> tuple[Real, Real, tuple[int, bool, float], Real]:
    values = as_waveform_array(waveforms)
    rows = batch.head_rows(heads, len(values))
    period = check_period(period_s, float(values[:, 2:].sum(axis=1).max(initial=0.0)), initial_state)
    times = np.ascontiguousarray(time_s, dtype=np.float64)
    if times.ndim != 1 or not np.isfinite(times).all() or (times < 0).any() or (np.diff(times) < 0).any():
        raise ValueError("time_s must be finite times in seconds, shape (k,), at least 0 and in ascending order.")
    return values, rows, (*batch.memory_settings(initial_state, hysteresis), period), times
