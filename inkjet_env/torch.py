"""The printhead as differentiable functions of PyTorch: the peak cost, and the response at given times.

Both are the closed form with its exact derivatives, in the seven parameters of the waveform and in the parameters of
the head. They take batches of any shape, and work with `torch.autograd`, `torch.func.grad` and `torch.func.vmap`::

    import torch
    from inkjet_env.printhead import Printhead
    from inkjet_env.torch import peak_cost

    waveform = torch.tensor([90.0, -90.0, 3e-6, 9e-6, 12e-6, 9e-6, 15e-6], dtype=torch.float64, requires_grad=True)
    peak_cost(waveform, Printhead.published()).backward()
    waveform.grad

The peak cost is continuous in pieces only, so that descent alone stops at its steps (see the explanation of the model).
Computed in double precision on the CPU, whatever the tensors are; the result has the waveforms' type and device. Second
derivatives are not available, and asking for them is an error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
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

with extra("inkjet_env.torch"):
    import torch
    from torch import Tensor
    from torch.autograd import Function

__all__ = ["HeadParameters", "head_parameters", "peak_cost", "response"]


def head_parameters(printhead: Printhead) -> HeadParameters:
    """The parameters of a head as tensors in double precision, of shapes (), (), () and (degree,)."""
    return HeadParameters(*(torch.from_numpy(value) for value in HeadParameters.of(printhead)))


def peak_cost(
    waveforms: Tensor,
    head: Printhead | HeadParameters,
    cost: PeakCost | None = None,
    *,
    initial_state: str = "periodic",
    window_s: float = DEFAULT_WINDOW_S,
    hysteresis: str = "full_memory",
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
    full_scale_V: float = 180.0,
) -> Tensor:
    """Peak cost of waveforms, differentiable.

    Parameters
    ----------
    waveforms : Tensor, shape (…, 7)
        Waveform parameters in the order ``U1 U2 t1 … t5``, in volts and seconds.
    head : Printhead or HeadParameters
        The head. Tensors are differentiated too, and their batch shapes broadcast with that of the waveforms.
    cost : PeakCost, optional
        Weights and effective peak; the default is ``PeakCost()``.
    initial_state, window_s, hysteresis, period_s, earlier_drops
        As in `inkjet_env.printhead.Printhead.respond` (without ``play_operators``).
    full_scale_V : float
        Change of drive at ``x = 1`` in volts, for `HeadParameters`; a `Printhead` has its own.

    Returns
    -------
    Tensor, shape (…,)
        Cost in volts.

    Raises
    ------
    ValueError
        Wrong shape, a value that is not finite, a waveform outside the rules, or a row that is no head.

    Examples
    --------
    >>> waveform = torch.tensor([100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6], dtype=torch.float64)
    >>> peak_cost(waveform, Printhead.published()).round(decimals=2)
    tensor(-22.8300, dtype=torch.float64)
    """
    arguments = {
        "cost": cost,
        "window_s": window_s,
        "initial_state": initial_state,
        "hysteresis": hysteresis,
        "period_s": period_s,
        "earlier_drops": earlier_drops,
    }
    return _called(lambda *inputs: _PeakCost.apply(*inputs)[0], arguments, waveforms, head, full_scale_V)


def response(
    waveforms: Tensor,
    time_s: ArrayLike,
    head: Printhead | HeadParameters,
    *,
    initial_state: str = "periodic",
    hysteresis: str = "full_memory",
    period_s: float = math.inf,
    earlier_drops: float = math.inf,
    full_scale_V: float = 180.0,
) -> Tensor:
    """Self-sensed signal of waveforms at given times, differentiable in waveforms and head.

    Parameters
    ----------
    waveforms, head, initial_state, hysteresis, period_s, earlier_drops, full_scale_V
        As in `peak_cost`.
    time_s : array_like, shape (k,)
        Times after the waveform's start, in seconds, at least 0, in ascending order; the same for all waveforms, and
        not differentiated.

    Returns
    -------
    Tensor, shape (…, k)
        Signal in volts.
    """
    arguments = {
        "time_s": np.asarray(time_s, dtype=np.float64),
        "initial_state": initial_state,
        "hysteresis": hysteresis,
        "period_s": period_s,
        "earlier_drops": earlier_drops,
    }
    return _called(_Response.apply, arguments, waveforms, head, full_scale_V)


@dataclass(frozen=True, eq=False)
class _Model:
    """What is not differentiated: the arguments of a function of `sensitivity`, and the head if it is not tensors."""

    arguments: dict[str, Any]
    full_scale_V: float
    table: Real | None

    def rows(self, head: tuple[Tensor, ...]) -> Real:
        """Head table of tensors of shapes (…, ) and (…, degree), or of the one head."""
        if self.table is not None:
            return self.table
        a0, a1, b1, coefficients = (tensor.numpy() for tensor in head)
        flat = HeadParameters(a0.ravel(), a1.ravel(), b1.ravel(), coefficients.reshape(a0.size, coefficients.shape[-1]))
        return flat.table(self.full_scale_V)


def _called(
    function: Any, arguments: dict[str, Any], waveforms: Tensor, head: Printhead | HeadParameters, full_scale_V: float
) -> Tensor:
    """``function`` of tensors that have one batch shape; its result with the waveforms' type and device."""
    if waveforms.shape[-1:] != (7,):
        raise ValueError(f"waveforms must have shape (…, 7), U1 U2 t1 … t5; got {tuple(waveforms.shape)}.")
    computed = waveforms.to("cpu", torch.float64)
    if isinstance(head, Printhead):
        return function(_Model(arguments, full_scale_V, head_table(head)), computed).to(waveforms)
    *scalars, coefficients = (tensor.to("cpu", torch.float64) for tensor in head)
    shape = torch.broadcast_shapes(waveforms.shape[:-1], *(tensor.shape for tensor in scalars), coefficients.shape[:-1])
    tensors = [computed.expand(*shape, 7), *(tensor.expand(shape) for tensor in scalars)]
    tensors.append(coefficients.expand(*shape, coefficients.shape[-1]))
    return function(_Model(arguments, full_scale_V, None), *tensors).to(waveforms)


def _batched(info: Any, in_dims: tuple, tensors: tuple[Tensor, ...]) -> list[Tensor]:
    """The tensors of a `vmap` with the mapped dimension first, also those that it does not map."""
    return [
        tensor.expand(info.batch_size, *tensor.shape) if dim is None else tensor.movedim(dim, 0)
        for tensor, dim in zip(tensors, in_dims, strict=True)
    ]


def _tensors(shape: torch.Size, by_waveform: Real, by_head: Real, head: tuple[Tensor, ...]) -> list[Tensor]:
    """Derivatives in the waveforms, and in the head if it is given, as tensors of a batch shape."""
    found = [by_waveform]
    if head:
        found.extend(sensitivity.by_parameters(by_head, head[-1].shape[-1]))
    return [torch.from_numpy(np.ascontiguousarray(values)).reshape((*shape, *values.shape[1:])) for values in found]


class _PeakCost(Function):
    """Costs (…), and their derivatives in each input."""

    @staticmethod
    def forward(model: _Model, waveforms: Tensor, *head: Tensor) -> tuple[Tensor, ...]:
        shape = waveforms.shape[:-1]
        costs, by_waveform, by_head = sensitivity.costs_and_derivatives(
            waveforms.reshape(-1, 7).numpy(), model.rows(head), with_head=bool(head), **model.arguments
        )
        return torch.from_numpy(costs).reshape(shape), *_tensors(shape, by_waveform, by_head, head)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: tuple[Tensor, ...]) -> None:
        _, *derivatives = output
        ctx.mark_non_differentiable(*derivatives)
        ctx.save_for_backward(*derivatives, *inputs[1:])
        ctx.save_for_forward(*derivatives)

    @staticmethod
    def backward(ctx: Any, by_cost: Tensor, *_: Tensor) -> tuple:
        half = len(ctx.saved_tensors) // 2
        pairs = zip(ctx.saved_tensors[:half], ctx.saved_tensors[half:], strict=True)
        derivatives = [_FirstDerivative.apply(derivative, tensor) for derivative, tensor in pairs]
        same = by_cost[..., None]  # the waveform and the law's coefficients have one axis more
        return None, *((same if values.ndim > by_cost.ndim else by_cost) * values for values in derivatives)

    @staticmethod
    def jvp(ctx: Any, _: None, *tangents: Tensor | None) -> tuple:
        derivatives = ctx.saved_tensors
        total = None
        for derivative, tangent in zip(derivatives, tangents, strict=True):
            if tangent is not None:
                change = derivative * tangent
                change = change.sum(-1) if derivative.ndim > derivatives[0].ndim - 1 else change
                total = change if total is None else total + change
        return total, *[None] * len(derivatives)

    @staticmethod
    def vmap(info: Any, in_dims: tuple, model: _Model, *tensors: Tensor) -> tuple:
        found = _PeakCost.apply(model, *_batched(info, in_dims[1:], tensors))
        return found, (0,) * len(found)


class _FirstDerivative(Function):
    """A derivative, unchanged; it is not differentiated once more."""

    generate_vmap_rule = True

    @staticmethod
    def forward(derivative: Tensor, tensor: Tensor) -> Tensor:
        return derivative.clone()

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: Tensor) -> None:
        pass

    @staticmethod
    def backward(ctx: Any, *_: Tensor) -> tuple:
        raise NotImplementedError("second derivatives of the printhead are not available.")


class _Response(Function):
    """Signal (…, k) at the model's times."""

    @staticmethod
    def forward(model: _Model, waveforms: Tensor, *head: Tensor) -> Tensor:
        found = sensitivity.responses(waveforms.reshape(-1, 7).numpy(), model.rows(head), **model.arguments)
        return torch.from_numpy(found).reshape((*waveforms.shape[:-1], found.shape[1]))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: Tensor) -> None:
        ctx.model = inputs[0]
        ctx.save_for_backward(*inputs[1:])

    @staticmethod
    def backward(ctx: Any, by_signal: Tensor) -> tuple:
        return None, *_PullBack.apply(ctx.model, by_signal, *ctx.saved_tensors)

    @staticmethod
    def vmap(info: Any, in_dims: tuple, model: _Model, *tensors: Tensor) -> tuple:
        return _Response.apply(model, *_batched(info, in_dims[1:], tensors)), 0


class _PullBack(Function):
    """Derivatives in each input of `_Response`, of the sum of its signal times ``by_signal`` (…, k)."""

    @staticmethod
    def forward(model: _Model, by_signal: Tensor, waveforms: Tensor, *head: Tensor) -> tuple[Tensor, ...]:
        rows = waveforms.reshape(-1, 7).numpy()
        by_waveform, by_head = sensitivity.pull_back(
            rows,
            model.rows(head),
            weights=by_signal.reshape(len(rows), by_signal.shape[-1]).numpy(),
            with_head=bool(head),
            **model.arguments,
        )
        return tuple(_tensors(waveforms.shape[:-1], by_waveform, by_head, head))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: tuple) -> None:
        pass

    @staticmethod
    def backward(ctx: Any, *_: Tensor) -> tuple:
        raise NotImplementedError("second derivatives of the printhead are not available.")

    @staticmethod
    def vmap(info: Any, in_dims: tuple, model: _Model, *tensors: Tensor) -> tuple:
        found = _PullBack.apply(model, *_batched(info, in_dims[1:], tensors))
        return found, (0,) * len(found)
