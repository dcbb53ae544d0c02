"""Exponential, cosine, sine and angle of vectors, for compiled code: power series, accurate to a few roundings."""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead.compiled_edges import FAST
from inkjet_env.printhead.kernel_cache import INTERNAL, kernel_jit
from inkjet_env.printhead.vector_type import floor, magnitude, root, spread, where

_inlined = kernel_jit(__file__, fastmath=FAST, forceinline=True, **INTERNAL)

_FACTORIALS = np.array([1.0 / math.factorial(k) for k in range(24)])
_ODD = np.array([1.0 / k if k % 2 else 0.0 for k in range(24)])
_HALF_PI, _PI_HIGH, _PI_LOW = 0.5 * math.pi, math.pi, 1.2246467991473532e-16


@_inlined
def exp(x):
    """``e^x`` for -4 ≤ x ≤ 0, to a few roundings."""
    x = x * 0.0625
    total = spread(_FACTORIALS[13])
    for k in range(12, -1, -1):
        total = total * x + _FACTORIALS[k]
    total = total * total
    total = total * total
    total = total * total
    return total * total


@_inlined
def cos_sin(phase):
    """Cosine and sine of a phase of moderate size, in radians."""
    turns = floor(phase * (1.0 / math.pi) + 0.5)
    r = (phase - turns * _PI_HIGH) - turns * _PI_LOW
    sign = 1.0 - 2.0 * (turns - 2.0 * floor(0.5 * turns))
    square = -1.0 * r * r
    c, s = spread(_FACTORIALS[22]), spread(_FACTORIALS[23])
    for k in range(20, -1, -2):
        c = c * square + _FACTORIALS[k]
        s = s * square + _FACTORIALS[k + 1]
    return sign * c, sign * s * r


@_inlined
def atan2(y, x):
    """Angle of (x, y), in radians; not for (0, 0)."""
    a, b = magnitude(y), magnitude(x)
    steep = a > b
    t = where(steep, b, a) / where(steep, a, b)
    t = t / (1.0 + root(1.0 + t * t))
    t = t / (1.0 + root(1.0 + t * t))
    square = -1.0 * t * t
    total = spread(_ODD[23])
    for k in range(21, 0, -2):
        total = total * square + _ODD[k]
    angle = 4.0 * t * total
    angle = where(steep, _HALF_PI - angle, angle)
    angle = where(x < 0.0, math.pi - angle, angle)
    return where(y < 0.0, -1.0 * angle, angle)
