"""A drive amplifier that cannot follow steep edges."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

STARTS = 8
"""Number of slew rates among the starts."""
STEEPEST = 0.9
"""Highest slew rate of the starts, as a share of the steepest edge of all."""
GENTLEST = 0.15
"""Lowest slew rate of the starts, as a share of the median of the recordings' steepest edges."""
LAGS = (0.002, 0.05)
"""Lags of the starts, in periods of the head. Without a lag, a limit beyond all edges has no influence, whatever its
value."""
LINEAR = 5.0
"""Ratio to the steepest edge beyond which a limit does not show as one."""
FEWEST_STEPS = 1e-3
"""Lag in node steps below which there is none."""
HALVINGS = 60
"""Largest number of bisections for the steady state."""
SETTLED = 1e-9
"""Change over a period below which the state is steady, as a share of the largest change per node."""


class SlewLimit(Effect):
    """The rate of the drive is limited, equally for rising and falling edges or at a ratio."""

    id = "slew_limit"
    stage = "drive"
    sentence = "The amplifier cannot follow steep edges."
    equation = "u' = S tanh((u_requested - u) / (S τ)), S for rising and S fall_ratio for falling voltages"
    source = (
        "Horowitz & Hill, The Art of Electronics, 3rd edition, 2015, chapter 4: slew rate; J. E. Solomon, The "
        "monolithic op amp: a tutorial study, IEEE J. Solid-State Circuits 9(6), 1974: a tanh input stage"
    )
    parameters = (
        Parameter("slew_rate_V_s", "V/s", 1.0, math.inf, "reciprocal", "steepest slope that it can follow"),
        Parameter("lag_s", "s", 0.0, 1.0, meaning="τ: lag on gentler edges", open_ended=True, plain=0.0),
        Parameter(
            "fall_ratio", "1", 0.05, 20.0, "log", "steepest fall over steepest rise",
            open_ended=True, plain=1.0, later=True,
        ),
    )  # fmt: skip
    strengths = ("slew_rate_V_s",)
    characteristic = ("slew_rate_V_s",)
    signature = "only edges steeper than some slope are delayed; gentler ones at the same level are not"
    confusable_with = ("amplifier_bandwidth", "nonlinear_capacitance")
    shown_by = "trapezoids of one level, with edges from gentle to as steep as the generator allows"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        slopes = np.array(
            [
                float(np.abs(np.diff(excitation.drive_V)).max()) / excitation.step_s
                for excitation in excitations
                if excitation.fast
            ]
        )
        if not slopes.any():
            slopes = np.array([printhead.full_scale_V * printhead.frequency_Hz])
        limits = np.geomspace(STEEPEST * slopes.max(), GENTLEST * np.median(slopes[slopes > 0]), STARTS)
        lags_s = [lag / printhead.frequency_Hz for lag in LAGS]
        return [complete(self, slew_rate_V_s=float(limit), lag_s=lag_s) for lag_s in lags_s for limit in limits]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"slew_rate_V_s": 450.0 * printhead.frequency_Hz}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        steepest = max((float(np.abs(np.diff(s.drive_V)).max()) / s.step_s for s in excitations if s.fast), default=0.0)
        return {"slew_rate_V_s": (1.0, LINEAR * steepest)} if steepest > 1.0 else {}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        rise, ratio = values["slew_rate_V_s"], values["fall_ratio"]
        rising = with_prefix(rise, "V/s", 3)
        if ratio == 1:
            return f"The amplifier cannot follow edges steeper than {rising}."
        falling = with_prefix(ratio * rise, "V/s", 3)
        return (
            f"The amplifier cannot follow rising edges steeper than {rising} and falling ones steeper than {falling}."
        )

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        if math.isinf(values["slew_rate_V_s"]):
            return drive_V
        lag = values["lag_s"] / excitation.node_step_s
        most = values["slew_rate_V_s"] * excitation.node_step_s
        return slew_limited(drive_V, most, excitation.periodic, lag, values["fall_ratio"])


def slew_limited(signal: Real, most: float, periodic: bool, lag: float = 0.0, fall_ratio: float = 1.0) -> Real:
    """Follow a signal that is linear between nodes by at most ``most`` per node, shape (n,).

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Signal at the nodes, in volts.
    most : float
        Largest change per node, in volts: the largest rise.
    periodic : bool
        Whether the result is a steady state of the repeated signal; otherwise it starts at the first value.
    lag : float
        Time constant, in nodes, with which edges below the limit are followed.
    fall_ratio : float
        Largest fall per node over the largest rise.
    """
    from inkjet_env.plant import compiled_drive

    ends = np.append(signal, signal[0]) if periodic else np.ascontiguousarray(signal)
    result = np.empty(ends.size)
    fall = fall_ratio * most

    def after_a_period(start: float) -> float:
        if lag < FEWEST_STEPS:
            end: float = compiled_drive.slew_limited(ends, most, fall, start, result)
        else:
            end = compiled_drive.softly_slewed(ends, most, fall, lag, start, result)
        return end

    start = float(ends[0])
    end = after_a_period(start)
    if periodic and end != start:
        start, end = end, after_a_period(end)
    if periodic and abs(end - start) > SETTLED * min(most, fall):  # it would need many periods to catch up
        low, high = (start, float(ends.max())) if end > start else (float(ends.min()), start)
        for _ in range(HALVINGS):  # a period brings any two states closer: below the steady state it rises
            middle = 0.5 * (low + high)
            if after_a_period(middle) > middle:
                low = middle
            else:
                high = middle
    return result[: signal.size]
