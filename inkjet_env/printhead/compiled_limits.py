"""Compiled kernel that makes waveforms legal for a driver; users call `Bounds.from_unit`, not this module."""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead.kernel_cache import INTERNAL, kernel_jit

ROUNDING = 1e-10
"""Part of a step, or of a limit, that is rounding; less than the slack of `DriverLimits.excesses`."""
HALVINGS = 60
"""Bisections of the factor by which voltages are lowered; the last is below the rounding of a double."""

_jit = kernel_jit(__file__)
_inner = kernel_jit(__file__, **INTERNAL)


@_inner
def _up(value, step):
    """The least multiple of a step that is not below a value; the value itself if the step is 0."""
    return value if step == 0.0 else math.ceil(value / step - ROUNDING) * step


@_inner
def _down(value, step):
    """The largest multiple of a step that is not above a value."""
    return value if step == 0.0 else math.floor(value / step + ROUNDING) * step


@_inner
def _least_durations(U1, U2, low, high, rise_V_s, fall_V_s, step_s, longest_s, least):
    """Fill the shortest durations in seconds that these plateaus allow; whether they fit into the box and in sum."""
    least[0] = max(low[2], _up(U1 / rise_V_s, step_s))
    least[1] = low[3]
    least[2] = max(low[4], _up((U1 - U2) / fall_V_s, step_s))
    least[3] = low[5]
    least[4] = max(low[6], _up(-U2 / rise_V_s, step_s))
    total, fit = 0.0, True
    for k in range(5):
        total += least[k]
        fit &= least[k] <= high[2 + k] * (1.0 + ROUNDING)
    return fit and total <= longest_s * (1.0 + ROUNDING)


@_jit
def make_legal(waveforms, low, high, rise_V_s, fall_V_s, step_V, step_s, longest_s):
    """Change waveforms (n, 7), in volts and seconds, to legal ones.

    ``low`` and ``high``, shape (7,), are the ends of a box whose corner with the least voltages and durations is legal,
    and whose ends are multiples of the steps. Voltages are clipped to it and, if the edges that they need at the
    largest slew rates do not fit, lowered in proportion. Then durations are lengthened to what the slew rates need and,
    if the waveform is too long, shortened in proportion to what can be spared.
    """
    least = np.empty(5)
    for row in waveforms:
        U1, U2 = min(max(row[0], low[0]), high[0]), min(max(row[1], low[1]), high[1])
        if not _least_durations(U1, U2, low, high, rise_V_s, fall_V_s, step_s, longest_s, least):
            legal, illegal = 0.0, 1.0
            for _ in range(HALVINGS):
                part = (legal + illegal) / 2.0
                lower_U1, lower_U2 = low[0] + part * (U1 - low[0]), high[1] + part * (U2 - high[1])
                if _least_durations(lower_U1, lower_U2, low, high, rise_V_s, fall_V_s, step_s, longest_s, least):
                    legal = part
                else:
                    illegal = part
            U1, U2 = low[0] + legal * (U1 - low[0]), high[1] + legal * (U2 - high[1])
        U1, U2 = _down(U1, step_V), -_down(-U2, step_V)
        _least_durations(U1, U2, low, high, rise_V_s, fall_V_s, step_s, longest_s, least)
        spare, total = 0.0, 0.0
        for k in range(5):
            asked_s = row[2 + k] if step_s == 0.0 else math.floor(row[2 + k] / step_s + 0.5) * step_s
            row[2 + k] = min(max(asked_s, least[k]), max(high[2 + k], least[k]))
            total += row[2 + k]
            spare += row[2 + k] - least[k]
        if total > longest_s * (1.0 + ROUNDING):
            kept = max(0.0, 1.0 - (total - longest_s) / spare) if spare > 0.0 else 0.0
            for k in range(5):
                row[2 + k] = least[k] + _down(kept * (row[2 + k] - least[k]), step_s)
        row[0], row[1] = U1, U2
