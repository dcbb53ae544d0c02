"""Sampled drives and responses as CSV files, written atomically."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from inkjet_env.printhead import Waveform
from inkjet_env.recordings.segment_file import segments_text
from inkjet_env.reporting.columns import columns_text
from inkjet_env.storage import write_atomically
from inkjet_env.typing import Real

DEFAULT_SAMPLE_RATE_Hz = 100e6
MAX_SAMPLES = 10_000_000


def write_columns(path: str | Path, columns: Mapping[str, Real]) -> None:
    """Write `columns_text` to a file."""
    write_atomically(path, columns_text(columns))


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


def waveform_files(waveform: Waveform) -> dict[str, str]:
    """Texts of a waveform's files by name: samples for a generator (CSV), segments for a print controller (INI)."""
    time_s, drive_V = sampled_waveform(waveform, DEFAULT_SAMPLE_RATE_Hz)
    return {
        "waveform.csv": columns_text({"time_s": time_s, "drive_V": drive_V}),
        "waveform.ini": segments_text(*waveform.knots()),
    }
