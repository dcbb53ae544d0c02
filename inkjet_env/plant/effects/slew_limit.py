"""A drive amplifier that cannot follow steep edges."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.resonance import too_slow
from inkjet_env.plant.shot import Shot
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead

Real = NDArray[np.float64]

STARTS = 8
STEEPEST = 0.9
"""Of the steepest edge of all: where the starts begin."""
GENTLEST = 0.15
"""Of the median of the recordings' steepest edges: where they end."""
HALVINGS = 60
SETTLED = 1e-9
"""Of the most that a node allows."""


class SlewLimit(Effect):
    """The drive's rate is limited, up and down alike."""

    id = "slew_limit"
    stage = "drive"
    sentence = "The amplifier cannot follow steep edges."
    equation = "u' = clip(u_asked', -S, S) while u = u_asked, else S sign(u_asked - u)"
    source = "Horowitz & Hill, The Art of Electronics, 3rd edition, 2015, chapter 4: slew rate"
    parameters = (Parameter("slew_rate_V_s", "V/s", 1.0, math.inf, "reciprocal", "steepest edge it follows"),)
    strengths = ("slew_rate_V_s",)
    signature = "only edges steeper than some slope are late; gentle ones at the same level are not"
    confusable_with = ("amplifier_bandwidth",)
    shown_by = "trapezoids of one level with edges from gentle to as steep as can be asked for"

    def starts(self, printhead: Printhead, shots: Sequence[Shot]) -> list[dict[str, float]]:
        slopes = np.array([float(np.abs(np.diff(shot.drive_V)).max()) / shot.step_s for shot in shots if shot.fast])
        if not slopes.any():
            slopes = np.array([printhead.full_scale_V * printhead.frequency_Hz])
        limits = np.geomspace(STEEPEST * slopes.max(), GENTLEST * np.median(slopes[slopes > 0]), STARTS)
        return [{"slew_rate_V_s": float(limit)} for limit in limits]

    def untestable(self, shots: Sequence[Shot]) -> str | None:
        return too_slow(shots)

    def told(self, values: Values, unit: str = "V") -> str:
        return f"The amplifier cannot follow edges steeper than {with_prefix(values['slew_rate_V_s'], 'V/s', 3)}."

    def drive(self, values: Values, drive_V: Real, shot: Shot) -> Real:
        if math.isinf(values["slew_rate_V_s"]):
            return drive_V
        return slew_limited(drive_V, values["slew_rate_V_s"] * shot.node_step_s, shot.periodic)


def slew_limited(signal: Real, most: float, periodic: bool) -> Real:
    """A signal that is linear between nodes, followed by no more than ``most`` a node, shape (n,).

    From its first value on; or, where periodic, in a steady state of the repeated signal.
    """
    from inkjet_env.plant import compiled_drive

    ends = np.append(signal, signal[0]) if periodic else np.ascontiguousarray(signal)
    result = np.empty(ends.size)
    start = float(ends[0])
    end = compiled_drive.slew_limited(ends, most, start, result)
    if periodic and end != start:
        start, end = end, compiled_drive.slew_limited(ends, most, end, result)
    if periodic and abs(end - start) > SETTLED * most:  # laps would pass before it has caught up
        low, high = (start, float(ends.max())) if end > start else (float(ends.min()), start)
        for _ in range(HALVINGS):  # a lap brings any two beginnings nearer: below the steady state it rises
            middle = 0.5 * (low + high)
            if compiled_drive.slew_limited(ends, most, middle, result) > middle:
                low = middle
            else:
                high = middle
    return result[: signal.size]
