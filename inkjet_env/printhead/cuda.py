"""Peak costs of many waveforms on a graphics processor: the kernels of `compiled`, one waveform a thread.

It needs NVIDIA's driver and the package numba-cuda (the extra ``cuda``). Without a graphics processor, numba's
simulator (``NUMBA_ENABLE_CUDASIM=1``) runs the same code, very slowly. The results agree with `batch.costs` within
1e-9 V, not bit for bit, since the processors round functions differently.
"""

from __future__ import annotations

import types
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
from numba import config, cuda, float64
from numba.core.dispatcher import Dispatcher
from numpy.typing import ArrayLike

from inkjet_env.printhead import batch, compiled
from inkjet_env.printhead.compiled_edges import HEAD_FULL_SCALE, MAX_DEGREE, OVERFLOW, SERIES_TERMS
from inkjet_env.printhead.cost import PeakCost
from inkjet_env.printhead.printhead import Printhead
from inkjet_env.printhead.window import DEFAULT_WINDOW_S
from inkjet_env.typing import Real

CAPACITY = 96
"""Extrema that a thread has room for; a waveform with more is left to `batch.costs`."""
TERMS = SERIES_TERMS + 2
"""Numbers of a power series, with its two initial values."""
THREADS = 128
"""Threads of a block."""


@cache
def device_function(kernel: Any) -> Any:
    """The device function of a function that `kernel_jit` compiled, with all functions that it calls."""
    function = kernel.py_func
    names = dict(function.__globals__)
    for name in function.__code__.co_names:
        if isinstance(names.get(name), Dispatcher):
            names[name] = device_function(names[name])
    copied = types.FunctionType(function.__code__, names, function.__name__, function.__defaults__)
    return cuda.jit(device=True)(copied)


@cache
def cost_kernel() -> Any:
    """The kernel: peak cost of each waveform on its head, NaN where `CAPACITY` is too small."""
    waveform_knots, branch_pieces = device_function(compiled.waveform_knots), device_function(compiled.branch_pieces)
    response_extrema, peak_cost = device_function(compiled.response_extrema), device_function(compiled.peak_cost)

    @cuda.jit
    def kernel(
        waveforms, heads, warm_up_periods, one_point, window_s, A, B, effective, threshold, target_height_V, costs
    ):
        i = cuda.grid(1)  # type: ignore[call-arg, var-annotated]  # the typing context is no argument of the call
        if i < waveforms.shape[0]:
            knots_s, knots_V = cuda.local.array(6, float64), cuda.local.array(6, float64)
            memory, pieces = cuda.local.array(32, float64), cuda.local.array((40, 6), float64)
            rate, series = cuda.local.array(MAX_DEGREE, float64), cuda.local.array(TERMS, float64)
            stack, state = cuda.local.array((64, 4), float64), cuda.local.array(2, float64)
            times, peaks = cuda.local.array(CAPACITY, float64), cuda.local.array(CAPACITY, float64)
            state[0], state[1] = 0.0, 0.0
            head = heads[i if heads.shape[0] > 1 else 0]
            waveform_knots(waveforms[i], knots_s, knots_V)
            found = branch_pieces(knots_V, head[HEAD_FULL_SCALE], warm_up_periods, one_point, memory, pieces)
            count, tail = response_extrema(
                head, knots_s, pieces, found, window_s, state, rate, series, stack, times, peaks, costs[:0]
            )
            if count == OVERFLOW:
                costs[i] = np.nan
            else:
                costs[i], _ = peak_cost(peaks, count, tail, A, B, effective, threshold, target_height_V)

    return kernel


def costs(
    waveforms: ArrayLike,
    heads: Printhead | Real,
    cost: PeakCost | None = None,
    initial_state: str = "periodic",
    window_s: float = DEFAULT_WINDOW_S,
    hysteresis: str = "full_memory",
) -> Real:
    """Peak cost of many waveforms, as `batch.costs`.

    Parameters
    ----------
    waveforms, heads, cost, initial_state, window_s, hysteresis
        As in `batch.costs`.

    Returns
    -------
    ndarray, shape (n,)
        Costs in volts.

    Raises
    ------
    ValueError
        As `batch.costs`.
    RuntimeError
        There is no graphics processor, and the simulator is not asked for.
    """
    check_device()
    arguments, capacity, result = batch.prepare(waveforms, heads, cost, initial_state, window_s, hysteresis)
    rows, table, *settings = arguments
    fill_costs(rows, table, tuple(settings), capacity, result)
    return result


def check_device() -> None:
    """Raise ``RuntimeError`` if there is no graphics processor, and the simulator is not asked for."""
    if not (getattr(config, "ENABLE_CUDASIM", 0) or (find_spec("numba_cuda") and cuda.is_available())):
        raise RuntimeError(
            "no CUDA device is found: inkjet_env.printhead.cuda needs an NVIDIA driver and the extra cuda. "
            "Without them, inkjet_env.printhead.lanes is the fastest."
        )


def fill_costs(rows: Real, table: Real, settings: tuple, capacity: int, result: Real) -> None:
    """Fill ``result`` (n,) with costs in volts, as `batch.fill_costs`; ``settings`` are those of a single drop."""
    warm_up_periods, one_point, window_s, _, _, *cost = settings
    if len(rows):
        on_device = cuda.device_array(len(rows))
        fire(cuda.to_device(rows), cuda.to_device(table), (warm_up_periods, one_point, window_s, *cost), on_device)
        on_device.copy_to_host(result)
    batch.fill_marked_costs(np.isnan(result), rows, table, settings, capacity, result)


def fire(waveforms: Any, heads: Any, settings: tuple, costs: Any) -> None:
    """Run the kernel on arrays that are on the device: waveforms (n, 7), heads (1 or n, columns) and costs (n,)."""
    blocks = (waveforms.shape[0] + THREADS - 1) // THREADS
    cost_kernel()[blocks, THREADS](waveforms, heads, *settings, costs)
