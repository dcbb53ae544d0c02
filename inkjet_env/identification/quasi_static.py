"""Whether recordings can show a resonance at all, judged from their sampling and their drives."""

from __future__ import annotations

import numpy as np

from inkjet_env.identification.basis import drive_basis
from inkjet_env.typing import Real

LOWEST_RESONANCE_Hz = 50.0
"""Resonances below this frequency are not looked for in displacement: printheads resonate at some ten kilohertz, and
the slowest piezo actuators at about a hundred hertz."""
MOST_CYCLES_A_SAMPLE = 0.45
"""Largest resonance that a sampled recording can show, in cycles per sample: just below Nyquist's limit."""
LEAST_DEPARTURE = 1e-3
"""Largest departure of such a slow head from its static response, as a share of the drive's swing, that no recording
resolves."""
DAMPING_RATIO = 0.05
"""Damping ratio of the head by which drives are judged."""


def may_ring(drive_V: Real, step_s: float, initial_state: str) -> bool:
    """Whether a displacement under this drive can show a resonance of `LOWEST_RESONANCE_Hz` or more.

    It cannot if a period of that resonance has too few samples, or if the drive is so slow and smooth that even this
    slowest head would follow it statically. A faster head follows it all the more closely.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        Drive at the samples, in volts.
    step_s : float
        Sampling step, in seconds.
    initial_state : {"demagnetised", "periodic", "free"}
        State at the first sample.

    Examples
    --------
    >>> slow = 90 * np.sin(2 * np.pi * np.arange(5000) / 5000)
    >>> may_ring(slow, 1e-3, "periodic"), may_ring(slow, 1e-6, "periodic")
    (False, True)
    """
    swing_V = float(np.ptp(drive_V))
    if swing_V == 0 or LOWEST_RESONANCE_Hz * step_s > MOST_CYCLES_A_SAMPLE:
        return False
    basis = drive_basis(drive_V, step_s, 2 * float(np.abs(drive_V).max()), 1, initial_state)
    omega = 2 * np.pi * LOWEST_RESONANCE_Hz
    departure = basis.response("displacement", omega**2, 2 * DAMPING_RATIO * omega) - basis.hysteretic_V()
    return bool(np.abs(departure).max() > LEAST_DEPARTURE * swing_V)
