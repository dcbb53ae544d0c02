"""The printhead as differentiable functions of JAX: the peak cost, and the response at given times.

The same closed form and the same exact derivatives as in `inkjet_env.torch`, as callbacks on the CPU: they work under
`jax.jit`, `jax.grad` and `jax.vmap`. JAX computes in single precision unless told otherwise::

    import jax
    jax.config.update("jax_enable_x64", True)

    from inkjet_env.jax import peak_cost
    from inkjet_env.printhead import Printhead

    head = Printhead.published()
    jax.grad(lambda waveform: peak_cost(waveform, head))([90.0, -90.0, 3e-6, 9e-6, 12e-6, 9e-6, 15e-6])
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.extras import extra
from inkjet_env.printhead import sensitivity
from inkjet_env.printhead.batch import head_table
from inkjet_env.printhead.cost import PeakCost
from inkjet_env.printhead.printhead import Printhead
from inkjet_env.printhead.sensitivity import HeadParameters
from inkjet_env.printhead.window import DEFAULT_WINDOW_S
from inkjet_env.typing import Real

with extra("inkjet_env.jax"):
    import jax
    import jax.numpy as jnp

__all__ = ["HeadParameters", "peak_cost", "response"]


def peak_cost(
    waveforms: Any,
    head: Printhead | HeadParameters,
    cost: PeakCost | None = None,
    *,
    initial_state: str = "periodic",
    window_s: float = DEFAULT_WINDOW_S,
    hysteresis: str = "full_memory",
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
    full_scale_V: float = 180.0,
) -> jax.Array:
    """Peak cost of waveforms, differentiable once, in reverse mode.

    Parameters
    ----------
    waveforms : jax.Array, shape (…, 7)
        Waveform parameters in the order ``U1 U2 t1 … t5``, in volts and seconds.
    head : Printhead or HeadParameters
        The head. Arrays, as of ``HeadParameters.of(printhead)``, are differentiated too; their batch shapes broadcast.
    cost, initial_state, window_s, hysteresis, period_s, earlier_drops, full_scale_V
        As in `inkjet_env.torch.peak_cost`.

    Returns
    -------
    jax.Array, shape (…)
        Cost in volts.
    """
    arguments: dict[str, Any] = {
        "cost": cost,
        "window_s": window_s,
        "initial_state": initial_state,
        "hysteresis": hysteresis,
        "period_s": period_s,
        "earlier_drops": earlier_drops,
    }
    inputs, table = _inputs(waveforms, head, full_scale_V)
    shape = inputs[0].shape[:-1]

    def value(*inputs: np.ndarray) -> np.ndarray:
        rows, batch = _rows(inputs)
        return sensitivity.costs_and_derivatives(rows, table(inputs[1:]), with_head=False, **arguments)[0].reshape(
            batch
        )

    def derivatives(*inputs: np.ndarray) -> tuple[np.ndarray, ...]:
        rows, batch = _rows(inputs)
        costs, by_waveform, by_head = sensitivity.costs_and_derivatives(
            rows, table(inputs[1:]), with_head=len(inputs) > 1, **arguments
        )
        return costs.reshape(batch), *_shaped(batch, by_waveform, by_head, inputs)

    @jax.custom_vjp
    def called(*inputs: jax.Array) -> jax.Array:
        return _callback(value, _of(shape), *inputs)

    def forward(*inputs: jax.Array) -> tuple[jax.Array, tuple[jax.Array, ...]]:
        costs, *found = _callback(derivatives, (_of(shape), *(_of(values.shape) for values in inputs)), *inputs)
        return costs, tuple(found)

    def backward(found: tuple[jax.Array, ...], by_cost: jax.Array) -> tuple[jax.Array, ...]:
        same = by_cost[..., None]  # the law's coefficients and the waveform have one axis more
        return tuple((same if values.ndim > by_cost.ndim else by_cost) * values for values in found)

    called.defvjp(forward, backward)
    return called(*inputs)


def response(
    waveforms: Any,
    time_s: ArrayLike,
    head: Printhead | HeadParameters,
    *,
    initial_state: str = "periodic",
    hysteresis: str = "full_memory",
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
    full_scale_V: float = 180.0,
) -> jax.Array:
    """Self-sensed signal of waveforms at given times, differentiable once, in reverse mode.

    Parameters
    ----------
    waveforms, head
        As in `peak_cost`.
    time_s : array_like, shape (k,)
        Times after the waveform's start, in seconds, at least 0, in ascending order; not differentiated.
    initial_state, hysteresis, period_s, earlier_drops, full_scale_V
        As in `inkjet_env.torch.response`.

    Returns
    -------
    jax.Array, shape (…, k)
        Signal in volts.
    """
    arguments: dict[str, Any] = {
        "time_s": np.asarray(time_s, dtype=np.float64),
        "initial_state": initial_state,
        "hysteresis": hysteresis,
        "period_s": period_s,
        "earlier_drops": earlier_drops,
    }
    inputs, table = _inputs(waveforms, head, full_scale_V)
    shape = (*inputs[0].shape[:-1], len(arguments["time_s"]))

    def value(*inputs: np.ndarray) -> np.ndarray:
        rows, batch = _rows(inputs)
        return sensitivity.responses(rows, table(inputs[1:]), **arguments).reshape((*batch, len(arguments["time_s"])))

    def pulled_back(by_signal: np.ndarray, *inputs: np.ndarray) -> tuple[np.ndarray, ...]:
        rows, batch = _rows(inputs)
        weights = np.asarray(by_signal, dtype=np.float64).reshape(len(rows), len(arguments["time_s"]))
        by_waveform, by_head = sensitivity.pull_back(
            rows, table(inputs[1:]), weights=weights, with_head=len(inputs) > 1, **arguments
        )
        return _shaped(batch, by_waveform, by_head, inputs)

    @jax.custom_vjp
    def called(*inputs: jax.Array) -> jax.Array:
        return _callback(value, _of(shape), *inputs)

    def forward(*inputs: jax.Array) -> tuple[jax.Array, tuple[jax.Array, ...]]:
        return called(*inputs), inputs

    def backward(inputs: tuple[jax.Array, ...], by_signal: jax.Array) -> tuple[jax.Array, ...]:
        return _callback(pulled_back, tuple(_of(values.shape) for values in inputs), by_signal, *inputs)

    called.defvjp(forward, backward)
    return called(*inputs)


def _inputs(
    waveforms: Any, head: Printhead | HeadParameters, full_scale_V: float
) -> tuple[list[jax.Array], Callable[[tuple[np.ndarray, ...]], Real]]:
    """What is differentiated, with one batch shape, and the head table of the inputs behind the waveforms."""
    waveforms = jnp.asarray(waveforms, dtype=float)
    if waveforms.shape[-1:] != (7,):
        raise ValueError(f"waveforms must have shape (…, 7), U1 U2 t1 … t5; got {waveforms.shape}.")
    if isinstance(head, Printhead):
        row = head_table(head)
        return [waveforms], lambda _: row
    *scalars, coefficients = (jnp.asarray(values, dtype=float) for values in head)
    shape = jnp.broadcast_shapes(waveforms.shape[:-1], *(values.shape for values in scalars), coefficients.shape[:-1])
    degree = coefficients.shape[-1]
    inputs = [jnp.broadcast_to(waveforms, (*shape, 7)), *(jnp.broadcast_to(values, shape) for values in scalars)]
    inputs.append(jnp.broadcast_to(coefficients, (*shape, degree)))

    def table(arrays: tuple[np.ndarray, ...]) -> Real:
        a0, a1, b1, law = (np.asarray(values, dtype=np.float64) for values in arrays)
        return HeadParameters(a0.ravel(), a1.ravel(), b1.ravel(), law.reshape(-1, degree)).table(full_scale_V)

    return inputs, table


def _of(shape: tuple[int, ...]) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(shape, jnp.result_type(float))


def _callback(function: Callable, result: Any, *inputs: jax.Array) -> Any:
    """``function`` on the CPU; the mapped dimensions of a `vmap` come first in all of its inputs."""

    def typed(*arrays: Any) -> Any:
        return jax.tree.map(lambda values: np.asarray(values, dtype=jnp.result_type(float)), function(*arrays))

    return jax.pure_callback(typed, result, *inputs, vmap_method="broadcast_all")


def _rows(inputs: tuple[np.ndarray, ...]) -> tuple[Real, tuple[int, ...]]:
    """Waveforms as rows, and the batch shape."""
    waveforms = np.asarray(inputs[0], dtype=np.float64)
    return waveforms.reshape(-1, 7), waveforms.shape[:-1]


def _shaped(batch: tuple[int, ...], by_waveform: Real, by_head: Real, inputs: tuple) -> tuple[np.ndarray, ...]:
    """Derivatives in each input, with the batch's shape."""
    found = [by_waveform]
    if len(inputs) > 1:
        found.extend(sensitivity.by_parameters(by_head, inputs[-1].shape[-1]))
    return tuple(values.reshape((*batch, *values.shape[1:])) for values in found)
