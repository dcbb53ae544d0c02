"""Where a mismatch is: in which recordings, when, at which frequencies, at which voltages."""

from typing import Any

import numpy as np

from experiments.concealed_rig.measurement import Measurement


def shortest_run(power: np.ndarray, share: float = 0.5) -> tuple[int, int]:
    """First and last index of the shortest run that holds a share of the sum of `power`, shape (n,)."""
    total = np.concatenate(([0.0], np.cumsum(power)))
    wanted = share * total[-1]
    last = np.searchsorted(total, total[:-1] + wanted * (1 - 1e-12))
    length = np.where(last < total.size, last - np.arange(power.size), power.size + 1)
    first = int(np.argmin(length))
    return first, min(int(last[first]), power.size) - 1


def _frequency_band_Hz(mismatch: np.ndarray, step_s: float) -> list[float]:
    # The padding keeps the band of a short mismatch finer than its own width.
    size = 2 * mismatch.size
    power = np.abs(np.fft.rfft(mismatch - np.mean(mismatch), size)) ** 2
    first, last = shortest_run(power)
    frequency = np.fft.rfftfreq(size, step_s)
    return [float(frequency[first]), float(frequency[last])]


def location(rows: list[Measurement], mismatches: list[np.ndarray], most: int = 5) -> dict[str, Any]:
    """Where the mismatch of a campaign is.

    Parameters
    ----------
    rows : list of Measurement
    mismatches : list of ndarray
        In units of the noise, one a recording.
    most : int
        Recordings that are told in detail.

    Returns
    -------
    dict
        RMS over the noise by recording; the fewest recordings that hold half the power; for the largest ones the
        shortest span of time and the narrowest band that hold half of theirs, and the drive's range in that span.
    """
    power = np.array([float(np.sum(m**2)) for m in mismatches])
    rms = {row.name: float(np.sqrt(np.mean(m**2))) for row, m in zip(rows, mismatches, strict=True)}
    by_power = np.argsort(-power, kind="stable")
    if power.sum() == 0:
        return {"rms_over_noise": rms, "recordings": [], "details": []}
    count = int(np.searchsorted(np.cumsum(power[by_power]), 0.5 * power.sum())) + 1
    details = []
    for k in by_power[: min(most, max(count, 1))]:
        row, mismatch = rows[k], mismatches[k]
        first, last = shortest_run(mismatch**2)
        span = row.drive_V[first : last + 1]
        details.append(
            {
                "recording": row.name,
                "channel": row.channel,
                "share": float(power[k] / power.sum()),
                "time_s": [first * row.step_s, last * row.step_s],
                "frequency_Hz": _frequency_band_Hz(mismatch, row.step_s),
                "drive_V": [float(span.min()), float(span.max())],
                "recording_drive_V": [float(row.drive_V.min()), float(row.drive_V.max())],
            }
        )
    return {"rms_over_noise": rms, "recordings": [rows[k].name for k in by_power[:count]], "details": details}
