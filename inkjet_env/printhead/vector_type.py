"""Vectors of eight numbers in compiled code: one instruction computes all eight.

In a function that `kernel_jit` compiles, ``load`` reads eight neighbouring numbers of an array as one value. It takes
``+ - * /`` and comparisons, with its like or with a number; ``store`` writes it back. A comparison gives a mask for
``where``; ``bits`` is its integer, of which bit i is lane i. From Python these functions cannot be called.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import extending
from numba.core import cgutils, types
from numba.extending import models, overload, register_model

intrinsic: Any = extending.intrinsic  # numba's annotation takes the typing context for an argument of the call
LANES = 8
"""Numbers in a vector."""
_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_BOOLEANS = ir.VectorType(ir.IntType(1), LANES)
_CONTRACT = ("contract", "nsz")


class Vector(types.Type):
    """Type of eight numbers."""

    def __init__(self) -> None:
        super().__init__(name="inkjet_env.vector")


class Mask(types.Type):
    """Type of eight truth values."""

    def __init__(self) -> None:
        super().__init__(name="inkjet_env.mask")


VECTOR, MASK = Vector(), Mask()


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLES)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BOOLEANS)


def _spread(builder: Any, number: Any) -> Any:
    """Eight times the same number."""
    one = builder.insert_element(ir.Constant(_DOUBLES, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(_DOUBLES, ir.Undefined), mask)


@intrinsic
def spread(typing: Any, number: Any) -> Any:
    """Eight times the same number."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _spread(builder, context.cast(builder, arguments[0], signature.args[0], types.float64))

    return VECTOR(number), code


def _pointer(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), _DOUBLES.as_pointer())


@intrinsic
def load(typing: Any, array: Any, at: Any) -> Any:
    """Elements ``at … at + 7`` of a contiguous array, shape (n,)."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_pointer(context, builder, signature.args[0], *arguments), align=8)

    return VECTOR(array, types.intp), code


@intrinsic
def store(typing: Any, array: Any, at: Any, vector: Any) -> Any:
    """Write a vector to elements ``at … at + 7`` of a contiguous array, shape (n,)."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        target, where, value = arguments
        builder.store(value, _pointer(context, builder, signature.args[0], target, where), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, VECTOR), code


def _unary(name: str) -> Any:
    def typed(typing: Any, vector: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            function = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(_DOUBLES, [_DOUBLES]), f"llvm.{name}.v{LANES}f64"
            )
            return builder.call(function, arguments)

        return VECTOR(VECTOR), code

    return intrinsic(typed)


magnitude, root, floor = _unary("fabs"), _unary("sqrt"), _unary("floor")


def _binary(instruction: str) -> Any:
    def typed(typing: Any, a: Any, b: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return getattr(builder, instruction)(*arguments, flags=_CONTRACT)

        return VECTOR(VECTOR, VECTOR), code

    return intrinsic(typed)


def _compared(sign: str) -> Any:
    def typed(typing: Any, a: Any, b: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.fcmp_ordered(sign, *arguments)

        return MASK(VECTOR, VECTOR), code

    return intrinsic(typed)


def _offer(symbol: Callable[..., Any], operation: Any) -> None:
    """Give vectors an operator, with each other and with numbers."""

    @overload(symbol)
    def chosen(a, b):
        if isinstance(a, Vector) and isinstance(b, Vector):
            return lambda a, b: operation(a, b)
        if isinstance(a, Vector) and isinstance(b, types.Number):
            return lambda a, b: operation(a, spread(b))
        if isinstance(a, types.Number) and isinstance(b, Vector):
            return lambda a, b: operation(spread(a), b)
        return None


for _symbol, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _offer(_symbol, _binary(_instruction))
for _symbol, _sign in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _offer(_symbol, _compared(_sign))


@intrinsic
def same(typing: Any, a: Any, b: Any) -> Any:
    """Where two vectors are equal."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fcmp_ordered("==", *arguments)

    return MASK(VECTOR, VECTOR), code


@intrinsic
def where(typing: Any, mask: Any, a: Any, b: Any) -> Any:
    """``a`` where the mask is true, else ``b``."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.select(*arguments)

    return VECTOR(MASK, VECTOR, VECTOR), code


def _logical(instruction: str) -> Any:
    def typed(typing: Any, a: Any, b: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return getattr(builder, instruction)(*arguments)

        return MASK(MASK, MASK), code

    return intrinsic(typed)


both, either, differ = _logical("and_"), _logical("or_"), _logical("xor")


@intrinsic
def bits(typing: Any, mask: Any) -> Any:
    """A mask as an integer, bit i for lane i."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.zext(builder.bitcast(arguments[0], ir.IntType(LANES)), ir.IntType(64))

    return types.int64(MASK), code
