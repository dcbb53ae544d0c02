"""Waveforms as arbitrary waveform generators take them: text files of four makers.

============= ======= =================================================================================================
siglent       CSV     ``data length,16384`` / ``frequency,…`` / ``amp,…`` / ``offset,…`` / ``phase,0`` … ``xpos,value``
rigol         CSV     ``RIGOL:DG1:CSV DATA FILE`` / ``TYPE:Arb`` / ``AMP:… Vpp`` … ``x,y[V]``, then ``,volts``
keysight      ARB     ``File Format:1.10`` … ``Sample Rate:…`` / ``High Level:…`` … ``Data:``, then whole numbers
rohde-schwarz CSV     ``Rate = …``, then ``volts``
============= ======= =================================================================================================

One period of the generator is the whole waveform. The first two hold a fixed number of samples, whose rate follows from
the waveform's length; the others hold samples at a rate that is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from inkjet_env.naming import check_name
from inkjet_env.typing import Real

POINTS = 16384
"""Number of samples of files that hold a fixed number."""
FULL_SCALE = 32767
"""Whole number for the highest level; its negative is the lowest."""
LARGEST_OUTPUT_V = 10.0
"""Largest voltage of common generators into a high impedance; beyond it, an amplifier is needed."""


def _siglent(volts: Real, rate_Hz: float) -> Sequence[str]:
    high, low = float(volts.max()), float(volts.min())
    return (
        f"data length,{volts.size}",
        f"frequency,{rate_Hz / volts.size:.9f}",
        f"amp,{high - low:.9f}",
        f"offset,{(high + low) / 2:.9f}",
        "phase,0.000000000",
        *[""] * 7,
        "xpos,value",
        *(f"{k},{v:.9g}" for k, v in enumerate(volts.tolist(), start=1)),
    )


def _rigol(volts: Real, rate_Hz: float) -> Sequence[str]:
    return (
        "RIGOL:DG1:CSV DATA FILE",
        "TYPE:Arb",
        f"AMP:{np.ptp(volts):.4f} Vpp",
        f"PERIOD:{volts.size / rate_Hz:.9E} S",
        f"DOTS:{volts.size}",
        "MODE:Normal",
        f"AFG Frequency:{rate_Hz / volts.size:.6f}",
        "AWG N:0",
        "x,y[V]",
        *(f",{v:.9g}" for v in volts.tolist()),
        "",
    )


def _keysight(volts: Real, rate_Hz: float) -> Sequence[str]:
    high, low = float(volts.max()), float(volts.min())
    half = (high - low) / 2 or 1.0
    levels = np.rint((volts - (high + low) / 2) / half * FULL_SCALE).astype(int)
    return (
        "File Format:1.10",
        "Checksum:0",
        "Channel Count:1",
        f"Sample Rate:{rate_Hz:.6f}",
        f"High Level:{high:.6f}",
        f"Low Level:{low:.6f}",
        'Data Type:"short"',
        'Filter:"off"',
        f"Data Points:{volts.size}",
        "Data:",
        *map(str, levels.tolist()),
    )


def _rohde_schwarz(volts: Real, rate_Hz: float) -> Sequence[str]:
    return (f"Rate = {rate_Hz:.12g}", *(f"{v:.9g}" for v in volts.tolist()))


MAKERS: dict[str, tuple[Callable[[Real, float], Sequence[str]], bool]] = {
    "siglent": (_siglent, True),
    "rigol": (_rigol, True),
    "keysight": (_keysight, False),
    "rohde-schwarz": (_rohde_schwarz, False),
}
"""Writer of each maker's file, and whether it holds `POINTS` samples whatever the waveform's length."""


def generator_text(
    maker: str, time_s: Real, drive_V: Real, sample_rate_Hz: float, amplifier_gain: float = 1.0
) -> tuple[str, str | None]:
    """A waveform as the text of a file for a generator, and what to mind.

    Parameters
    ----------
    maker : {"siglent", "rigol", "keysight", "rohde-schwarz"}
        Maker of the generator.
    time_s, drive_V : ndarray, shape (n,)
        Corners of the waveform: times in seconds from 0, and voltages at the head.
    sample_rate_Hz : float
        Sample rate, for files that may have any.
    amplifier_gain : float
        Gain of the amplifier between generator and head.

    Returns
    -------
    text : str
        Content of the file, with the line ends of Windows.
    note : str or None
        A sentence if the generator must put out more than most can.

    Raises
    ------
    ValueError
        The maker is unknown, the gain or the rate is not a positive number.
    """
    check_name("generator", maker, MAKERS)
    for name, value in (("amplifier gain", amplifier_gain), ("sample rate", sample_rate_Hz)):
        if not 0 < value < math.inf:
            raise ValueError(f"the {name} must be a positive number; got {value:g}.")
    write, fixed = MAKERS[maker]
    period_s = float(time_s[-1])
    count = POINTS if fixed else math.ceil(period_s * sample_rate_Hz * (1 - 1e-12)) + 1
    rate_Hz = POINTS / period_s if fixed else sample_rate_Hz
    volts = np.interp(np.arange(count) / rate_Hz, time_s, drive_V) / amplifier_gain
    largest_V = float(np.abs(volts).max())
    note = None
    if largest_V > LARGEST_OUTPUT_V:
        note = (
            f"the file asks the generator for {largest_V:.3g} V, and most give ±{LARGEST_OUTPUT_V:g} V: state the gain "
            "of the amplifier behind it with --amplifier."
        )
    return "\r\n".join(write(volts, rate_Hz)) + "\r\n", note
