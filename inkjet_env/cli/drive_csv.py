"""Sampled drives and responses as CSV files, written atomically."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from inkjet_env.printhead import Waveform
from inkjet_env.storage import write_atomically
from inkjet_env.typing import Real

DEFAULT_SAMPLE_RATE_Hz = 100e6
MAX_SAMPLES = 10_000_000


def write_columns(path: str | Path, columns: Mapping[str, Real]) -> None:
    """Write `columns_text` to a file."""
    write_atomically(path, columns_text(columns))


def columns_text(columns: Mapping[str, Real]) -> str:
    """Columns of equal length as CSV with a header line; all numbers but times are read back exactly.

    Times (names ending in ``_s``) have 12 significant digits, so that ``k / rate`` is written without rounding noise.
    """
    formats = ["%.12g" if name.endswith("_s") else "%.17g" for name in columns]
    lines = [",".join(columns)]
    lines += [
        ",".join(f % value for f, value in zip(formats, row, strict=True))
        for row in zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    ]
    return "\n".join(lines) + "\n"


def sampled_waveform(waveform: Waveform, sample_rate_Hz: float) -> tuple[Real, Real]:
    """Times in seconds and drive in volts of a waveform at a uniform rate, for an arbitrary waveform generator.

    The first sample is at time 0 and the last at or just after the waveform's end; both are 0 V. A generator that
    interpolates linearly between samples cuts each corner by less than one sampling step.

    Raises
    ------
    ValueError
        The rate is not positive, or gives fewer than 11 or more than ten million samples.
    """
    if not (math.isfinite(sample_rate_Hz) and sample_rate_Hz > 0):
        raise ValueError(f"the sample rate must be a positive number of Hz; got {sample_rate_Hz:g}.")
    steps = math.ceil(waveform.duration_s * sample_rate_Hz * (1 - 1e-12))
    if not 10 <= steps < MAX_SAMPLES:
        raise ValueError(
            f"a sample rate of {sample_rate_Hz:g} Hz gives {steps + 1} samples of a waveform of "
            f"{waveform.duration_s * 1e6:.3g} µs; 11 to {MAX_SAMPLES} are allowed. Give another --sample-rate."
        )
    time_s = np.arange(steps + 1) / sample_rate_Hz
    drive_V = waveform.drive_V(time_s)
    drive_V[[0, -1]] = 0.0
    return time_s, drive_V
