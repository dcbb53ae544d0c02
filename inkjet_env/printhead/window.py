"""Times within which peaks count: a window after the start of the waveform, and the firing period."""

from __future__ import annotations

import math

import numpy as np

from inkjet_env.printhead.hysteresis import periods_before_recording

DEFAULT_WINDOW_S = 350e-6
"""Time after the waveform's start within which peaks count, in seconds."""

LONGEST_WINDOW_S = 0.01
"""Longest finite window accepted, in seconds."""


def check_window(window_s: float) -> float:
    """Return the window in seconds; ``ValueError`` unless it is above 0 s and at most 0.01 s, or infinite."""
    if isinstance(window_s, (int, float, np.number)) and (0 < window_s <= LONGEST_WINDOW_S or window_s == math.inf):
        return float(window_s)
    raise ValueError(
        f"window_s must be a time above 0 s and at most {LONGEST_WINDOW_S:g} s, or infinite; got {window_s!r}. "
        "It is in seconds: 350 µs is 350e-6."
    )


def check_period(period_s: float, duration_s: float, initial_state: str) -> float:
    """Return the period in seconds; ``ValueError`` unless it holds the waveform and repetition has a steady state."""
    if period_s == math.inf:
        return math.inf
    if not (isinstance(period_s, (int, float, np.number)) and period_s > 0):
        raise ValueError(f"period_s must be a time above 0 s, or infinite; got {period_s!r}. 20 kHz is 50e-6 s.")
    if duration_s > period_s * (1 + 1e-12):
        raise ValueError(
            f"a waveform of {duration_s:g} s does not fit into a period of {period_s:g} s. Shorten it, or fire slower."
        )
    if periods_before_recording(initial_state) == 0:
        raise ValueError('period_s needs initial_state="periodic": only a repeated waveform has a steady state.')
    return float(period_s)


def window_in_train(
    window_s: float, period_s: float, earlier_drops: float, duration_s: float, initial_state: str
) -> tuple[float, float]:
    """Period and window in seconds of a waveform in a train; ``ValueError`` if one of the numbers cannot be.

    Parameters
    ----------
    window_s : float
        Time after the waveform's start within which peaks count, in seconds.
    period_s : float
        Firing period in seconds; infinite for a single waveform.
    earlier_drops : float
        Number of waveforms before this one; infinite in a train without an end.
    duration_s : float
        Duration of the waveform, in seconds.
    initial_state : {"periodic", "demagnetised"}
        State of the hysteresis.

    Returns
    -------
    period_s, window_s : float
        In a train without an end the window is at most the period.
    """
    whole = isinstance(earlier_drops, (int, float, np.number)) and not isinstance(earlier_drops, bool)
    if not (whole and (earlier_drops == math.inf or (earlier_drops >= 0 and earlier_drops == int(earlier_drops)))):
        raise ValueError(f"earlier_drops must be a whole number of at least 0, or infinite; got {earlier_drops!r}.")
    period_s, window_s = check_period(period_s, duration_s, initial_state), check_window(window_s)
    return period_s, min(window_s, period_s) if earlier_drops == math.inf else window_s
